"""The table of a fleet: a row for each ship, and one for each of their coefficients; Parquet and CSV."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cases.io.files import replaced
from fitting.report.run_folder import write_json
from mmg.errors import NotWritable

if TYPE_CHECKING:
    import pandas as pd

    from mmg_ident.fleet.run import Fleet

TABLE, COEFFICIENTS, NUMBERS = "fleet", "coefficients", "fleet.json"
LISTS = ("campaigns", "moved", "moved_against_sisters", "instruments", "warnings")
TEXTS = (*LISTS, "drifted", "effects", "reason", "verdict", "sentence", "sisters", "loss", "start", "status")
PLAIN = (
    "name", "sisters", "status", "reason", "start", "length", "trials", "held_out", "seconds_used", "loss", "weight",
    "verdict", "sentence", "reduction", "p_alike", "widths_from_mean",
)  # fmt: skip


def ship_table(fleet: Fleet) -> pd.DataFrame:
    """A row for each ship of ``fleet``: what became of her, scores, what drifted, failed and moved, in words separated
    by "; "."""
    import pandas as pd

    rows = []
    for row in fleet.rows:
        out: dict[str, Any] = {key: row.get(key) for key in PLAIN}
        for name in ("held_out", "training"):
            score = row["scores"].get(name, {})
            for metric in ("window", "paper"):
                pair = score.get(metric, {})
                out |= {f"{name}_{metric}_{when}": pair.get(when) for when in ("before", "after")}
            out |= {f"{name}_{key}": score.get(key) for key in ("position_m", "heading_deg")}
        out |= {key: "; ".join(map(str, row.get(key, []))) for key in LISTS}
        out["drifted"] = "; ".join(d["text"] for d in row["drifted"])
        out["effects"] = "; ".join(f"{e['name']}: {e['text']}" for e in row["effects"])
        rows.append(out)
    table = pd.DataFrame(rows).set_index("name")
    texts = [c for c in table.columns if c in TEXTS]
    numbers = [c for c in table.columns if c not in texts]
    table[numbers] = table[numbers].astype(float)
    table[texts] = table[texts].fillna("").astype(str)
    return table


def coefficient_table(fleet: Fleet) -> pd.DataFrame:
    """A row for each ship and coefficient of ``fleet``: estimate, start, fit alone, mean and width of the sisters."""
    import pandas as pd

    names = (
        "value", "std", "unit", "start", "start_std", "moved", "alone", "alone_std", "sister_mean", "sister_width",
        "from_others",
    )  # fmt: skip
    rows = [
        {"ship": row["name"], "coefficient": symbol} | {name: c.get(name) for name in names}
        for row in fleet.rows
        for symbol, c in row["coefficients"].items()
    ]
    table = pd.DataFrame(rows, columns=["ship", "coefficient", *names])
    numbers = [name for name in names if name != "unit"]
    table[numbers] = table[numbers].astype(float)
    return table


def write_tables(fleet: Fleet, folder: Path) -> None:
    """Write the tables and fleet.json of ``fleet`` to ``folder``, each whole or not at all. Raises UserError where they
    cannot be written."""
    ships, coefficients = ship_table(fleet), coefficient_table(fleet)
    try:
        for name, table in ((TABLE, ships), (COEFFICIENTS, coefficients)):
            _write(folder / f"{name}.parquet", partial(table.to_parquet, engine="pyarrow", write_page_checksum=True))
            text = table.to_csv(index=name == TABLE, lineterminator="\n")
            _write(folder / f"{name}.csv", partial(_text, text))
        write_json(folder / NUMBERS, fleet)
    except OSError as error:
        raise NotWritable(f"{folder}: cannot be written ({error.strerror or error})") from None


def _write(path: Path, fill: Callable[[Path], Any]) -> None:
    """Write the file ``path`` by ``fill``, whole or not at all."""
    with replaced(path) as scratch:
        fill(scratch)


def _text(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")

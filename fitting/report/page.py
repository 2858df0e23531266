"""The report: one self-contained HTML file made from results and the figures in their folders.

Its sections follow the headings of ITTC 7.5-02-06-03 (validation of manoeuvring simulation models) where they fit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from cases.io.files import replace_text
from fitting.identifiability.analysis import KINDS
from fitting.record import FitRecord
from fitting.report.delivered import Delivered, delivery_sections
from fitting.report.plan_section import plan_section
from fitting.report.plot_style import figures_of
from fitting.report.sections import (
    campaign_section,
    coefficient_groups,
    correlated_pairs,
    per_run_table,
    score_sets,
    section,
    shown_number,
    structure_section,
)
from fitting.report.words import (
    headline,
    not_in_model,
    report_warnings,
    setting_rows,
)
from mmg.components.catalogue import summary
from mmg.components.particulars import PARTICULARS
from mmg.effects import effect
from mmg.errors import Missing, NotWritable
from mmg.ship import Ship

DATA_SOURCES = (
    (
        re.compile(r"^(turn|turn_cut|zigzag|random|berthing)_\d\d-[A-Z][a-z]{2}-2020_\d\d_\d\d_\d\d"),
        "Free-running trials of the 3 m ESSO OSAKA model: data set FRT-DS-ESSO, Osaka University, licence "
        "CC BY-NC-SA 4.0 (licence file of the data set; its README says CC BY-NC 4.0): not for commercial use.",
        (
            "Wakita, K., Maki, A., Umeda, N., Miyauchi, Y., Shimoji, T., Rachman, D. M. & Akimoto, Y. (2022). On "
            "neural network identification for low-speed ship maneuvering model. J Mar Sci Technol 27(1), 772-785. "
            "doi:10.1007/s00773-021-00867-1",
            "Miyauchi, Y., Maki, A., Umeda, N., Rachman, D. M. & Akimoto, Y. (2022). System parameter exploration of "
            "ship maneuvering model for automatic docking/berthing using CMA-ES. J Mar Sci Technol 27(2), 1065-1083. "
            "doi:10.1007/s00773-022-00889-3",
        ),
    ),
)
"""Trial names by which a public data set is known, its licence sentence and what to cite."""

PLACES = {
    "errors": ("error_growth",),
    "validation": ("scores", "track"),
    "coefficients": ("coefficients",),
    "identifiability": ("identifiability",),
    "scaling": ("scaling",),
}
"""Sections of the page and how the names of their figures begin."""


def citations_of(result: dict) -> list[tuple[str, tuple[str, ...]]]:
    """Licence sentence and papers of each public data set of which ``result`` used trials."""
    names = [row["name"] for row in [*result["data"], *result.get("validation_data", [])]]
    return [(licence, papers) for pattern, licence, papers in DATA_SOURCES if any(pattern.match(str(n)) for n in names)]


def label_of(folder: Path) -> str:
    """Returns the name of a run ``folder``, also of one that is still being written under a temporary name."""
    name = folder.absolute().name
    return name.lstrip(".").rsplit(".", 1)[0] if name.startswith(".") else name


def _run(record: FitRecord, ship: Ship, folder: Path, number: int, known: Delivered) -> dict:
    """All that the template shows of one run."""
    result = record.to_dict()
    groups = coefficient_groups(result, ship)
    kinds = [row["kind"] for g in groups for row in g["rows"]]
    figures = figures_of(folder, result["figures"])
    by_place = {place: [f for f in figures if f["name"].startswith(starts)] for place, starts in PLACES.items()}
    placed = [f for some in by_place.values() for f in some]
    return {
        "id": f"run{number}",
        "label": label_of(folder),
        "name": ship.mark.name if ship.mark else result["ship"],
        "about": ship.title if ship.mark else "",
        "result": result,
        "ship": ship,
        "headline": headline(result),
        "warnings": report_warnings(result),
        "scores": score_sets(result),
        "groups": groups,
        "counts": [(KINDS[kind], kinds.count(kind)) for kind in KINDS if kind in kinds],
        "correlated": correlated_pairs(result),
        "identifiability": section(result),
        "per_run": per_run_table(result),
        "campaigns": campaign_section(result),
        "particulars": [(k, v, *PARTICULARS.get(k, ("", ""))) for k, v in ship.particulars.items()],
        "models": [
            *((role, name, summary(role, name)) for role, name in ship.components.items()),
            *(("effect", name, effect(name).summary) for name in ship.effects),
        ],
        "choice": structure_section(folder),
        "planned": plan_section(folder),
        "missing": not_in_model(ship),
        "figures": by_place | {"other": [f for f in figures if f not in placed]},
        "settings": setting_rows(result["settings"]),
        "citations": citations_of(result),
        "first": 11,
        "numbered": True,
        "usable": bool(result["converged"]),
        **delivery_sections(result, ship, known),
    }


def comparison_of(runs: list[dict]) -> dict:
    """Scores and coefficients of several ``runs`` (each as the page shows it) side by side, and whether the scores may
    be compared; a coefficient that one run alone has is counted, not listed."""
    sets = [{s["key"]: s for s in run["scores"]} for run in runs]
    tables = []
    for key in dict.fromkeys(key for s in sets for key in s):
        present = [s[key] for s in sets if key in s]
        rows = _side_by_side([[*s[key]["rows"], s[key]["pooled"]] if key in s else [] for s in sets], "name")
        rows.append(rows.pop([name for name, _ in rows].index("all rows pooled")))
        comparable = len({(tuple(r["name"] for r in s["rows"]), s["sigma"]) for s in present}) == 1
        started = {tuple(row[k]["before"] for k in ("window", "paper")) for row in rows[-1][1] if row}
        same_start = comparable and len(started) == 1
        tables.append({"title": present[0]["name"], "rows": rows, "comparable": comparable, "same_start": same_start})
    found = _side_by_side([[r for g in run["groups"] for r in g["rows"]] for run in runs], "symbol")
    shared = [(symbol, cells) for symbol, cells in found if len(cells) - cells.count(None) > 1]
    alone = [sum(bool(c[i]) and c.count(None) == len(c) - 1 for _, c in found) for i in range(len(runs))]
    return {
        "tables": tables,
        "coefficients": [(s, [(r, _differs(c[0], r)) for r in c]) for s, c in shared],
        "alone": [(run["label"], count) for run, count in zip(runs, alone, strict=True) if count],
    }


def _side_by_side(tables: list[list[dict]], key: str) -> list[tuple[str, list[dict | None]]]:
    """(name, the row of that name in each of ``tables`` or None) for all names under ``key``, as they come."""
    by_name = [{row[key]: row for row in table} for table in tables]
    return [(name, [rows.get(name) for rows in by_name]) for name in dict.fromkeys(n for rows in by_name for n in rows)]


def _differs(first: dict | None, other: dict | None) -> bool:
    """Whether two estimates lie more than two standard errors of their difference apart (taken as independent)."""
    if not first or not other or None in (first["std"], other["std"], first["value"], other["value"]):
        return False
    return abs(first["value"] - other["value"]) > 2 * math.hypot(first["std"], other["std"])


@cache
def environment(*packages: str) -> Environment:
    """The templates of these ``packages`` and of this one, with their filters; what they print is escaped."""
    found = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in (*packages, "fitting.report")]), autoescape=True,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    found.filters["number"] = shown_number
    found.filters["as_numbers"] = lambda names: [f"{name}|n" for name in names]
    return found


def build_page(results: Sequence[tuple[FitRecord, Ship, Path]], known: Sequence[Delivered] = ()) -> str:
    """One self-contained HTML page on ``results``: record, calibrated ship and folder with the figures of each.

    known: of each result its trials and its form for IMO; none by default. Raises UserError for no results.
    """
    if not results:
        raise Missing("no run folder given")
    deliveries = [*known, *(Delivered() for _ in results[len(known) :])]
    runs = [_run(*result, i + 1, deliveries[i]) for i, result in enumerate(results)]
    labels = [run["label"] for run in runs]
    for run in runs:
        if labels.count(run["label"]) > 1:
            run["label"] = f"{run['label']} ({run['id']})"
    ships = [run["name"] + ("" if run["result"]["converged"] else " (not converged)") for run in runs]
    comparison = comparison_of(runs) if len(runs) > 1 else None
    return environment().get_template("report.html.j2").render(runs=runs, ships=ships, comparison=comparison)


def write_page(text: str, out: Path) -> None:
    """Write the page ``text`` to ``out``, atomically. Raises UserError when it cannot be written."""
    try:
        replace_text(out, text)
    except OSError as error:
        raise NotWritable(f"{out}: cannot be written ({error.strerror}); choose another --out") from None

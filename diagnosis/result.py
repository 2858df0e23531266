"""``Diagnosis``: what a diagnosis found, with the one writer and the one reader of its folder.

``missing_force.csv`` holds the force that must be added to the model along each of the trials.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, ValidationError

from cases.io.files import decoded, read_bytes, read_json
from cases.shipfiles.ship_file import dump_ship, load_ship
from diagnosis.findings import DiagnosisInputs, DiagnosisRecord, Findings, MissingForce
from fitting.record import MessageRow
from fitting.report.run_folder import (
    SCHEMA_VERSION,
    Real,
    adapter,
    check_target,
    of_predictions,
    read_result,
    write_json,
    write_whole,
)
from mmg.effects import with_present_names
from mmg.errors import BadValue, Missing
from mmg.messages import has_code, html_table, messages_from

if TYPE_CHECKING:
    import pandas as pd

    from diagnosis.report.axes import DiagnosisAxes
    from diagnosis.validation.gap import Gap

MISSING_FORCE = "missing_force.csv"
FORCE_HEADER = ("run", "t [s]", "X [N]", "Y [N]", "N [N m]")
MOST_ROWS = 400  # Rows of a run at most: the force changes over seconds. Set by hand: it bounds the size of a file.


def missing_force(d: Findings) -> dict[str, MissingForce]:
    """The missing force along each training trial of ``d``, by name; empty for findings that were read: no fit."""
    if d.null is None or d.data is None:
        return {}
    data, path = d.data, d.null.path.force
    forces: dict[str, MissingForce] = {}
    for number, name in enumerate(data.trials):
        windows = np.flatnonzero(data.run == number)
        if not len(windows):
            continue
        t = np.concatenate([data.t[: data.steps[w], w] for w in windows])
        force = np.concatenate([path[: data.steps[w], w] for w in windows])
        order = np.argsort(t, kind="stable")[:: max(1, -(-len(t) // MOST_ROWS))]
        forces[name] = MissingForce(t[order], force[order])
    return forces


def missing_force_text(forces: Mapping[str, MissingForce]) -> str:
    """The content of the file for the missing ``forces``, by trial name."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(FORCE_HEADER)
    for name, one in forces.items():
        for t, force in zip(one.t.tolist(), one.force.tolist(), strict=True):
            table.writerow([name, f"{t:.6g}", *(f"{value:.6g}" for value in force)])
    return text.getvalue()


def read_missing_force(folder: Path) -> dict[str, MissingForce]:
    """The missing force by trial name from the ``folder`` of a diagnosis; empty where it has no such file.

    Raises UserError, with the line, for a file that is not as it was written.
    """
    path = folder / MISSING_FORCE
    if not path.exists():
        return {}
    rows = list(csv.reader(io.StringIO(decoded(read_bytes(path), path))))
    if not rows or tuple(rows[0]) != FORCE_HEADER:
        raise BadValue(f"{path}: the header is not {','.join(FORCE_HEADER)}; diagnose again")
    by_run: dict[str, list[list[float]]] = {}
    for number, row in enumerate(rows[1:], start=2):
        try:
            name, *values = row
            numbers = [float(value) for value in values]
        except ValueError:
            numbers = []
        if len(numbers) != 4 or not np.isfinite(numbers).all():
            raise BadValue(f"{path}: line {number} is not a run and four numbers; diagnose again")
        by_run.setdefault(name, []).append(numbers)
    tables = {name: np.array(table) for name, table in by_run.items()}
    return {name: MissingForce(table[:, 0], table[:, 1:]) for name, table in tables.items()}


CONTENT, RESULT, SHIP = "diagnosis.json", "result.json", "ship.toml"


class Diagnosis(Findings):
    """The findings, with their tables and their folder."""

    def to_pandas(self) -> pd.DataFrame:
        """The candidates, best first, one row each by name, with the columns of ``diagnosis.json`` that are plain, and
        role: "named", "same class" or ""."""
        import pandas as pd

        plain = ("score", "p_value", "delta_bic", "excited", "absorbed_share")
        rows = [
            {"name": c.name, "role": self.role(c.name).replace("class", "same class")}
            | {n: getattr(c, n) for n in plain}
            for c in self.candidates
        ]
        return pd.DataFrame(rows).set_index("name")

    @property
    def plot(self) -> DiagnosisAxes:
        """Its figures on axes: ``diagnosis.plot.budget(ax)``."""
        from diagnosis.report.axes import DiagnosisAxes  # late: matplotlib is slow to import

        return DiagnosisAxes(self)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.ship.title}: {self.verdict}. {self.sentence}>"

    def _repr_html_(self) -> str:
        table = self.to_pandas().reset_index()
        return html_table(f"{self.verdict}: {self.sentence}", list(table.columns), table.itertuples(index=False))

    def told_by(self, content: Mapping[str, Any]) -> Diagnosis:
        """With what the ``content`` of a calibration's result.json tells of predictions, where nothing is known yet."""
        predictions = self.inputs.of_predictions or of_predictions(content)
        return dataclasses.replace(self, inputs=dataclasses.replace(self.inputs, of_predictions=predictions))

    def save(self, folder: Path | str, replace: bool = False, report: bool = True, gap: Gap | None = None) -> None:
        """Write diagnosis.json, result.json, ship.toml and, where the fit is known, missing_force.csv to ``folder``,
        whole or not at all; then figures and page.

        replace: an existing folder is replaced; report: whether figures and page are made, of which one that fails is a
        warning; gap: comparison of models, of which it is a part, for the page. Raises UserError where the folder
        exists otherwise, or cannot be written.
        """
        from diagnosis.report import page

        folder = Path(folder)
        if not replace:
            check_target(folder)
        began = time.perf_counter()
        whole = not has_code(self.warnings, "out_of_time")  # else --resume makes what is missing

        def result(figures: Sequence[Mapping[str, str]], failures: Sequence[str], complete: bool) -> dict[str, Any]:
            seconds = self.timings.get("total", 0.0) + time.perf_counter() - began
            made_from = dict(vars(self.inputs))
            return {
                "schema_version": SCHEMA_VERSION,
                "kind": "diagnosis",
                "complete": complete,
                **made_from.pop("of_predictions"),
                **made_from,
                "figures": figures,
                "warnings": [*self.warnings, *failures],
                "timings_s": {**self.timings, "wall": seconds},
            }

        def fill(scratch: Path) -> None:
            (scratch / SHIP).write_text(dump_ship(self.ship, "refitted by mmg diagnose"), encoding="utf-8")
            write_json(scratch / CONTENT, self.to_dict())
            write_json(scratch / RESULT, result([], [], complete=whole and not report))
            if found := missing_force(self):
                (scratch / MISSING_FORCE).write_text(missing_force_text(found), encoding="utf-8")

        write_whole(folder, fill, replace)
        if not report:
            return
        made = page.write_report(self, folder, gap)
        write_json(folder / RESULT, result(made.rows, made.failures, complete=whole))


def is_complete(folder: Path) -> bool:
    """Whether ``folder`` holds a diagnosis with all figures and its page, so that there is nothing to resume.

    Raises UserError where it holds the run of another command.
    """
    if not (folder / RESULT).exists():
        return False
    content = read_result(folder)
    if content["kind"] != "diagnosis":
        raise BadValue(f"{folder}: is no run of mmg diagnose, so there is nothing to resume; choose another --out")
    return content.get("complete") is True


def _beside_what_stands(unnamed: Any) -> Any:
    """Log Bayes factors of unnamed forms; version 0.1 had those without effects and with those named."""
    return unnamed.get("after", unnamed) if isinstance(unnamed, dict) else unnamed


@dataclass(frozen=True, kw_only=True)
class _Content(DiagnosisRecord):
    """The keys of ``diagnosis.json`` and what each must be."""

    schema_version: Literal[1]
    verdict: Literal["none", "named", "unknown"]
    unnamed: Annotated[Mapping[str, Real], BeforeValidator(_beside_what_stands)]
    messages: tuple[MessageRow, ...]


def read_diagnosis(folder: Path | str) -> Diagnosis:
    """The diagnosis that ``Diagnosis.save`` wrote to ``folder``, without its fits and the arranged data.

    Raises UserError, with file and key, where a file is missing, no JSON or not as it was written.
    """
    folder = Path(folder)
    content = _checked(_Content, folder / CONTENT)
    record = {f.name: getattr(content, f.name) for f in fields(DiagnosisRecord)}
    inputs = _checked(DiagnosisInputs, folder / RESULT)
    return Diagnosis(
        **record | {"warnings": messages_from(vars(row) for row in content.messages)},
        inputs=dataclasses.replace(inputs, of_predictions=of_predictions(read_result(folder))),
        ship=load_ship(folder / SHIP),
    )


def _checked(kind: Any, path: Path) -> Any:
    """The content of a JSON file as ``kind``."""
    if not path.exists():
        raise Missing(f"{path.parent}: holds no diagnosis (no {path.name} in it)")
    try:
        return adapter(kind).validate_python(with_present_names(read_json(path)))
    except ValidationError as error:
        rows = [(".".join(str(x) for x in e["loc"]) or "it", e["msg"], e["input"]) for e in error.errors()]
        wrong = [f"{key}: {words}" + ("" if isinstance(x, (dict, list)) else f", not {x!r}") for key, words, x in rows]
        raise BadValue(f"{path}: {'; '.join(wrong)}") from None

"""``missing_force.csv`` of a diagnosis: the force that must be added to the model along each of the trials."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cases.io.files import decoded, read_bytes
from diagnosis.findings import Findings
from mmg.errors import BadValue

FILE = "missing_force.csv"
HEADER = ("run", "t [s]", "X [N]", "Y [N]", "N [N m]")
MOST = 400
"""Rows of a run at most: the force changes over seconds."""


@dataclass(frozen=True)
class MissingForce:
    """The force that the model of a diagnosis lacks along one trial.

    t: (M,) since the start of the trial [s]; force: (M, 3) in body axes, X, Y [N], N [N m].
    """

    t: np.ndarray
    force: np.ndarray


def missing_force(d: Findings) -> dict[str, MissingForce]:
    """The missing force along each training trial of ``d``, by name; empty for findings that were read from a folder,
    which have no fit."""
    if d.null is None or d.data is None:
        return {}
    data, path = d.data, d.null.path.force
    found: dict[str, MissingForce] = {}
    for number, name in enumerate(data.trials):
        windows = np.flatnonzero(data.run == number)
        if not len(windows):
            continue
        t = np.concatenate([data.t[: data.steps[w], w] for w in windows])
        force = np.concatenate([path[: data.steps[w], w] for w in windows])
        order = np.argsort(t, kind="stable")[:: max(1, -(-len(t) // MOST))]
        found[name] = MissingForce(t[order], force[order])
    return found


def missing_force_text(found: Mapping[str, MissingForce]) -> str:
    """The content of the file for what was ``found``, by trial name."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEADER)
    for name, one in found.items():
        for t, force in zip(one.t.tolist(), one.force.tolist(), strict=True):
            table.writerow([name, f"{t:.6g}", *(f"{value:.6g}" for value in force)])
    return text.getvalue()


def read_missing_force(folder: Path) -> dict[str, MissingForce]:
    """The missing force by trial name from the ``folder`` of a diagnosis; empty where it has no such file.

    Raises UserError, with the line, for a file that is not as it was written.
    """
    path = folder / FILE
    if not path.exists():
        return {}
    rows = list(csv.reader(io.StringIO(decoded(read_bytes(path), path))))
    if not rows or tuple(rows[0]) != HEADER:
        raise BadValue(f"{path}: the header is not {','.join(HEADER)}; diagnose again")
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

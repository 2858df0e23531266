"""What to write into trials.toml so that a folder's contradictions go: each remedy is tried before it is advised."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cases.checks.kinematics import kinematics
from cases.checks.report import CONTRADICTORY, CheckReport
from cases.checks.rudder import rudder_sign
from cases.io.sidecar import NAME
from cases.io.unit_sanity import implausible
from cases.trial import Trial

TRIED = 4
"""So many contradictory files of a folder a remedy is tried on."""


@dataclass(frozen=True)
class Remedy:
    """A correction of files: the line of trials.toml, what it makes of the columns, and the findings it explains."""

    line: str
    codes: tuple[str, ...]
    change: Callable[[Trial], Mapping[str, np.ndarray]]


def _signs(*names: str) -> Callable[[Trial], Mapping[str, np.ndarray]]:
    return lambda trial: {name: -trial[name] for name in names if name in trial}


def _sign_line(*names: str) -> str:
    return "sign = { " + ", ".join(f"{name} = -1" for name in names) + " }"


def _turned(swap: bool) -> Callable[[Trial], Mapping[str, np.ndarray]]:
    def change(trial: Trial) -> Mapping[str, np.ndarray]:
        north, east = (trial["v"], trial["u"]) if swap else (trial["u"], trial["v"])
        body = (north + 1j * east) * np.exp(-1j * trial["psi"])
        return {"u": body.real, "v": body.imag}

    return change


REMEDIES = (
    Remedy('velocity_frame = "earth"', ("velocity_frame",), _turned(False)),
    Remedy(
        'velocity_frame = "earth" and columns = { u = HEADER OF v, v = HEADER OF u }',
        ("velocity_frame",),
        _turned(True),
    ),
    Remedy(_sign_line("v"), ("sway_sign", "v_sign"), _signs("v")),
    Remedy(_sign_line("u"), ("u_sign",), _signs("u")),
    Remedy(_sign_line("r"), ("r_sign",), _signs("r")),
    Remedy('rudder_positive = "port"', ("rudder_sign",), _signs("delta", "delta_port", "delta_starboard")),
    Remedy(_sign_line("psi"), ("heading_sign",), _signs("psi")),
    Remedy(_sign_line("psi", "r"), ("heading_sign",), _signs("psi", "r")),
    Remedy(_sign_line("y"), ("mirrored_frame",), _signs("y")),
    Remedy(_sign_line("psi", "v", "r"), ("mirrored_frame",), _signs("psi", "v", "r")),
    Remedy(
        "columns = { x = HEADER OF y, y = HEADER OF x }",
        ("swapped_positions",),
        lambda trial: {"x": trial["y"], "y": trial["x"]},
    ),
    Remedy(
        f"psi as the compass heading, 90 deg - psi, and {_sign_line('r')}",
        ("heading_from_east",),
        lambda trial: {"psi": math.pi / 2 - trial["psi"], "r": -trial["r"]},
    ),
    Remedy(
        "psi as the compass heading, 90 deg - psi",
        ("heading_from_east",),
        lambda trial: {"psi": math.pi / 2 - trial["psi"]},
    ),
    Remedy(
        "psi as the compass heading, psi + 90 deg",
        ("heading_from_east",),
        lambda trial: {"psi": trial["psi"] + math.pi / 2},
    ),
)
"""In the order in which they are tried; the first that leaves no contradiction is advised."""


def settled(trials: Sequence[Trial], reports: Sequence[CheckReport]) -> list[CheckReport]:
    """``reports`` on ``trials`` in which the contradictions of each folder are those of the one remedy that ends them.

    What follows from the same fault (a rudder of the wrong sign beside a mirrored frame) is left out. Where no remedy
    ends them, the reports stay as they are.
    """
    out = list(reports)
    folders: dict[Path | None, list[int]] = {}
    for i, (trial, report) in enumerate(zip(trials, reports, strict=True)):
        if report.verdict == CONTRADICTORY:
            folders.setdefault(trial.path.parent if trial.path else None, []).append(i)
    for folder, rows in folders.items():
        said = {f.code for i in rows for f in reports[i].findings if f.level == CONTRADICTORY}
        tried = [trials[i] for i in rows[:: max(1, len(rows) // TRIED)]]
        usable = [remedy for remedy in REMEDIES if set(remedy.codes) & said and "unit" not in said]
        best = next((remedy for remedy in usable if not any(_refuted(_mended(t, remedy)) for t in tried)), None)
        if best is None:
            continue
        everywhere = len(rows) == sum(1 for t in trials if (t.path.parent if t.path else None) == folder)
        for i in rows:
            path = trials[i].path
            where = "[default]" if everywhere else f'[files."{path.name if path else out[i].name}"]'
            out[i] = _explained(out[i], best, f"{folder / NAME if folder else NAME}, {where}")
    return out


def _mended(trial: Trial, remedy: Remedy) -> Trial:
    return trial.with_columns(**remedy.change(trial))


def _refuted(trial: Trial) -> bool:
    """Whether units, frames, signs or rudder of ``trial`` are still contradictory."""
    found = [*kinematics(trial)[1], *rudder_sign(trial)[1]]
    return bool(implausible(trial.columns)) or any(level == CONTRADICTORY for level, _, _ in found)


def _explained(report: CheckReport, remedy: Remedy, where: str) -> CheckReport:
    """``report`` with the contradictions that ``remedy`` explains, the first of them with what to write ``where``."""
    own = [f for f in report.findings if f.level == CONTRADICTORY and f.code in remedy.codes]
    if not own:
        return report
    text = f"{own[0].text} Tried on these files, this ends the contradictions: {where}: {remedy.line}."
    kept = [own[0]._replace(text=text), *(f for f in report.findings if f.level != CONTRADICTORY)]
    return replace(report, findings=tuple(kept))

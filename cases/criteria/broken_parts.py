"""Measured runs of which broken stretches were left out: bridged where they are short, refused where they decide."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cases.criteria.measured_maneuvers import Execute
from cases.io.leave_out import bridged, inside, spans_left_out
from cases.io.sidecar import line_for
from cases.trial import Trial
from mmg.errors import BadValue
from mmg.states import STATES

LARGEST_TURN = math.radians(5.0)
"""The ship may turn by this over a stretch that is bridged by straight lines; IMO gives headings in whole degrees."""


def without_broken_parts(trial: Trial, execute: Execute) -> tuple[Trial, Execute]:
    """``trial`` with its left-out stretches bridged by straight lines, and its ``execute`` up to one that cannot be.

    A zigzag counts up to the last reversal before that stretch. Raises UserError where a manoeuvre of another kind has
    one: something else moved the ship in it, or she turned by more than LARGEST_TURN.
    """
    t = trial.t - trial.t[0]
    for first, last in spans_left_out(trial):
        rows = inside(trial, [(first, last)])
        if not rows.any() or t[rows][-1] < execute.order_time or t[rows][0] > execute.end:
            continue
        moved = not (bridged(trial) | ~rows).all()
        if not moved and _turn(trial, rows) <= LARGEST_TURN:
            continue
        before = [time for time in execute.reversals if time < t[rows][0]]
        if len(before) > 1:
            execute = replace(execute, reversals=tuple(before[:-1]), end=before[-1])
            break
        turns = f"she turns by more than {math.degrees(LARGEST_TURN):g} deg meanwhile"
        raise BadValue(
            f"{trial.name}: {first:.1f} to {last:.1f} s are left out, in the manoeuvre that is measured, and "
            f"{'something else moved the ship there' if moved else turns}; mend them, add to "
            f"{line_for(trial.path, trial.name, 'exclude = []')}, or add --unchecked"
        )
    return (_filled(trial) if spans_left_out(trial) else trial), execute


def _turn(trial: Trial, rows: np.ndarray) -> float:
    """How far the ship turns [rad] from the last sound sample before the ``rows`` (N,) to the first after them.

    Infinite where there is none on one side.
    """
    psi, at = trial.psi_unwrapped, np.flatnonzero(rows)
    good = np.isfinite(psi)
    before, after = psi[: at[0]][good[: at[0]]], psi[at[-1] + 1 :][good[at[-1] + 1 :]]
    return abs(float(after[0] - before[-1])) if len(before) and len(after) else math.inf


def _filled(trial: Trial) -> Trial:
    rows = inside(trial, spans_left_out(trial))
    columns = dict(trial.columns) | {"psi": trial.psi_unwrapped}
    for name in (name for name in STATES if name in columns):
        good = np.isfinite(columns[name])
        if good.any():
            values = np.interp(trial.t, trial.t[good], columns[name][good])
            columns[name] = np.where(rows & ~good, values, columns[name])
    return replace(trial, columns=columns)

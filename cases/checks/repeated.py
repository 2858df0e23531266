"""Rows of a record that hold what earlier ones hold: a logger that repeats its last sample, or the seconds before."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cases.checks.frozen import LEAST_ROWS, LEAST_S, LONGEST, usual_length
from cases.trial import Trial

NAMES = ("x", "y", "psi", "u", "v", "r")

CHANGES = 0.5
"""Share of the rows of a replayed part that differ from the row before: a ship at rest has the same row for long."""


def repeated(trial: Trial) -> Iterator[tuple[int, int, str, tuple[str, ...]]]:
    """First and last row, what, and columns of each stretch of ``trial`` in which all states are repeated."""
    names = tuple(name for name in NAMES if name in trial)
    rows = np.column_stack([trial[name] for name in names])
    same = (rows[1:] == rows[:-1]).all(axis=1)
    least = max(LEAST_ROWS, round(LEAST_S / trial.dt))
    yield from _held(trial, names, same, least)
    yield from _replayed(trial, names, rows, same, least)


def _held(
    trial: Trial, names: tuple[str, ...], same: np.ndarray, least: int
) -> Iterator[tuple[int, int, str, tuple[str, ...]]]:
    runs = _runs(same)
    if not len(runs):
        return
    speed, turn = np.hypot(trial["u"], trial["v"]), np.abs(trial["r"])
    awake = (speed > 0.3 * np.nanmedian(speed)) | (turn > 0.3 * np.nanmedian(turn))
    longest = LONGEST * usual_length(runs[:, 1] - runs[:, 0], len(trial))
    for first, last in runs[runs[:, 1] - runs[:, 0] >= max(least, longest)]:
        if awake[first] and last + 1 < len(trial):
            yield int(first), int(last), "the last sample of all states is repeated", names


def _replayed(
    trial: Trial, names: tuple[str, ...], rows: np.ndarray, same: np.ndarray, least: int
) -> Iterator[tuple[int, int, str, tuple[str, ...]]]:
    good = np.isfinite(rows).all(axis=1)
    key = np.nan_to_num(rows) @ np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0][: rows.shape[1]])  # the same for the same row
    which = np.unique(key, return_inverse=True)[1]
    order = np.argsort(which, kind="stable")
    lag = np.zeros(len(rows), int)
    twins = which[order][1:] == which[order][:-1]
    lag[order[1:][twins]] = (order[1:] - order[:-1])[twins]
    lag[~good] = 0
    follows = (lag[1:] == lag[:-1]) & (lag[1:] > 1)
    for first, last in _runs(follows):
        moving = float(np.mean(~same[first:last])) if last > first else 0.0
        if last - first >= least and moving > CHANGES:
            yield int(first), int(last), "earlier samples are repeated", names


def _runs(flags: np.ndarray) -> np.ndarray:
    """First row and the row after the last of each run of true ``flags`` (M,), (runs, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], flags, [0]]).astype(int))).reshape(-1, 2)

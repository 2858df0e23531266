"""Frozen channels: the same value again and again while the rest of the record says that it must change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from cases.checks.mismatches import COLUMNS, mismatches, resolution
from cases.trial import Trial

LONGEST = 4.0
"""A value is frozen when it is repeated this many times as often as the longest repetition that is usual."""

USUAL = 0.8
"""Share of the samples that lie in repetitions of usual length."""

LEAST_ROWS, LEAST_S = 5, 1.2
"""Fewer repetitions, or fewer seconds, are a matter of rounding."""

JUMP = 3.0
"""A velocity without noise that was frozen goes on with a jump of this many of its larger changes from row to row; one
that does not was steady."""

NOISY = 0.25
"""Share of changes from row to row against the one before, from which a channel has noise (white noise: 2/3), so that
it never repeats itself for long."""

GROUPS = (("psi",), ("x", "y"), ("u", "v"), ("r",))


def frozen(trial: Trial, signals: Mapping[str, np.ndarray]) -> Iterator[tuple[int, int, str, tuple[str, ...]]]:
    """First and last row, what, and columns of each frozen stretch of ``trial``.

    signals: its ``mismatches``, each (N,).
    """
    speed, turn = np.hypot(trial["u"], trial["v"]), np.abs(trial["r"])
    moves = {"psi": turn, "r": np.abs(np.gradient(trial.psi_unwrapped, trial.t)), "x": speed, "u": speed}
    for group in GROUPS:
        if any(name not in trial for name in group):
            continue
        same = np.all([np.diff(trial[name]) == 0 for name in group], axis=0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], same, [0]]).astype(int))).reshape(-1, 2)
        if not len(edges):
            continue
        lengths = edges[:, 1] - edges[:, 0]
        least = max(LEAST_ROWS, LEAST_S / trial.dt)
        motion = moves[group[0]]
        awake = 0.3 * float(np.nanmedian(motion))
        for k in np.flatnonzero(lengths >= least):
            first, last = edges[k]
            if lengths[k] < LONGEST * usual_length(np.delete(lengths, k), len(trial) - lengths[k]):
                continue
            moved = motion[first : last + 1][np.isfinite(motion[first : last + 1])]
            awoken = len(moved) > 0 and float(np.median(moved)) > awake and _others_move(trial, group, first, last)
            awoken = awoken and _lacks(trial, signals, group, first, last)
            if awoken and (group[0] in ("psi", "x") or _resumes(trial, group, last)):
                yield int(first), int(last), f"{', '.join(group)} frozen", group


def frozen_share(trial: Trial) -> dict[str, float]:
    """Columns, in words, that stand still for a part of ``trial`` -> share of its time."""
    out: dict[str, float] = {}
    for first, last, _, group in frozen(trial, mismatches(trial)):
        name = ", ".join(group)
        out[name] = out.get(name, 0.0) + float(trial.t[last] - trial.t[first]) / max(trial.duration, 1e-9)
    return out


def _lacks(trial: Trial, signals: Mapping[str, np.ndarray], group: tuple[str, ...], first: int, last: int) -> bool:
    """Whether more of the motion is missing between the rows than rounded columns do not show.

    What the rates are off by throughout the rest of the record is not missing.
    """
    name = next(name for name, columns in COLUMNS.items() if group in columns)
    if name not in signals or not resolution(trial, group):
        return False
    own, since = signals[name], trial.t[first : last + 1] - trial.t[first]
    off, rest = own[first : last + 1] - own[first], trial.duration - since[-1]
    drift = (own[-1] - own[0] - off[-1]) / rest if rest > since[-1] else 0.0
    missing = min(float(np.abs(off).max()), float(np.abs(off - drift * since).max()))
    place, rate = (resolution(trial, columns) for columns in COLUMNS[name])
    return missing > place + rate * float(since[-1])


def _resumes(trial: Trial, group: tuple[str, ...], last: int) -> bool:
    """Whether a column of the ``group`` has noise, or jumps after the row ``last``."""
    for name in group:
        change = np.diff(trial[name])
        moved = change[np.abs(change) > 0]
        if len(moved) < 2:
            continue
        if np.mean(np.sign(moved[1:]) != np.sign(moved[:-1])) > NOISY:
            return True
        if last < len(change) and np.abs(change[last]) > JUMP * np.percentile(np.abs(moved), 95):
            return True
    return False


def usual_length(lengths: np.ndarray, rows: int) -> float:
    """Length of a repetition that all but a few samples of the ``rows`` of a record do not exceed.

    lengths: of its repetitions (M,), in rows.
    """
    if not len(lengths):
        return 1.0
    lengths = np.sort(lengths)
    within = rows - lengths.sum() + np.cumsum(lengths)
    return (
        float(lengths[np.searchsorted(within, USUAL * rows).clip(max=len(lengths) - 1)])
        if (rows - lengths.sum() < USUAL * rows)
        else 1.0
    )


def _others_move(trial: Trial, group: tuple[str, ...], first: int, last: int) -> bool:
    """Whether columns beside those of the ``group`` change between the rows: a record that repeats is a gap."""
    others = [name for names in GROUPS if names != group for name in names if name in trial]
    return any(np.any(np.diff(trial[name][first : last + 1]) != 0) for name in others)

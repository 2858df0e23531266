"""Channels that stand still, and positions of lost satellites: found and masked."""

from __future__ import annotations

import numpy as np

from mmg.messages import Message

BY_CHANCE = 1e-9
"""Probability of a row of equal values below which a channel stands still."""
FROZEN_S, FROZEN_ROWS, JUMP = 2.0, 10, 3.0
"""Least time and rows that a channel stands still, and its jump afterwards, in its larger changes from row to row."""
LARGEST = 1e15
"""No measurement in any unit is larger."""
STATES = ("latitude", "longitude", "x", "y", "psi", "sog", "cog", "u", "v", "r")
"""Channels that never stand still while the ship moves."""


def stands_still(t: np.ndarray, channels: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[Message]]:
    """The ``channels`` (each (N,)) with NaN where a state stands still, and what was found.

    t: (N,) seconds. How often a channel repeats its value by rounding alone is taken from the channel itself. A stretch
    counts where the channel jumps at its end, or, at the end of the log, where most other states go on moving.
    """
    out, said = dict(channels), []
    held = {name: np.flatnonzero(np.isfinite(channels[name])) for name in STATES if name in channels}
    states = {name: channels[name][at] for name, at in held.items() if len(at) > 1}  # each at the rows that hold it
    moving = {name: _moves(values) for name, values in states.items()}
    for name, values in states.items():
        at = held[name]
        change = np.abs(np.diff(values))
        if name in ("psi", "cog"):
            turn = 360.0 if np.nanmax(np.abs(values)) > 7 else 2 * np.pi
            change = np.minimum(change, np.abs(turn - change))
        same = change == 0
        share = (same.sum() + 1) / (len(change) + 2)
        if share > 0.9:  # so coarsely rounded that nothing can be said
            continue
        rows = max(FROZEN_ROWS, int(np.ceil(np.log(BY_CHANCE) / np.log(share))))
        usual = float(np.percentile(change[change > 0], 95)) if (change > 0).any() else np.inf
        out[name] = channels[name].copy()
        for a, b in _runs(same):
            begin, end = at[a], at[b]
            if b - a + 1 < rows or t[end] - t[begin] < FROZEN_S:
                continue
            others = [_share(moving[other], held[other], begin, end) > 0.5 for other in states if other != name]
            jumps = b < len(change) and change[b] > JUMP * usual
            if not jumps and not (b == len(change) and np.mean(others or [False]) > 0.5):
                continue
            out[name][begin + 1 : end + 1] = np.nan
            words = f"stands still from {t[begin] - t[0]:.6g} to {t[end] - t[0]:.6g} s of the log and is left out there"
            said.append(Message(f"{name} {words}", "frozen"))
    return out, said


def lost_satellites(t: np.ndarray, channels: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[Message]]:
    """The ``channels`` with NaN for positions that are none: (0, 0), beyond the globe, or far from those around them.

    t: (N,) seconds; channels: latitude and longitude [deg], or x and y [m].
    """
    pair = ("latitude", "longitude") if "latitude" in channels else ("x", "y")
    if not set(pair) <= set(channels):
        return dict(channels), []
    a, b = (channels[name].copy() for name in pair)
    none = np.zeros(len(a), dtype=bool)
    if pair[0] == "latitude":
        none = ((a == 0) & (b == 0)) | (np.abs(a) > 90) | (np.abs(b) > 360)
    known = np.flatnonzero(np.isfinite(a) & np.isfinite(b) & ~none)
    if len(known) > 20:
        for values in (a, b):
            typical = _running_median(values[known], 9)
            off = np.abs(values[known] - typical)
            step = np.abs(np.diff(typical))
            usual = max(float(np.percentile(step, 95)), float(np.median(off)), 1e-12)
            none[known[off > 30 * usual]] = True
    count = int((none & np.isfinite(a)).sum())
    if not count:
        return dict(channels), []
    for values in (a, b):
        values[none] = np.nan
    text = f"{count} positions of lost satellites (zero, or far from those before and after) are left out"
    return {**channels, pair[0]: a, pair[1]: b}, [Message(text, "position_lost")]


def _moves(values: np.ndarray) -> np.ndarray:
    """(N - 1,) whether a channel changes within a few rows."""
    changed = np.nan_to_num(np.abs(np.diff(values))) > 0
    return np.convolve(changed, np.ones(9), "same") > 0


def _share(moves: np.ndarray, at: np.ndarray, begin: int, end: int) -> float:
    """The share of a channel's changes between the rows ``begin`` and ``end`` that move; at: (N,) rows that hold it."""
    inside = moves[(at[:-1] >= begin) & (at[1:] <= end)]
    return float(inside.mean()) if len(inside) else 0.0


def _runs(same: np.ndarray) -> list[tuple[int, int]]:
    """First and last row of each stretch in which neighbours are equal."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _running_median(values: np.ndarray, width: int) -> np.ndarray:
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(values, size=width, mode="nearest"))

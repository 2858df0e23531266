"""Motion without cause: the turn rate swings while rudder, propeller and thrusters rest.

With inputs at rest the turn rate of a ship goes to its steady value, past it at most once. A turn rate that swings to
and fro, faster than her own rudder ever makes it change, was made by something that the record does not hold: a hand,
a line, the bank.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from cases.trial import RUDDERS, Trial

PODS = tuple(f"{name}_{i}" for i in (2, 3, 4) for name in ("n_azimuth", "azimuth"))
STEERING = (*RUDDERS, "n_bow", "n_stern", "n_azimuth", "azimuth", *PODS)
"""What turns a ship. The propeller does so by its flow on the rudder, and pushes her on."""

SWINGING = "the turn rate swings while rudder and propeller rest"
"""What is said of such a spell."""

SWINGS = 2
"""So many swings beyond the first, which the last order may have caused."""

SIZE = 0.5
"""A swing changes the turn rate by this share of its root mean square over the record."""

MOST = 0.9
"""Share of the record beyond which a spell leaves no orders to compare with."""

BEYOND_NOISE = 6.0
"""And by so many standard deviations of its own noise, after smoothing."""

QUICKER = 1.0
"""It does so faster, by this factor, than 95 % of the record."""

STOPPED = 0.15
"""The same factor where the propeller is stopped as well: nothing of the ship's own is left that turns her."""

SHORTER = 0.4
"""So it is only in spells up to this share of the record: one that lies stopped in swell swings all the time."""

AGREED = 0.5
"""The heading turns with it, by at least this share: else the gyro swings, not the ship."""

PROPELLERS = ("n", "n_2", "n_3", "n_4")


def without_cause(trial: Trial) -> Iterator[tuple[int, int, str, tuple[str, ...]]]:
    """First and last row, what, and columns of each spell of rest of ``trial`` in which the turn rate swings.

    The spell counts from its beginning: when the hand took hold is not in the record.
    """
    width = max(5, round(1.0 / trial.dt)) | 1
    r = trial["r"]
    if not np.isfinite(r).all() or len(trial) < 10 * width:
        return
    moved = np.zeros(len(trial) - 1, bool)
    for name in STEERING:
        if name in trial:
            values = trial[name]
            moved |= np.abs(np.diff(values)) > 1e-3 * max(float(np.nanmax(np.abs(values))), 1e-9)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], ~moved, [0]]).astype(int))).reshape(-1, 2)
    smooth = _mean(r, width)
    rate = np.abs(np.gradient(smooth, trial.t))
    turning = _mean(np.gradient(trial.psi_unwrapped, trial.t), width)
    noise = float(np.std(r - smooth)) / np.sqrt(width)
    size, quick = (
        max(SIZE * float(np.sqrt(np.mean(r**2))), BEYOND_NOISE * noise),
        QUICKER * float(np.quantile(rate, 0.95)),
    )
    for first, last in edges:
        if last - first < 3 * width or last - first > MOST * len(r):
            continue
        stopped = last - first <= SHORTER * len(r) and _stopped(trial, first, last)
        fast = quick * (STOPPED / QUICKER if stopped else 1.0)
        turns = _extrema(smooth[first : last + 1], size)
        swings = [
            (i, j)
            for i, j in pairwise(turns)
            if abs(smooth[first + j] - smooth[first + i]) > fast * (trial.t[first + j] - trial.t[first + i])
            and (turning[first + j] - turning[first + i]) / (smooth[first + j] - smooth[first + i]) > AGREED
        ]
        if len([pair for pair in swings if pair[0] > 0]) >= SWINGS:
            yield int(first), int(last), SWINGING, ("u", "v", "r")


def _mean(values: np.ndarray, width: int) -> np.ndarray:
    return np.convolve(np.pad(values, width // 2, mode="edge"), np.full(width, 1.0 / width), "valid")


def _stopped(trial: Trial, first: int, last: int) -> bool:
    """Whether every propeller of ``trial`` is at rest between the rows."""
    names = [name for name in PROPELLERS if name in trial]
    return bool(names) and all(
        float(np.nanmax(np.abs(trial[name][first : last + 1]))) <= 0.02 * float(np.nanmax(np.abs(trial[name])))
        for name in names
    )


def _extrema(values: np.ndarray, size: float) -> list[int]:
    """Rows where ``values`` turn back by more than ``size``, with the first row, and the last extremum."""
    low = high = 0
    found, up = [0], None
    for i, value in enumerate(values.tolist()):
        if value > values[high]:
            high = i
        if value < values[low]:
            low = i
        if up is not False and value < values[high] - size:
            if up:
                found.append(high)
            up, low, high = False, i, i
        elif up is not True and value > values[low] + size:
            if up is False:
                found.append(low)
            up, low, high = True, i, i
    if up is not None:
        found.append(high if up else low)
    return found

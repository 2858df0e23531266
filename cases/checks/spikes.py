"""Trains of spikes: single samples of u, v or r that jump away and back, again and again within seconds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cases.checks.mismatches import grain
from cases.trial import Trial

SURE = 8.0
"""Distance of a sample from the median of its neighbours, over the usual one, from which it is a spike."""

SIZE = {"u": 0.15, "v": 0.15, "r": 1.0}
"""Least size: share of the rms speed (u, v) or of the rms turn rate."""

LEAST = 4
"""So many spikes make a train; fewer are the outliers that a robust loss is for."""

APART = 3.0
"""s, or so many samples: longest time between spikes of a train."""

RARE = 0.05
"""Share of samples from which spikes are the noise of the channel."""

PIECE = 100000
"""Rows that are looked at at once."""

REACH = 3
"""Neighbours on each side."""


def spike_trains(trial: Trial) -> Iterator[tuple[int, int, str, tuple[str, ...]]]:
    """First and last row, what, and column of each train of spikes of ``trial``."""
    for name in SIZE:
        values = trial[name]
        if not np.isfinite(values).all():
            continue
        rms = float(np.sqrt(np.mean(values**2 + (0.0 if name == "r" else _other(trial, name)))))
        off = _off(values)
        usual = max(1.4826 * float(np.median(off)), float(np.quantile(off, 0.9)) / 1.645, 0.5 * grain(values))
        rows = np.flatnonzero(off > max(SURE * usual, SIZE[name] * rms))
        if len(rows) > RARE * len(values):
            continue
        apart = max(APART, APART * trial.dt)
        for train in np.split(rows, np.flatnonzero(np.diff(trial.t[rows]) > apart) + 1):
            if len(train) >= LEAST:
                yield int(train[0]), int(train[-1]), f"spikes of {name}", (name,)


def _off(values: np.ndarray) -> np.ndarray:
    """Distance of each of the ``values`` from the median of its neighbours, (N,), in pieces that need little memory."""
    padded = np.pad(values, REACH, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH + 1)
    pieces = [np.median(around[i : i + PIECE], axis=1) for i in range(0, len(values), PIECE)]
    return np.abs(values - np.concatenate(pieces))


def _other(trial: Trial, name: str) -> np.ndarray:
    """Square of the other velocity beside u or v, 0 where it is missing, (N,)."""
    return np.nan_to_num(trial["v" if name == "u" else "u"]) ** 2

"""Logged velocities that are late: by how much, from the positions, and the velocities as they were.

As of the effect velocity_filter (mmg/effects/velocity_filter.py): the earth-fixed velocity is late, or u and v are, and
heading and yaw rate are not. The lag is the one under which the integral of the velocity follows the positions best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.nlp.grid import Grid
from mmg.motion.frames import body_to_earth

LAG, AXES = "velocity_filter.tau", "velocity_filter.body_axes"
"""Symbols, in a ship, of the lag [s] and of whether u and v are late in body axes (1) or in the earth frame (0)."""
TRIED = 41
"""Number of lags that are tried."""


def likeliest_lag(pieces: Sequence[Grid], longest: float, rows: int, body_axes: float = 0.0) -> float:
    """The lag [s] of ``pieces``, 0 to ``longest``, by the positions in stretches of so many ``rows``; 0 without any.
    body_axes: of the filter."""
    squares = np.zeros(TRIED)
    lags = np.linspace(0.0, longest, TRIED)
    for piece in pieces:
        step = float(piece.t[1] - piece.t[0])
        for i, lag in enumerate(lags):
            north, east = _earth(piece, lag, body_axes)
            for velocity, place in ((north, piece.states[:, 0]), (east, piece.states[:, 1])):
                way = np.concatenate([[0.0], np.cumsum(0.5 * step * (velocity[1:] + velocity[:-1]))])
                error = (way - place)[: len(way) - _lost(longest, step)]
                whole = error[: len(error) // rows * rows].reshape(-1, rows)
                squares[i] += np.nansum((whole - whole.mean(axis=1, keepdims=True)) ** 2)
    return float(lags[np.argmin(squares)])


def without_lag(piece: Grid, lag: float, body_axes: float = 0.0) -> Grid:
    """The ``piece`` with velocities that are not late, without its last ``lag`` seconds; body_axes: of the filter."""
    if lag == 0:
        return piece
    states, psi = piece.states.copy(), np.unwrap(piece.states[:, 2])
    north, east = _earth(piece, lag, body_axes)
    states[:, 3], states[:, 4] = np.cos(psi) * north + np.sin(psi) * east, np.cos(psi) * east - np.sin(psi) * north
    rows = len(piece.t) - _lost(lag, float(piece.t[1] - piece.t[0]))
    return replace(piece, t=piece.t[:rows], states=states[:rows], controls=piece.controls[: rows - 1])


def _lost(lag: float, step: float) -> int:
    """Samples at the end whose velocity was logged after it."""
    return int(np.ceil(lag / step - 1e-9))


def _earth(piece: Grid, lag: float, body_axes: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity north and east (N,) that was logged ``lag`` [s] later, in the axes of the filter."""
    psi = np.unwrap(piece.states[:, 2])
    late = body_to_earth(piece.states[:, 3], piece.states[:, 4], (1 - body_axes) * psi)
    at = piece.t + lag
    x, y = (np.interp(at, piece.t, component) for component in late)
    return body_to_earth(x, y, body_axes * psi)

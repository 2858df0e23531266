"""What the measured velocities say of a ship's coefficients, as a linear system without any simulation.

The change of u, v, r since the beginning of a short window is the integral of the accelerations, which are linear in
the coefficients of a generated polynomial (nearly so in the added masses). The integrals are taken along the measured
motion, so no trajectory is simulated and nothing can run away. This is the integral form of equation-error regression
(Klein and Morelli 2006, ch. 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cases.trial import Trial
from fitting.nlp.grid import Grid, grids
from fitting.selection.late_velocities import AXES, LAG, likeliest_lag, without_lag
from mmg.errors import UserError
from mmg.model import assemble
from mmg.motion.froude import time_scale
from mmg.ship import Ship

WINDOW, STEP = 20.0, 0.5
"""Length of a window and sampling step [s of a 3 m model]."""
SMOOTHED, DEGREE = 7, 2
"""Samples and degree of the polynomial by which velocities are smoothed, where they enter the integrals only."""


@dataclass(frozen=True)
class Increments:
    """Changes of velocity in W windows of n samples, and what each of P coefficients would change of them.

    change: measured less predicted at the coefficients of the ship, (W, n, 3) [m/s, m/s, rad/s]; slope: d change / d
    coefficient (W, n, 3, P); step: between samples [s]; noise: white noise of the sensors, (3,); symbols: of the
    coefficients; lag: by which u and v were late [s], of a ship that has this effect.
    """

    change: np.ndarray
    slope: np.ndarray
    step: float
    noise: np.ndarray
    symbols: tuple[str, ...]
    lag: float = 0.0


def increments(ship: Ship, trials: Sequence[Trial]) -> Increments:
    """The system of the free coefficients of ``ship``, at their values, from the velocities of ``trials``.

    Raises UserError where no window has measured velocities throughout.
    """
    scale = time_scale(ship.particulars["L"])
    step = max(STEP * scale, min(t.dt for t in trials))
    pieces = [piece for t in trials for piece in grids(t, step, ship.inputs)]
    n = max(8, round(WINDOW * scale / step))
    lag, axes = _lag(ship, pieces, n), _body_axes(ship)
    pieces = [without_lag(piece, lag, axes) for piece in pieces]
    rates = _Rates(ship)
    change, slope, third = [], [], []
    for piece in pieces:
        velocity = piece.states[:, 3:6]
        if len(velocity) <= n:
            continue
        value, by = rates.between(piece)
        value = np.vstack([np.zeros((1, 3)), step * np.cumsum(value, axis=0)])
        by = np.concatenate([np.zeros((1, *by.shape[1:]), by.dtype), step * np.cumsum(by, axis=0)])
        third.append(np.diff(velocity, 3, axis=0))
        for first in range(0, len(velocity) - n, n):
            rows = slice(first, first + n)
            found = velocity[rows] - velocity[first] - value[rows] + value[first]
            if np.isfinite(found).all():
                change.append(found)
                slope.append(by[rows] - by[first])
    if not change:
        raise UserError(
            f"no stretch of {n * step:g} s with measured u, v, r in the {len(trials)} trials; a generated model needs "
            "some, of which its terms are estimated"
        )
    noise = np.sqrt(np.nanmean(np.vstack(third) ** 2, axis=0) / 20.0)  # (1, -3, 3, -1): sum of squares 20
    floor = 1e-4 * np.sqrt(np.mean(np.square(change), axis=(0, 1))) + 1e-12
    return Increments(np.array(change), np.array(slope), step, np.maximum(noise, floor), rates.symbols, lag)


def _lag(ship: Ship, pieces: Sequence[Grid], rows: int) -> float:
    """The lag [s] of the velocities of ``pieces`` if it is free in the ``ship``, else hers."""
    known = ship.coefficients.get(LAG)
    if known is None or known.fixed:
        return known.value if known else 0.0
    return likeliest_lag(pieces, known.upper, rows, _body_axes(ship))


def _body_axes(ship: Ship) -> float:
    """Whether her velocities are filtered in body axes."""
    return ship.coefficients[AXES].value if AXES in ship.coefficients else 0.0


class _Rates:
    """Accelerations of a ship and their derivatives to its free coefficients, along measured motions."""

    def __init__(self, ship: Ship) -> None:
        self.symbols, self._ship, model = tuple(ship.free), ship, assemble(ship)
        self._model, self._theta = model, np.array(ship.values)
        sizes = (len(model.states), len(model.controls), len(model.symbols))
        state, controls, theta = (ca.SX.sym(name, size) for name, size in zip("sct", sizes, strict=True))
        rates = model.rates(state, controls, theta)[3:6]
        free = ca.vertcat(*[theta[model.symbols.index(symbol)] for symbol in self.symbols])
        slope = ca.jacobian(rates, free)
        self._at = np.array(slope.sparsity().get_triplet(), dtype=int)
        both = [rates, ca.SX(slope.nz[:])]
        self._function = ca.Function("accelerations", [state, controls, theta], both, {"cse": True})

    def between(self, piece: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Mean accelerations over each step of a ``piece`` (N, 3) and their derivatives (N, 3, P)."""
        from scipy.signal import savgol_filter  # late: slow to import

        count, states = len(piece.controls), piece.states.copy()
        states[:, 2] = np.unwrap(states[:, 2])
        states[:, 3:6] = savgol_filter(states[:, 3:6], min(SMOOTHED, (count // 2) * 2 - 1), DEGREE, axis=0)
        states[:, :2] = np.nan_to_num(states[:, :2])
        value, slope = np.zeros((count, 3)), np.zeros((count, 3, len(self.symbols)))
        for rows in (slice(0, -1), slice(1, None)):
            start = self._model.initial(states[rows].T, piece.controls.T, self._theta)
            found, nonzero = self._function.map(count)(start, piece.controls.T, self._theta)
            value += 0.5 * np.array(found).T
            slope[:, self._at[0], self._at[1]] += 0.5 * np.array(nonzero).T
        return value, slope

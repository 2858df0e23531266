"""Coefficients of a generated polynomial from measured velocities, as a linear system without any simulation.

The change of u, v, r since the beginning of a short window is the integral of the accelerations, which are linear in
the coefficients (nearly so in the added masses). The integrals are taken along the measured motion, so no trajectory is
simulated and nothing can run away: the integral form of equation-error regression (Klein and Morelli 2006, ch. 5).
Velocities that are logged late (mmg/effects/velocity_filter.py) are put back first, by the lag in the kinematics.

The error of a velocity is white noise of the sensor and the integral of white noise in the acceleration, which stands
for what the polynomial cannot say: the longer a window lasts, the less its end counts. The ratio of the two is that of
largest likelihood, by channel. The sizes of the terms, which their prior only guesses, maximise the evidence (MacKay
1992): one size for all terms of a force, a degree and a sub-model, or one for each term, by which most of them vanish
(automatic relevance determination, Tipping 2001: sparse Bayesian learning).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.linalg import solve_triangular

from cases.evidence.kinematics import kinematics_of
from cases.trial import Trial
from fitting.nlp.windows import Record, pieces_of
from fitting.solvers.condensing import within_bounds
from mmg.components.expansion.words import parse_monomial
from mmg.errors import TooFewData
from mmg.model import assemble
from mmg.motion.frames import body_to_earth, earth_to_body
from mmg.motion.froude import time_scale
from mmg.ship import Ship

# Symbols, in a ship, of the lag [s] and of whether u and v are late in body axes (1) or in the earth frame (0).
LAG, AXES = "velocity_filter.tau", "velocity_filter.body_axes"
WINDOW = 20.0  # Length of a window [s of a 3 m model]. Set by hand.
STEP = 0.5  # Sampling step [s of a 3 m model]. Set by hand.
# Grid for the noise of accelerations [m/s by root of s] by that of velocities, of which the likeliest is taken.
RATIOS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5, 4.0, 7.0, 12.0, 20.0, 40.0)  # set by hand
LEAST_NOISE = 0.3  # Smallest variance of the velocities, by that of the third differences. Set by hand.
VANISHED = 1e4  # A term whose size came down to a hundredth of its prior, as a precision, is none. Set by hand.
STEPS = 30  # Most steps to the largest evidence with sizes of groups of terms. Set by hand.
SPARSE_STEPS = 120  # The same with sizes of single terms, of which most vanish slowly. Set by hand.
ROUNDS = 3  # Rounds between the sizes of the terms and the noise. Set by hand.


def without_lag(piece: Record, lag: float, body_axes: float) -> Record:
    """The ``piece`` with velocities that are not late, without its last ``lag`` seconds; body_axes: of the filter."""
    if lag == 0:
        return piece
    states, psi = piece.states.copy(), np.unwrap(piece.states[:, 2])
    # read the lag [s] later, in the axes of the filter: the frame turns in the meantime
    late = body_to_earth(piece.states[:, 3], piece.states[:, 4], (1 - body_axes) * psi)
    x, y = (np.interp(piece.t + lag, piece.t, component) for component in late)
    states[:, 3], states[:, 4] = earth_to_body(*body_to_earth(x, y, body_axes * psi), psi)
    lost = int(np.ceil(lag / float(piece.t[1] - piece.t[0]) - 1e-9))  # samples whose velocity was logged after the end
    rows = len(piece.t) - lost
    return replace(
        piece, t=piece.t[:rows], states=states[:rows], controls=piece.controls[: rows - 1], good=piece.good[:rows]
    )


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
    pieces = [piece.record for piece in pieces_of(trials, step, ship.inputs)]
    n = max(8, round(WINDOW * scale / step))
    lag, axes = _lag(ship, trials), ship.coefficients[AXES].value if AXES in ship.coefficients else 0.0
    pieces = [without_lag(piece, lag, axes) for piece in pieces]
    rates = _Rates(ship)
    change, slope, third = [], [], []
    for piece in pieces:
        velocity = piece.states[:, 3:6]
        if len(velocity) <= n:
            continue
        value, by = rates.between(piece)
        # integrals from the piece's beginning on
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
        raise TooFewData(
            f"no stretch of {n * step:g} s with measured u, v, r in the {len(trials)} trials; a generated model needs "
            "some, of which its terms are estimated"
        )
    noise = np.sqrt(np.nanmean(np.vstack(third) ** 2, axis=0) / 20.0)  # (1, -3, 3, -1): sum of squares 20
    floor = 1e-4 * np.sqrt(np.mean(np.square(change), axis=(0, 1))) + 1e-12  # exact data have no noise to divide by
    return Increments(np.array(change), np.array(slope), step, np.maximum(noise, floor), rates.symbols, lag)


def _lag(ship: Ship, trials: Sequence[Trial]) -> float:
    """The lag [s] of the velocities of ``trials`` against their positions if it is free in the ``ship``, else hers."""
    coefficient = ship.coefficients.get(LAG)
    if coefficient is None or coefficient.fixed:
        return coefficient.value if coefficient else 0.0
    seen = kinematics_of(trials, ship)
    lag = seen.pooled["lag"].value if seen else math.nan
    return float(np.clip(lag, 0.0, coefficient.upper)) if math.isfinite(lag) else 0.0


class _Rates:
    """Accelerations of a ship and their derivatives to its free coefficients, along measured motions."""

    def __init__(self, ship: Ship) -> None:
        self.symbols, model = tuple(ship.free), assemble(ship)
        self._model, self._theta = model, np.array(ship.values)
        sizes = (len(model.states), len(model.controls), len(model.symbols))
        state, controls, theta = (ca.SX.sym(name, size) for name, size in zip("sct", sizes, strict=True))
        rates = model.rates(state, controls, theta)[3:6]
        free = ca.vertcat(*[theta[model.symbols.index(symbol)] for symbol in self.symbols])
        slope = ca.jacobian(rates, free)
        self._at = np.array(slope.sparsity().get_triplet(), dtype=int)
        both = [rates, ca.SX(slope.nz[:])]
        self._function = ca.Function("accelerations", [state, controls, theta], both, {"cse": True})

    def between(self, piece: Record) -> tuple[np.ndarray, np.ndarray]:
        """Mean accelerations over each step of a ``piece`` (N, 3) and their derivatives (N, 3, P)."""
        from scipy.signal import savgol_filter  # late: slow to import

        count, states = len(piece.controls), piece.states.copy()
        states[:, 2] = np.unwrap(states[:, 2])

        states[:, 3:6] = savgol_filter(states[:, 3:6], min(7, (count // 2) * 2 - 1), 2, axis=0)
        states[:, :2] = np.nan_to_num(states[:, :2])
        value, slope = np.zeros((count, 3)), np.zeros((count, 3, len(self.symbols)))
        for rows in (slice(0, -1), slice(1, None)):  # begin and end of each step: the trapezoidal rule
            start = self._model.initial(states[rows].T, piece.controls.T, self._theta)
            found, nonzero = self._function.map(count)(start, piece.controls.T, self._theta)
            value += 0.5 * np.array(found).T
            slope[:, self._at[0], self._at[1]] += 0.5 * np.array(nonzero).T
        return value, slope


@dataclass(frozen=True)
class Regression:
    """What a regression found: value of each coefficient, the size of its prior, and those that vanished."""

    values: dict[str, float]
    sizes: dict[str, float]
    vanished: tuple[str, ...]

    def ship(self, ship: Ship) -> Ship:
        """``ship`` without the terms that vanished, its generated terms with their sizes as prior, still about 0."""
        rows = {
            s: replace(c, std=self.sizes[s], source=f"{c.source}, then by the evidence of the trials")
            if s in self.sizes
            else c
            for s, c in ship.coefficients.items()
            if s not in self.vanished
        }
        return replace(ship, coefficients=rows)


def regress(ship: Ship, system: Increments, sparse: bool = False) -> Regression:
    """The free coefficients of ``ship`` from the ``system`` of the same ones.

    sparse: one size for each generated term instead of one for each group; terms that vanish are left out.
    """
    rows = [ship.coefficients[s] for s in system.symbols]
    base, std = np.array([c.value for c in rows]), np.array([c.std for c in rows])
    lower, upper = np.array([c.lower for c in rows]), np.array([c.upper for c in rows])
    own = np.array([s in ship.monomials for s in system.symbols])
    groups = _groups(ship, system.symbols, sparse)
    P = len(std)
    # in prior standard deviations and in noise
    A, b = system.slope * std / system.noise[:, None], system.change / system.noise
    ratio, precision = np.ones(3), np.ones(P)
    p = np.zeros(P)
    for number in range(ROUNDS):
        last = number == ROUNDS - 1
        grams = [_whitened(A[:, :, i], b[:, :, i], ratio[i], system.step) for i in range(3)]
        steps = (SPARSE_STEPS if sparse else STEPS) if last else STEPS // 3
        p, precision, variance = _largest_evidence(grams, b.shape[0] * (b.shape[1] - 1), groups, own, steps)
        if not last:
            error = b - A @ p
            ratio = np.array([_likeliest(error[:, :, i], system.step) for i in range(3)])
    gone = own & (precision > VANISHED) if sparse else np.zeros(P, dtype=bool)
    H = sum(gram / s for (gram, _, _), s in zip(grams, variance, strict=True)) + np.diag(precision)
    g = sum(right / s for (_, right, _), s in zip(grams, variance, strict=True))
    kept = np.flatnonzero(~gone)
    p = np.zeros(P)
    p[kept] = within_bounds(H[np.ix_(kept, kept)], -g[kept], ((lower - base) / std)[kept], ((upper - base) / std)[kept])
    values = base + std * p
    values[[s == LAG for s in system.symbols]] = system.lag  # by the kinematics: ``without_lag`` took it out
    return Regression(
        {s: float(x) for s, x, out in zip(system.symbols, values, gone, strict=True) if not out},
        {s: float(k) for s, k, mine in zip(system.symbols, std / np.sqrt(precision), own & ~gone, strict=True) if mine},
        tuple(s for s, out in zip(system.symbols, gone, strict=True) if out),
    )


def _groups(ship: Ship, symbols: Sequence[str], sparse: bool) -> np.ndarray:
    """The group of each coefficient (P,), whose terms share one size."""
    keys: dict[object, int] = {}
    found = []
    for symbol in symbols:
        text = ship.monomials.get(symbol)
        term = parse_monomial(text) if text else None
        key = (symbol[0], len(term.factors), term.conditions) if term and not sparse else symbol
        found.append(keys.setdefault(key, len(keys)))
    return np.array(found)


def _factor(samples: int, ratio: float, step: float) -> np.ndarray:
    """Cholesky factor of the covariance in a window: white noise, that of accelerations by ``ratio``, a free level."""
    k = np.arange(samples)
    # a random walk by min(k, l); 1e4: the free level
    covariance = np.eye(samples) + ratio**2 * step * np.minimum.outer(k, k) + 1e4
    return np.linalg.cholesky(covariance)


def _whitened(A: np.ndarray, b: np.ndarray, ratio: float, step: float) -> tuple[np.ndarray, np.ndarray, float]:
    """A'A (P, P), A'b (P,) and b'b of one channel A (W, n, P), b (W, n) after its errors were made white."""
    W, n, P = A.shape
    both = np.concatenate([A, b[:, :, None]], axis=2).transpose(1, 0, 2).reshape(n, -1)
    white = solve_triangular(_factor(n, ratio, step), both, lower=True).reshape(n * W, P + 1)
    gram = white.T @ white
    return gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1])


def _likeliest(error: np.ndarray, step: float) -> float:
    """The ratio out of RATIOS under which errors (W, n) of one channel are likeliest."""
    W, n = error.shape
    best = (-np.inf, 0.0)
    for ratio in RATIOS:
        factor = _factor(n, ratio, step)
        squares = float((solve_triangular(factor, error.T, lower=True) ** 2).sum())
        count = W * (n - 1)
        variance = max(squares / count, LEAST_NOISE)  # profiled: its likeliest value
        value = -W * np.log(np.diag(factor)).sum() - 0.5 * count * np.log(variance) - 0.5 * squares / variance
        best = max(best, (float(value), ratio))
    return best[1]


def _largest_evidence(
    grams: Sequence[tuple[np.ndarray, np.ndarray, float]], count: int, groups: np.ndarray, own: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate (P,), precision of each prior (P,) and variance of each channel (3,) by MacKay's fixed point.

    grams: of each channel, from ``count`` samples; groups: whose terms share a precision (P,); own: terms whose
    precision is free (P,). A term that vanishes leaves the equations.
    """
    P = len(groups)
    precision, variance, p, used = np.ones(P), np.ones(3), np.zeros(P), np.arange(P)
    for _ in range(steps):
        H = sum(gram[np.ix_(used, used)] / s for (gram, _, _), s in zip(grams, variance, strict=True))
        g = sum(right[used] / s for (_, right, _), s in zip(grams, variance, strict=True))
        covariance = np.linalg.inv(H + np.diag(precision[used]))
        p = np.zeros(P)
        p[used] = covariance @ g
        for i, (gram, right, total) in enumerate(grams):
            squares = total - 2 * p @ right + p @ gram @ p
            # coefficients that this channel determines (MacKay 1992)
            determined = float((covariance * gram[np.ix_(used, used)]).sum()) / variance[i]
            variance[i] = max(squares / max(count - determined, 1.0), LEAST_NOISE)
        known, sizes = np.zeros(P), np.zeros(P)
        known[used] = 1 - precision[used] * np.diag(covariance)  # MacKay's gamma: how far the data determine each
        sizes[used] = p[used] ** 2
        top = groups.max() + 1
        shared = np.bincount(groups, known, top) / np.maximum(np.bincount(groups, sizes, top), 1e-12)
        precision = np.where(own, np.clip(shared[groups], 1e-4, 1e8), 1.0)
        precision[np.setdiff1d(np.arange(P), used)] = 1e8  # it stays out
        used = np.flatnonzero(precision < 1e7)  # a size of 3e-4 of the prior: gone
    return p, precision, variance

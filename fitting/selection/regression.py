"""Coefficients of a generated polynomial by regression on ``increments``: Bayesian, with sizes by the evidence.

The error of a velocity is white noise of the sensor and the integral of white noise in the acceleration, which stands
for what the polynomial cannot say: the longer a window lasts, the less its end counts. The ratio of the two is that of
largest likelihood, by channel. The sizes of the terms, which their prior only guesses, maximise the evidence (MacKay
1992): one size for all terms of a force, a degree and a sub-model, or one for each term, by which most of them vanish
(automatic relevance determination, Tipping 2001: sparse Bayesian learning).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from fitting.selection.increments import Increments
from fitting.selection.late_velocities import LAG
from mmg.components.expansion.words import parse_monomial
from mmg.ship import Ship

RATIOS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5, 4.0, 7.0, 12.0, 20.0, 40.0)
"""Noise of the accelerations [m/s by root of s] by that of the velocities, of which the likeliest is taken."""
LEAST_NOISE = 0.3
"""Smallest variance of the velocities, by that of the third differences."""
VANISHED = 1e4
"""A term whose size came down to a hundredth of its prior, as a precision, is none."""
STEPS, SPARSE_STEPS, ROUNDS = 30, 120, 3
"""Steps to the largest evidence with sizes of groups and of single terms; rounds between these and the noise."""


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
    H = sum(gram / s for (gram, _, _), s in zip(grams, variance, strict=True))
    g = sum(right / s for (_, right, _), s in zip(grams, variance, strict=True))
    p = _bounded(H, g, precision, np.where(gone, 0.0, (lower - base) / std), np.where(gone, 0.0, (upper - base) / std))
    values = base + std * p
    values[[s == LAG for s in system.symbols]] = system.lag
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
        variance = max(squares / count, LEAST_NOISE)
        value = -W * np.log(np.diag(factor)).sum() - 0.5 * count * np.log(variance) - 0.5 * squares / variance
        best = max(best, (float(value), ratio))
    return best[1]


def _largest_evidence(
    grams: Sequence[tuple[np.ndarray, np.ndarray, float]],
    count: int,
    groups: np.ndarray,
    own: np.ndarray,
    steps: int,
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
            determined = float((covariance * gram[np.ix_(used, used)]).sum()) / variance[i]
            variance[i] = max(squares / max(count - determined, 1.0), LEAST_NOISE)
        known, sizes = np.zeros(P), np.zeros(P)
        known[used] = 1 - precision[used] * np.diag(covariance)
        sizes[used] = p[used] ** 2
        top = groups.max() + 1
        shared = np.bincount(groups, known, top) / np.maximum(np.bincount(groups, sizes, top), 1e-12)
        precision = np.where(own, np.clip(shared[groups], 1e-4, 1e8), 1.0)
        precision[np.setdiff1d(np.arange(P), used)] = 1e8
        used = np.flatnonzero(precision < 1e7)
    return p, precision, variance


def _bounded(H: np.ndarray, g: np.ndarray, precision: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Minimum of 1/2 p'(H + precision)p - g'p; what lies outside its bounds is put on them and the others follow."""
    p, free = np.clip(np.zeros(len(g)), lower, upper), lower < upper
    full = H + np.diag(precision)
    for _ in range(10):
        rest = np.flatnonzero(free)
        fixed = np.flatnonzero(~free)
        p[rest] = np.linalg.solve(full[np.ix_(rest, rest)], g[rest] - full[np.ix_(rest, fixed)] @ p[fixed])
        outside = free & ((p < lower) | (p > upper))
        p = np.clip(p, lower, upper)
        if not outside.any():
            break
        free &= ~outside
    return p

"""Ships drawn about one: her coefficients from their standard errors, within their bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mmg.errors import Missing
from mmg.ship import Ship

ROUNDS = 5  # In which draws beyond bounds are put on them; what is beyond then is clipped alone. Set by hand.


def draw_coefficients(
    ship: Ship, count: int, seed: int = 0, correlation: tuple[Sequence[str], np.ndarray] | None = None
) -> dict[str, np.ndarray]:
    """Coefficients drawn from normal distributions about the ``ship``'s values, symbol -> (count,).

    Their standard deviations are those of the ship (fixed ones stay). count: draws; seed: of the draws; correlation:
    symbols (Q,) and matrix (Q, Q) of the estimates, None for independent ones. Draws beyond a bound are put on it, and
    those correlated with them follow by their regression on them.
    Raises UserError when no coefficient of the ship has a standard deviation.
    """
    free = [s for s in ship.free if 0 < ship.coefficients[s].std < math.inf]
    if not free:
        raise Missing(f"{ship.name}: no coefficient has a standard deviation; give std in the ship file, or a fit")
    matrix = np.eye(len(free))
    if correlation is not None:
        index = {symbol: i for i, symbol in enumerate(correlation[0])}
        rows = [(i, index[s]) for i, s in enumerate(free) if s in index]
        here, there = (list(part) for part in zip(*rows, strict=True)) if rows else ([], [])
        matrix[np.ix_(here, here)] = np.nan_to_num(np.asarray(correlation[1], dtype=float)[np.ix_(there, there)])
        np.fill_diagonal(matrix, 1.0)
    # a root by eigenvalues: with correlations that are not known set to zero the matrix may have negative ones
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = root @ np.random.default_rng([21, seed]).standard_normal((len(free), count))
    drawn = [ship.coefficients[s] for s in free]
    value, std = (np.array([getattr(c, name) for c in drawn], dtype=float)[:, None] for name in ("value", "std"))
    lower, upper = (np.array([getattr(c, name) for c in drawn], dtype=float)[:, None] for name in ("lower", "upper"))
    inside = _within(draws, (lower - value) / std, (upper - value) / std, root @ root.T)
    return dict(zip(free, np.clip(value + std * inside, lower, upper), strict=True))


def _within(draws: np.ndarray, lower: np.ndarray, upper: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Draws (Q, count) of unit variance and correlation ``matrix`` with those beyond bounds (Q, 1) put on them. The
    others move to their expectation given that: by the regression on those that are held."""
    bounded = np.zeros(draws.shape, dtype=bool)
    target = draws
    for _ in range(ROUNDS):
        beyond = (target < lower - 1e-9) | (target > upper + 1e-9)
        if not beyond.any():
            break
        bounded |= beyond
        target = target.copy()
        for m in np.flatnonzero(beyond.any(axis=0)):
            k = np.flatnonzero(bounded[:, m])
            ends = np.clip(draws[k, m], lower[k, 0], upper[k, 0])
            # conditional mean of a normal law, given those on their bounds
            gain = np.linalg.solve(matrix[np.ix_(k, k)] + 1e-9 * np.eye(len(k)), ends - draws[k, m])
            target[:, m] = draws[:, m] + matrix[:, k] @ gain
            target[k, m] = ends
    return np.clip(target, lower, upper)

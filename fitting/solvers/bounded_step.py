"""A Newton step that respects bounds."""

from __future__ import annotations

import numpy as np


def bounded_step(
    hessian: np.ndarray, slope: np.ndarray, p: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """The minimum d (P,) of slope d + 1/2 d hessian d with lower <= p + d <= upper, by holding those that would leave.

    hessian: (P, P), positive definite; slope, p, lower, upper: (P,) each. (An active set that only grows.)
    """
    d, held = np.zeros(len(p)), np.zeros(len(p), dtype=bool)
    for _ in range(len(p)):
        free = ~held
        d[free] = np.linalg.solve(hessian[np.ix_(free, free)], -slope[free] - hessian[np.ix_(free, held)] @ d[held])
        leaving = free & ((p + d < lower - 1e-12) | (p + d > upper + 1e-12))
        if not leaving.any():
            break
        d[leaving] = np.clip(p + d, lower, upper)[leaving] - p[leaving]
        held |= leaving
    return d

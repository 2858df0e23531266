"""How much more the slopes of a likelihood vary than its information says, where residuals are correlated in time."""

from __future__ import annotations

import numpy as np

from mmg.motion.froude import time_scale

MEMORY = 5.0
"""Time [s of a 3 m model] over which residuals may be correlated."""


def memory_steps(length: float, h: float) -> int:
    """Steps of h [s] of that time for a ship of this ``length`` [m]."""
    return max(1, round(MEMORY * time_scale(length) / h))


def dispersion(
    columns: np.ndarray, white: np.ndarray, g: np.ndarray, S: np.ndarray, lags: int, rows: np.ndarray | None = None
) -> float:
    """Variance of the slopes g (c,) of some columns over their information S (c, c), in the mean, at least 1.

    columns: (K + 1, R, 6, c) whitened, free parameters projected out; white: (K + 1, R, 6) negative residual; lags:
    steps over which residuals may be correlated; rows: (k,) grid times of which alone columns and residual are given,
    which are zero at all others. The variance is that of Newey & West (1987), about what the columns
    explain.
    """
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    kept = values > 1e-6 * max(values.max(), 1e-300)
    if not kept.any():
        return 1.0
    root = vectors[:, kept] / np.sqrt(values[kept])
    along = columns @ root
    size = (root.T @ g) * values[kept] / (1 + values[kept])
    each = np.einsum("krca,krc->kra", along, white + along @ size)
    if rows is not None:
        given, each = each, np.zeros((rows[-1] + 1, *each.shape[1:]))
        each[rows] = given
    lags = min(lags, len(each) - 1)
    weight = 1 - np.arange(1, lags + 1) / (lags + 1)
    covariances = [(each[lag:] * each[:-lag]).sum() for lag in range(1, lags + 1)]
    return max(1.0, float(((each**2).sum() + 2 * weight @ covariances) / kept.sum()))

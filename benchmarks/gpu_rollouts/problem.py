"""The rollouts that are timed: 4,096 trajectories of ESSO OSAKA with a network of two layers of 32."""

from __future__ import annotations

import numpy as np

BATCH, STEPS, H, WIDTH = 4096, 100, 0.2, 32
SCALES = np.array([0.5, 0.2, 0.1, 10.0, 0.5, 1.0, 1.0]), np.array([0.01, 0.01, 0.01])
"""Of the features and of the accelerations."""
NAMES = ("W1", "b1", "W2", "b2", "W3", "b3")


def drawn(points: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start (6, M), inputs (N, 4, M) and wanted columns (N, 6, M) of M ``points``, by ``seed``."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=(6, points)) * [[0], [0], [1], [0.1], [0.05], [0.02]]
    start[3] += 0.4
    controls = rng.normal(size=(STEPS, 4, points)) * [[1], [0.3], [1], [1]]
    controls[:, 0] += 10.0
    return start, controls, 0.1 * rng.normal(size=(STEPS, 6, points))

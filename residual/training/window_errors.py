"""How well systems predict windows that judge them, one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from residual.rollout import RolloutBatch, rollout, squares
from residual.system import TrainableSystem
from residual.training.folds import WINDOW
from residual.training.pieces import Piece
from residual.training.windows import windows

STRIDE, RESTART = 15.0, 100.0
"""Seconds between the starts of stop and judged windows; length of the restarts of the second metric."""


def compare_errors(
    systems: tuple[TrainableSystem, TrainableSystem], pieces: Sequence[Piece], h: float, sigma: np.ndarray, method: str
) -> tuple[np.ndarray, tuple[float, float], tuple[float, float]]:
    """Errors of two ``systems`` on 30 s windows every 15 s and on 100 s windows side by side.

    pieces: on a grid of h [s]; sigma: (6,) by which errors are divided; method: of the integration. Returns the rows of
    the 30 s windows (run, first row of its piece, error of each system), and the mean errors (30 s windows, 100 s
    restarts; NaN where none fits) of the first and of the second system.
    """
    past, scale = systems[0].past, torch.as_tensor(sigma)
    errors = []
    for length, stride in ((WINDOW, STRIDE), (RESTART, RESTART)):
        batch = windows(pieces, h, round(length / h), round(stride / h), past)
        errors.append(np.array([window_errors(s, batch, scale, method) if batch else [] for s in systems]))
    counts = [len(range(p.first + past, p.last - round(WINDOW / h) + 1, round(STRIDE / h))) for p in pieces]
    where = np.repeat(np.array([(p.run, p.first) for p in pieces]).reshape(-1, 2), counts, axis=0)
    (a, b), (c, d) = (e.mean(axis=1).tolist() if e.size else (np.nan, np.nan) for e in errors)
    return np.column_stack([where, errors[0].T]), (a, c), (b, d)


@torch.no_grad()
def window_errors(system: TrainableSystem, batch: RolloutBatch, sigma: torch.Tensor, method: str) -> np.ndarray:
    """Mean squared normalised error of ``system`` on each window of ``batch`` (M,), on the grid.

    sigma: (6,) by which errors are divided; method: of the integration.
    """
    return squares(rollout(system, batch, method), batch, sigma).numpy()

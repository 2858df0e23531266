"""Windows to train on: slices of the pieces of trials, noise added to them.

Slicing and jittering follow Wakita et al. (2024, sections 3.1 to 3.4): a window of I rows every I (ref) or every S rows
(sli), and normal noise of the instruments on the states (jit).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import torch

from residual.rollout import RolloutBatch
from residual.system import Past
from residual.training.pieces import Piece


def windows(pieces: Sequence[Piece], h: float, steps: int, stride: int, past: int = 0) -> RolloutBatch | None:
    """Slices of ``steps`` steps of ``h`` [s] every ``stride`` rows of each of ``pieces``; None where none fits.

    None reaches out of its piece; ``past`` rows before each start, inside the piece, are given along.
    """
    starts = [(p.grid, k) for p in pieces for k in range(p.first + past, p.last - steps + 1, stride)]
    if not starts:
        return None
    targets = _stacked(g.states[k : k + steps + 1] for g, k in starts)
    before = None
    if past:
        before = Past(*(_stacked(getattr(g, name)[k - past : k] for g, k in starts) for name in ("states", "controls")))
    return RolloutBatch(
        h,
        _stacked(g.controls[k : k + steps] for g, k in starts),
        torch.nan_to_num(targets),
        torch.isfinite(targets).double(),
        before,
    )


def _stacked(rows: Iterable[np.ndarray]) -> torch.Tensor:
    """Rows (N, C) of M windows side by side, (N, C, M)."""
    return torch.as_tensor(np.stack(list(rows), axis=2), dtype=torch.float64)


def jittered(batch: RolloutBatch, noise: torch.Tensor, draw: torch.Generator) -> RolloutBatch:
    """The ``batch`` with independent normal noise on its states (Wakita et al. 2024, Eq. 20).

    noise: (6,) standard deviations; draw: the random numbers.
    """

    def noisy(states: torch.Tensor) -> torch.Tensor:
        return torch.randn(states.shape, generator=draw, dtype=torch.float64) * noise[:, None]

    targets, past = batch.targets + noisy(batch.targets) * batch.mask, batch.past
    return replace(batch, targets=targets, past=past and Past(past.logged + noisy(past.logged), past.controls))

"""Trials as windows to train on: pieces on a grid, blocks of time, slices of them, noise added to them.

Slicing and jittering follow Wakita et al. (2024, sections 3.1 to 3.4): a window of I rows every I (ref) or every S rows
(sli), and normal noise of the instruments on the states (jit).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch

from cases.inputs import step_means
from cases.trial import Trial
from fitting.nlp.grid import Grid, grids
from residual.rollout import RolloutBatch
from residual.system import Past


@dataclass(frozen=True)
class Piece:
    """A stretch of one run on the grid, rows ``first`` .. ``last`` (inclusive) of it."""

    run: int
    grid: Grid
    first: int
    last: int

    @property
    def steps(self) -> int:
        return self.last - self.first


def pieces_of(
    trials: Sequence[Trial], h: float, inputs: Sequence[str], means: Callable[..., np.ndarray] = step_means
) -> list[Piece]:
    """The gap-free pieces of ``trials`` on a grid of ``h`` [s] with these ``inputs``, numbered by their run.

    means: how samples of the inputs (N, C) become means over steps, as of ``fitting.nlp.grid.grids``.
    """
    return [Piece(i, g, 0, len(g.controls)) for i, trial in enumerate(trials) for g in grids(trial, h, inputs, means)]


def blocks(pieces: Sequence[Piece], seconds: float, h: float) -> list[Piece]:
    """``pieces`` on a grid of ``h`` [s] cut evenly into blocks of about ``seconds`` that share only their end rows."""
    result = []
    for piece in pieces:
        parts = max(1, round(piece.steps * h / seconds))
        edges = piece.first + np.linspace(0, piece.steps, parts + 1).round().astype(int)
        result += [Piece(piece.run, piece.grid, a, b) for a, b in pairwise(edges.tolist())]
    return result


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

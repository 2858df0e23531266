"""Trials as windows to train on: pieces on a grid, blocks of time, slices of them, noise added to them.

Slicing and jittering follow Wakita et al. (2024, sections 3.1 to 3.4): a window of I rows every I (ref) or every S rows
(sli), and normal noise of the instruments on the states (jit).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch

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


def pieces_of(trials: Sequence[Trial], h: float, inputs: Sequence[str]) -> list[Piece]:
    """The gap-free pieces of ``trials`` on a grid of ``h`` [s] with these ``inputs``, numbered by their run."""
    return [Piece(i, g, 0, len(g.controls)) for i, trial in enumerate(trials) for g in grids(trial, h, inputs)]


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
    controls, targets, before, held = [], [], [], []
    for piece in pieces:
        grid = piece.grid
        for k in range(piece.first + past, piece.last - steps + 1, stride):
            controls.append(grid.controls[k : k + steps])
            targets.append(grid.states[k : k + steps + 1])
            before.append(grid.states[k - past : k])
            held.append(grid.controls[k - past : k])
    if not controls:
        return None
    measured = np.moveaxis(np.array(targets), 0, 2)
    return RolloutBatch(
        h,
        _tensor(np.moveaxis(np.array(controls), 0, 2)),
        _tensor(np.nan_to_num(measured)),
        _tensor(np.isfinite(measured).astype(float)),
        Past(_tensor(np.moveaxis(np.array(before), 0, 2)), _tensor(np.moveaxis(np.array(held), 0, 2)))
        if past
        else None,
    )


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(np.ascontiguousarray(values, dtype=float))


def jittered(batch: RolloutBatch, noise: torch.Tensor, draw: torch.Generator) -> RolloutBatch:
    """The ``batch`` with independent normal noise on its states (Wakita et al. 2024, Eq. 20).

    noise: (6,) standard deviations; draw: the random numbers.
    """
    added = torch.randn(batch.targets.shape, generator=draw, dtype=torch.float64) * noise[:, None] * batch.mask
    past = batch.past
    if past is not None:
        more = torch.randn(past.logged.shape, generator=draw, dtype=torch.float64) * noise[:, None]
        past = Past(past.logged + more, past.controls)
    return RolloutBatch(batch.h, batch.controls, batch.targets + added, batch.mask, past)

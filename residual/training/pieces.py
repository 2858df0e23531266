"""Trials as gap-free pieces on a grid, and blocks of time of them. Needs no torch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cases.inputs import step_means
from cases.trial import Trial
from fitting.nlp.grid import Grid, grids


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

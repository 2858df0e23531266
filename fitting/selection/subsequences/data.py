"""Trials cut into contiguous subsequences, each of which is simulated from its first measured state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.trial import Trial
from fitting.nlp.grid import grids
from mmg.errors import UserError

VELOCITIES = slice(3, 6)
"""Rows of u, v and r among x, y, psi, u, v, r: the states that the objective compares."""


@dataclass(frozen=True)
class Subsequences:
    """W subsequences of up to N steps of h [s].

    start: (6, W) measured x, y, psi, u, v, r at their beginning, position 0; controls: (N, C, W) mean inputs over each
    step; measured: (N, 3, W) u, v, r at the end of each step, 0 where there is none; weight: (N, W) 1 where there is
    one, 0 after the end of a shorter subsequence.
    """

    h: float
    start: np.ndarray
    controls: np.ndarray
    measured: np.ndarray
    weight: np.ndarray

    @property
    def count(self) -> int:
        """W."""
        return self.start.shape[1]

    @property
    def samples(self) -> float:
        """Number of samples compared, each of three velocities."""
        return float(self.weight.sum())


def subsequences(trials: Sequence[Trial], h: float, length: float, inputs: Sequence[str]) -> Subsequences:
    """The subsequences of ``length`` [s] of ``trials`` on steps of h [s], for a model with these ``inputs``.

    Each piece without gaps is cut from its beginning on; what is left at its end is a shorter one. Raises UserError
    where no piece has ten steps, or one step is longer than a subsequence.
    """
    N = round(length / h)
    if N < 1:
        raise UserError(f"subsequences of {length:g} s are shorter than one step of {h:g} s; use a smaller --step")
    starts, controls, measured, weights = [], [], [], []
    for trial in trials:
        for grid in grids(trial, h, inputs):
            total = len(grid.controls)
            for first in range(0, total if total >= min(10, N) else 0, N):
                rows = np.arange(first, first + N)
                there = rows < total
                rows = np.minimum(rows, total - 1)
                starts.append(np.concatenate([[0.0, 0.0], grid.states[first, 2:]]))
                controls.append(grid.controls[rows])
                measured.append(np.where(there[:, None], grid.states[rows + 1, VELOCITIES], 0.0))
                weights.append(there)
    if not starts:
        names = ", ".join(t.name for t in trials)
        raise UserError(f"{names}: no piece without gaps has ten steps of {h:g} s; use longer records")
    return Subsequences(
        h,
        np.transpose(starts),
        np.ascontiguousarray(np.transpose(controls, (1, 2, 0))),
        np.ascontiguousarray(np.transpose(measured, (1, 2, 0))),
        np.transpose(weights).astype(float),
    )


def spread_of(trials: Sequence[Trial]) -> np.ndarray:
    """Standard deviations (3,) of u, v [m/s] and r [rad/s] over ``trials``, by which errors are divided.

    Raises UserError for a velocity that never changes.
    """
    sigma = np.array([np.nanstd(np.concatenate([t[name] for t in trials])) for name in ("u", "v", "r")])
    still = [name for name, value in zip("uvr", sigma, strict=True) if not value > 0]
    if still:
        raise UserError(f"{', '.join(t.name for t in trials)}: {', '.join(still)} never changes; give trials that move")
    return sigma

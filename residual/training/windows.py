"""Trials as windows to train on: slices on a grid, blocks of time, scales, noise for jittering.

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
from mmg.errors import UserError
from mmg.model import Model, states_behind
from mmg.motion.froude import length_scale
from residual.rollout import Batch
from residual.system import Past

POSITION, HEADING = 1.0, 0.3
"""Sigma of the loss for x, y [m] per 3 m of ship and for psi [rad]; those of u, v, r are taken from the data."""


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
    """The gap-free pieces of trials on a grid of h [s], numbered by their run."""
    return [Piece(i, g, 0, len(g.controls)) for i, trial in enumerate(trials) for g in grids(trial, h, inputs)]


def blocks(pieces: Sequence[Piece], seconds: float, h: float) -> list[Piece]:
    """Pieces cut evenly into blocks of about ``seconds`` that share only their end rows."""
    result = []
    for piece in pieces:
        parts = max(1, round(piece.steps * h / seconds))
        edges = piece.first + np.linspace(0, piece.steps, parts + 1).round().astype(int)
        result += [Piece(piece.run, piece.grid, a, b) for a, b in pairwise(edges.tolist())]
    return result


def windows(pieces: Sequence[Piece], h: float, steps: int, stride: int, past: int = 0) -> Batch | None:
    """Slices of ``steps`` steps every ``stride`` rows of each piece, none reaching out of it; None where none fits.

    ``past`` rows before each start, inside the piece, are given along.
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
    return Batch(
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


def jittered(batch: Batch, noise: torch.Tensor, draw: torch.Generator) -> Batch:
    """The batch with independent normal noise of standard deviation ``noise`` (6,) on its states (2024, Eq. 20)."""
    added = torch.randn(batch.targets.shape, generator=draw, dtype=torch.float64) * noise[:, None] * batch.mask
    past = batch.past
    if past is not None:
        more = torch.randn(past.logged.shape, generator=draw, dtype=torch.float64) * noise[:, None]
        past = Past(past.logged + more, past.controls)
    return Batch(batch.h, batch.controls, batch.targets + added, batch.mask, past)


def loss_sigma(pieces: Sequence[Piece], length: float) -> np.ndarray:
    """Sigma of the loss (6,): a third of a ship length, 0.3 rad, and the standard deviation of each velocity.

    The whole spread of positions over a pond would make a window's drift invisible (notes of issue 5).
    """
    velocities = np.vstack([p.grid.states[p.first : p.last + 1, 3:] for p in pieces])
    spread = np.nanstd(velocities, axis=0)
    if not (spread > 0).all():
        raise UserError("u, v or r never changes in the training trials, so there is nothing to learn from")
    position = POSITION * length_scale(length)
    return np.array([position, position, HEADING, *spread])


def features_of(model: Model, pieces: Sequence[Piece]) -> np.ndarray:
    """What a network on the ship sees at the measured rows of pieces, (F, rows)."""
    values = np.array([model.ship.coefficients[s].value for s in model.symbols])
    parts = []
    for p in pieces:
        logged, controls = p.grid.states[p.first : p.last].T, p.grid.controls[p.first : p.last].T
        states = states_behind(model, np.nan_to_num(logged), controls, values)
        parts.append(np.array(model.features(states, controls, values)))
    return np.hstack(parts)

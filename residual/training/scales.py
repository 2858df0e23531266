"""What is known of the training data before training: scales of networks and losses, noise of the instruments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cases.checks.motion import white_noise
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma
from mmg.errors import UserError
from mmg.motion.froude import length_scale
from mmg.ship import Ship
from residual.rollout import measured_accelerations
from residual.training.pieces import Piece
from residual.training.windows import windows

POSITION, HEADING = 1.0, 0.3
"""Sigma of the loss for x, y [m] per 3 m of ship and for psi [rad]; those of u, v, r are taken from the data."""
LEAST_SCALE = 1e-9
"""Scale of what never changes in the training rows."""


@dataclass(frozen=True)
class Scales:
    """What is known of the training data before training.

    feature (F,), output (3,): scales of a network; mean, std (F,): of its features; sigma (6,): of the loss; score
    (6,): of stop and judged windows; acceleration, acceleration_mean (3,): deviation, as of Eq. 16, and mean of the
    measured accelerations; noise (6,): of the instruments, for jittering; features (F, R): of the training rows.
    """

    feature: np.ndarray
    output: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    sigma: np.ndarray
    score: np.ndarray
    acceleration: np.ndarray
    acceleration_mean: np.ndarray
    noise: np.ndarray
    features: np.ndarray


def training_scales(
    ship: Ship,
    pieces: Sequence[Piece],
    trials: Sequence[Trial],
    h: float,
    features_at: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
) -> Scales:
    """Scales of the measured rows of ``pieces``, which are those of ``trials`` of ``ship`` on a grid of ``h`` [s].

    features_at: (logged columns (6, M), inputs (C, M)) -> what the network is fed (F, M). Its output is scaled by the
    deviation of the measured accelerations (Wakita et al. 2025, Eq. 14). Raises UserError where there are no rows, or
    nothing moves in them.
    """
    rows = windows(pieces, h, 1, 1)
    if rows is None:
        raise UserError("too little data to train on: no piece of a trial is longer than a step without a gap")
    measured, mask = measured_accelerations(rows)
    known = measured[0].numpy()[:, mask[0].numpy().all(axis=0)]
    states = [p.grid.states[p.first : p.last + 1] for p in pieces]
    sigma = _loss_sigma(states, ship.particulars["L"])
    placed = [t for t in trials if t.has_position]
    features = features_at(rows.targets[0], rows.controls[0]).numpy()
    rms, std = np.sqrt((features**2).mean(axis=1)), features.std(axis=1)
    acceleration = np.maximum(known.std(axis=1), LEAST_SCALE)
    return Scales(
        feature=np.where(rms > LEAST_SCALE, rms, 1.0),
        output=acceleration,
        mean=features.mean(axis=1),
        std=np.where(std > LEAST_SCALE, std, 1.0),
        sigma=sigma,
        score=pooled_sigma(placed) if placed else sigma,
        acceleration=acceleration,
        acceleration_mean=known.mean(axis=1),
        noise=white_noise(states),
        features=features,
    )


def _loss_sigma(states: Sequence[np.ndarray], length: float) -> np.ndarray:
    """Sigma of the loss (6,): a third of a ship length, 0.3 rad, and the standard deviation of each velocity.

    The deviation of positions over a whole pond would make the drift of a window invisible.
    """
    std = np.nanstd(np.vstack(states)[:, 3:], axis=0)
    if not (std > 0).all():
        raise UserError("u, v or r never changes in the training trials, so there is nothing to learn from")
    position = POSITION * length_scale(length)
    return np.array([position, position, HEADING, *std])

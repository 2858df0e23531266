"""What is known of the training data before training: scales of networks and losses, noise of the instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.checks.noise import white_noise
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma
from mmg.errors import UserError
from mmg.motion.froude import length_scale
from residual.rollout import RolloutBatch, measured_accelerations
from residual.training.windows import Piece, windows

POSITION, HEADING = 1.0, 0.3
"""Sigma of the loss for x, y [m] per 3 m of ship and for psi [rad]; those of u, v, r are taken from the data."""
LEAST_SCALE = 1e-9
"""Scale of what never changes in the training rows."""


@dataclass(frozen=True)
class Scales:
    """What is known of the training data before training.

    feature (F,), output (3,): scales of the network; sigma (6,): of the loss; score (6,): of stop and judged windows;
    acceleration (3,): of Eq. 16; noise (6,): of the instruments, for jittering; features (F, R): of the training rows.
    """

    feature: np.ndarray
    output: np.ndarray
    sigma: np.ndarray
    score: np.ndarray
    acceleration: np.ndarray
    noise: np.ndarray
    features: np.ndarray


@dataclass(frozen=True)
class MeasuredScales:
    """What every network needs of the training rows.

    rows: each row with its successor as a window of one step; mean, std (3,): of the measured accelerations; sigma,
    score, noise (6,): as in ``Scales``.
    """

    rows: RolloutBatch
    mean: np.ndarray
    std: np.ndarray
    sigma: np.ndarray
    score: np.ndarray
    noise: np.ndarray


def measured_scales(pieces: Sequence[Piece], trials: Sequence[Trial], h: float, length: float) -> MeasuredScales:
    """Scales of the measured columns of ``pieces``, which are those of ``trials`` on a grid of ``h`` [s].

    length: of the ship [m]. Raises UserError where there are no rows, or nothing moves in them.
    """
    rows = windows(pieces, h, 1, 1)
    if rows is None:
        raise UserError("too little data to train on: no piece of a trial is longer than a step without a gap")
    measured, mask = measured_accelerations(rows)
    known = measured[0].numpy()[:, mask[0].numpy().all(axis=0)]
    states = [p.grid.states[p.first : p.last + 1] for p in pieces]
    sigma = _loss_sigma(states, length)
    placed = [t for t in trials if t.has_position]
    score = pooled_sigma(placed) if placed else sigma
    std = np.maximum(known.std(axis=1), LEAST_SCALE)
    return MeasuredScales(rows, known.mean(axis=1), std, sigma, score, white_noise(states))


def _loss_sigma(states: Sequence[np.ndarray], length: float) -> np.ndarray:
    """Sigma of the loss (6,): a third of a ship length, 0.3 rad, and the standard deviation of each velocity.

    The deviation of positions over a whole pond would make the drift of a window invisible.
    """
    std = np.nanstd(np.vstack(states)[:, 3:], axis=0)
    if not (std > 0).all():
        raise UserError("u, v or r never changes in the training trials, so there is nothing to learn from")
    position = POSITION * length_scale(length)
    return np.array([position, position, HEADING, *std])

"""A residual on a calibrated ship as something to train: the untrained hybrid, its scales, the mean network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import torch

from cases.trial import Trial
from mmg.network import Network
from mmg.ship import Ship
from residual.bounded_network import Residual, Symmetric, TwoLayers, to_network
from residual.physics.operator import Physics
from residual.settings import TrainSettings
from residual.system import Hybrid
from residual.training.pieces import Piece
from residual.training.scales import LEAST_SCALE, Scales, training_scales
from residual.training.tasks import ModelKind
from residual.training.trainer import Outcome, Task, restored
from residual.training.windows import windows

OUTPUT = 0.3
"""Scale of the residual as a share of the rms accelerations of the ship on the training rows."""


def build_hybrid(ship: Ship, scales: Scales, settings: TrainSettings, seed: int) -> Hybrid:
    """A calibrated ``ship`` with a residual of these ``scales``, ``settings`` and ``seed`` that is still zero."""
    width = max(1, settings.width // 2) if settings.symmetric else settings.width
    own = Residual(scales.feature, scales.output, width, seed)
    residual: TwoLayers = Symmetric(own, ship.actuators) if settings.symmetric else own
    return Hybrid(Physics(ship), residual, scales.features)


def hybrid_scales(ship: Ship, pieces: Sequence[Piece], trials: Sequence[Trial], h: float) -> Scales:
    """Scales for a residual on ``ship`` from ``pieces`` of ``trials`` on a grid of ``h`` [s].

    Raises UserError where there are no rows, or nothing moves in them.
    """
    physics = Physics(ship)
    scales, rows = training_scales(ship, pieces, trials, h, physics.logged_features), windows(pieces, h, 1, 1)
    assert rows is not None
    logged, controls = rows.targets[0], rows.controls[0]
    with torch.no_grad():
        rates = physics.rates(physics.start(logged, controls), controls)[3:6].numpy()
    return replace(scales, output=OUTPUT * np.sqrt((rates**2).mean(axis=1)) + LEAST_SCALE)


HYBRID_KIND = ModelKind(
    build_hybrid, hybrid_scales, lambda ship: ship.inputs, lambda ship: Physics(ship).logged_features
)
"""A residual on a ship without a network."""


def network_of(task: Task, outcomes: Sequence[Outcome]) -> Network | None:
    """The mean of the residuals that trainings like ``task`` ended with, with the range of the training rows.

    outcomes: of the seeds. None where all diverged.
    """
    residuals = [cast(Hybrid, system).residual for system in restored(task, outcomes)]
    if not residuals:
        return None
    features = task.scales.features
    return to_network(residuals, task.ship.actuators, features.min(axis=1), features.max(axis=1))

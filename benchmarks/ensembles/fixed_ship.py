"""A ship as it is beside trained systems."""

from __future__ import annotations

import torch

from mmg.ship import Ship
from residual.physics.operator import Physics
from residual.system import TrainableSystem


class FixedShip(TrainableSystem):
    """A ship as it is, its network included, as a system: nothing to train."""

    def __init__(self, ship: Ship, physics: Physics | None = None) -> None:
        super().__init__()
        self.physics = physics or Physics(ship)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: object = None) -> torch.Tensor:
        return self.physics.start(logged, controls)

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return self.physics.rates(z, controls)

    def columns(self, z: torch.Tensor) -> torch.Tensor:
        return self.physics.columns(z)

"""A linear ship that only yaws, shared by the tests of ensembles."""

from __future__ import annotations

import torch

from residual.system import TrainableSystem


class Yaw(TrainableSystem):
    """A ship that only yaws: dr/dt = (K delta - r) / T, surging at constant speed; inputs n, delta, air."""

    def __init__(self, K: float, T: float) -> None:
        super().__init__()
        self.K, self.T = K, T

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        zero = torch.zeros_like(z[0])
        turn = (self.K * controls[1] - z[5]) / self.T
        return torch.stack([z[3], zero, z[5], zero, zero, turn])


INPUTS = ("n", "delta", "wind_north", "wind_east")

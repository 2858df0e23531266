"""The feedforward network of Wakita et al. (2024, Eq. 2 to 5; 2025, Eq. 9 to 14) as a dynamic model."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from torch import nn

from residual.networks.features import features, kinematics
from residual.system import TrainableSystem

SAMPLES = 10_000
"""Standard normal inputs at which the output of the untrained network is standardised (2025, Eq. 13)."""


def layered(sizes: tuple[int, ...], seed: int) -> nn.Sequential:
    """Linear layers of these ``sizes`` with tanh between, initialised by ``seed`` as PyTorch does (2025, 3.3)."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        linear = [nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes)]
    parts: list[nn.Module] = []
    for layer in linear:
        parts += [layer, nn.Tanh()]
    return nn.Sequential(*parts[:-1])


class Feedforward(TrainableSystem):
    """Accelerations from standardised features by a network whose output is standardised as well.

    s = (features - mean) / std; y = net(s), standardised by the mean and deviation of the untrained net at standard
    normal inputs; acceleration = mean + std * y of the measured accelerations. zero: what it gives at the origin of
    the features is subtracted, so that a ship at rest in calm air stays there (2022, section 2.1).

    mean, std: of the features (F,); acceleration_mean, acceleration_std: of the measured accelerations (3,).
    """

    mean: torch.Tensor
    std: torch.Tensor
    a_mean: torch.Tensor
    a_std: torch.Tensor
    y_mean: torch.Tensor
    y_std: torch.Tensor

    def __init__(
        self,
        mean: np.ndarray,
        std: np.ndarray,
        acceleration_mean: np.ndarray,
        acceleration_std: np.ndarray,
        width: int = 32,
        layers: int = 2,
        zero: bool = True,
        seed: int = 0,
    ) -> None:
        super().__init__()
        F, self.zero = len(mean), zero
        self.net = layered((F, *(width,) * layers, 3), seed)
        for name, value in (("mean", mean), ("std", std), ("a_mean", acceleration_mean), ("a_std", acceleration_std)):
            self.register_buffer(name, torch.as_tensor(np.array(value, dtype=float))[:, None])
        with torch.no_grad():
            y = self.net(torch.randn(SAMPLES, F, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))
        self.register_buffer("y_mean", y.mean(dim=0)[:, None])
        self.register_buffer("y_std", y.std(dim=0)[:, None])

    def output(self, values: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M), before anything is subtracted."""
        y = self.net(((values - self.mean) / self.std).T).T
        return self.a_mean + self.a_std * (y - self.y_mean) / self.y_std

    def acceleration(self, values: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M)."""
        if not self.zero:
            return self.output(values)
        both = self.output(torch.cat([values, torch.zeros_like(values[:, :1])], dim=1))
        return both[:, :-1] - both[:, -1:]

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return torch.cat([kinematics(z), self.acceleration(features(z, controls))])

    def penalty(self) -> torch.Tensor:
        """Sum of squared weights (2024, Eq. 11)."""
        return squared_weights(self)


def squared_weights(system: nn.Module) -> torch.Tensor:
    """Sum of squares of the weight matrices (out, in) of ``system``, a scalar."""
    return torch.stack([(p**2).sum() for p in system.parameters() if p.ndim == 2]).sum()

"""A network that estimates the state at the start of a rollout from measured rows: Wakita et al. (2025), Eq. 21, 22."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from residual.networks.features import features
from residual.networks.feedforward import layered
from residual.system import Past, TrainableSystem


class InitialState(TrainableSystem):
    """Any system, started from estimated u, v, r instead of the measured ones.

    The estimate is the measured velocity plus reach * tanh(net(standardised features of the start and of ``rows`` rows
    before it)): never further than reach (3,) from the measurement, and equal to it before training. The paper reads
    the first rows of the window itself; a prediction may not, so here the rows before it are read.
    """

    mean: torch.Tensor
    std: torch.Tensor
    reach: torch.Tensor

    def __init__(
        self,
        inner: TrainableSystem,
        rows: int,
        mean: np.ndarray,
        std: np.ndarray,
        reach: np.ndarray,
        width: int = 32,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.inner, self.rows = inner, rows
        self.past = max(rows, inner.past)
        self.net = layered((len(mean) * (rows + 1), width, 3), seed)
        last = self.net[-1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        for name, value in (("mean", mean), ("std", std), ("reach", reach)):
            self.register_buffer(name, torch.as_tensor(np.array(value, dtype=float))[:, None])

    def shift(self, logged: torch.Tensor, controls: torch.Tensor, past: Past) -> torch.Tensor:
        """Estimated less measured u, v, r (3, M)."""
        before = zip(past.logged[-self.rows :], past.controls[-self.rows :], strict=True)
        values = torch.cat([(features(*row) - self.mean) / self.std for row in (*before, (logged, controls))])
        return self.reach * torch.tanh(self.net(values.T).T)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        if past is None:
            raise ValueError("the estimate of the initial state needs the rows before the start")
        z = self.inner.start(logged, controls, past.latest(self.inner.past))
        return torch.cat([z[:3], z[3:6] + self.shift(logged, controls, past), z[6:]])

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return self.inner.rates(z, controls)

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        return self.inner.step(z, controls, h, method)

    def columns(self, z: torch.Tensor) -> torch.Tensor:
        return self.inner.columns(z)

    def accelerations(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        return self.inner.accelerations(logged, controls, past and past.latest(self.inner.past))

    def penalty(self) -> torch.Tensor:
        return self.inner.penalty()

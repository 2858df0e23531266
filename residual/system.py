"""What every trainable dynamic model answers to: start, rates or step, logged columns, penalty.

All tensors are float64 and hold one trajectory per column, as in ``mmg.rollout``: states (Z, M), inputs (C, M), logged
columns (6, M). A model that remembers puts what it remembers into the rows of its state.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from mmg.runge_kutta import rk4_step
from residual.bounded_network import TwoLayers
from residual.physics.fused_rollout import FusedRollout


class Past(NamedTuple):
    """Grid rows before a start, oldest first: logged columns (P, 6, M), inputs (P, C, M) over the steps after them."""

    logged: torch.Tensor
    controls: torch.Tensor

    def latest(self, rows: int) -> Past | None:
        """Only its last ``rows``; None for 0."""
        return Past(self.logged[-rows:], self.controls[-rows:]) if rows else None


class TrainableSystem(nn.Module):
    """A trainable right-hand side. Give ``start``, ``rates`` (or ``step``), and what differs of the rest.

    past: grid rows before its start that ``start`` reads, 0 for one without memory.
    """

    past: int = 0

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        """State (Z, M) behind logged columns (6, M) under inputs (C, M); ``past`` is given where self.past > 0."""
        return logged

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        """d state / dt (Z, M) of states (Z, M) under inputs (C, M), SI."""
        raise NotImplementedError

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """State (Z, M) a step of h [s] later, inputs held: one Runge-Kutta (rk4) or Euler step of ``rates``."""
        if method == "euler":
            return z + h * self.rates(z, controls)
        return rk4_step(lambda state, _: self.rates(state, controls), z, h)

    def simulate(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """States (N + 1, Z, M) from z (Z, M) under inputs (N, C, M): one ``step`` after the other."""
        states = [z]
        for held in controls:
            states.append(self.step(states[-1], held, h, method))
        return torch.stack(states)

    def columns(self, z: torch.Tensor) -> torch.Tensor:
        """The six columns as they are logged, (6, M), of states (Z, M)."""
        return z[:6]

    def accelerations(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        """Rates of u, v, r (N, 3, M) at measured rows (N, 6, M) under inputs (N, C, M), for the loss of Eq. 16.

        ``past`` holds the rows before the first one. A model that remembers overrides this (Eq. 13, 14 and 15).
        """
        N, _, M = logged.shape
        rows, inputs = logged.transpose(0, 1).reshape(6, N * M), controls.transpose(0, 1).reshape(-1, N * M)
        return self.rates(self.start(rows, inputs), inputs)[3:6].reshape(3, N, M).transpose(0, 1)

    def penalty(self) -> torch.Tensor:
        """What its size costs, a scalar; times ``TrainSettings.penalty`` beside the loss."""
        return torch.zeros((), dtype=torch.float64)

    def learned(self) -> list[nn.Parameter]:
        """The parameters that training changes."""
        return [p for p in self.parameters() if p.requires_grad]


class Hybrid(TrainableSystem):
    """A calibrated ship and a residual acceleration of its u, v, r.

    physics: ``residual.physics.operator.Physics`` of the ship; residual: the network; features: (F, R) of the training
    rows, on which its size is penalised.
    """

    features: torch.Tensor

    def __init__(self, physics: Any, residual: TwoLayers, features: np.ndarray) -> None:
        super().__init__()
        self.physics, self.residual = physics, residual
        self.fused = FusedRollout(physics, len(residual.b1))
        self.register_buffer("features", torch.as_tensor(np.ascontiguousarray(features, dtype=float)), persistent=False)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        return self.physics.start(logged, controls)

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        rates, features = self.physics.rates_and_features(z, controls)
        return torch.cat([rates[:3], rates[3:6] + self.residual(features), rates[6:]])

    def columns(self, z: torch.Tensor) -> torch.Tensor:
        return self.physics.columns(z)

    def simulate(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """As of any system, as one compiled loop where there is a compiler."""
        if self.fused.library is None:
            return super().simulate(z, controls, h, method)
        return self.fused(z, controls, h, self.residual, method)

    def penalty(self) -> torch.Tensor:
        """Mean of (residual / its scale)^2 over the training rows and components."""
        return ((self.residual(self.features) / self.residual.scale[:, None]) ** 2).mean()

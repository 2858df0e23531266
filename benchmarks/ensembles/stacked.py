"""A whole ensemble of hybrids as one system, for devices on which many small networks are one large product.

Columns hold the windows of one member after the other; weights have the member as their first axis, so that a gradient
step of all members costs one rollout. On processors, members as processes with the fused kernel are the faster way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn

from residual.bounded_network import TwoLayers
from residual.physics.operator import Physics
from residual.rollout import RolloutBatch, rollout, squares
from residual.system import Past, TrainableSystem

LAYERS = ("W1", "W2", "W3", "b1", "b2")


class Stacked(TrainableSystem):
    """Members of a hybrid ensemble on one physics; states (Z, E M), one member's windows after the other's.

    physics: a ``TorchPhysics`` works on the device and in the type of its tensors; move the rest by ``.to``.
    members: E residuals of the same scales; they are trained in place.
    """

    def __init__(self, physics: Physics, members: Sequence[TwoLayers]) -> None:
        super().__init__()
        self.physics, self.members = physics, nn.ModuleList(members)
        self._held: tuple[Tensor, ...] | None = None

    def weights(self) -> tuple[Tensor, ...]:
        """W1 (E, H, F), W2 (E, H, H), W3 (E, 3, H), b1, b2 (E, H, 1)."""
        W1, W2, W3, b1, b2 = (torch.stack([getattr(m, name) for m in self.members]) for name in LAYERS)
        return W1, W2, W3, b1[:, :, None], b2[:, :, None]

    def accelerate(self, features: Tensor) -> Tensor:
        """Accelerations (3, E M) at features (F, E M)."""
        F, columns = features.shape
        W1, W2, W3, b1, b2 = self._held or self.weights()
        first = cast(TwoLayers, self.members[0])
        x = (features / first.feature_scale[:, None]).reshape(F, len(W1), -1).transpose(0, 1)
        h1 = torch.tanh(torch.baddbmm(b1, W1, x)) - torch.tanh(b1)
        h2 = torch.tanh(torch.baddbmm(b2, W2, h1)) - torch.tanh(b2)
        return (first.scale[:, None] * torch.bmm(W3, h2)).transpose(0, 1).reshape(3, columns)

    def start(self, logged: Tensor, controls: Tensor, past: Past | None = None) -> Tensor:
        return self.physics.start(logged, controls)

    def rates(self, z: Tensor, controls: Tensor) -> Tensor:
        rates, features = self.physics.rates_and_features(z, controls)
        return torch.cat([rates[:3], rates[3:6] + self.accelerate(features), rates[6:]])

    def simulate(self, z: Tensor, controls: Tensor, h: float, method: str = "rk4") -> Tensor:
        """As of any system; the weights are stacked once for the whole rollout."""
        self._held = self.weights()
        try:
            return super().simulate(z, controls, h, method)
        finally:
            self._held = None

    def columns(self, z: Tensor) -> Tensor:
        return self.physics.columns(z)


def on(batch: RolloutBatch, members: int, device: str = "cpu", dtype: torch.dtype = torch.float64) -> RolloutBatch:
    """The windows once for each member, on a device."""

    def moved(a: Tensor) -> Tensor:
        return a.to(device, dtype).repeat(1, 1, members)

    return RolloutBatch(batch.h, moved(batch.controls), moved(batch.targets), moved(batch.mask))


def losses(system: Stacked, batch: RolloutBatch, sigma: Tensor, method: str = "rk4") -> Tensor:
    """State loss (Eq. 23) of each member (E,), of a batch made by ``on``; their sum has the gradients of all."""
    each = squares(rollout(system, batch, method), batch, sigma)
    return each.reshape(len(system.members), -1).mean(dim=1)

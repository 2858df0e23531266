"""Simulation inside the loss: rollouts of many windows at once; losses of Wakita et al. (2022), Eq. 16 and 23."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from residual.system import Past, TrainableSystem


@dataclass(frozen=True)
class RolloutBatch:
    """M windows of N steps of h [s] as float64 tensors.

    controls: (N, C, M), the mean over each step; targets: (N + 1, 6, M) logged columns on the grid, the first row the
    start, 0 where not measured; mask: of the same shape, 0 there and 1 elsewhere. past: rows before the start.
    """

    h: float
    controls: torch.Tensor
    targets: torch.Tensor
    mask: torch.Tensor
    past: Past | None = None

    def __len__(self) -> int:
        return self.controls.shape[2]

    def chosen(self, which: torch.Tensor) -> RolloutBatch:
        """Only these windows (numbers)."""
        past = Past(*(a[..., which] for a in self.past)) if self.past else None
        controls, targets, mask = (a[..., which] for a in (self.controls, self.targets, self.mask))
        return RolloutBatch(self.h, controls, targets, mask, past)


def rollout(system: TrainableSystem, batch: RolloutBatch, method: str = "rk4") -> torch.Tensor:
    """Logged columns (N + 1, 6, M) of the windows of ``batch`` simulated by ``system`` from their measured start.

    method: "rk4" or "euler".
    """
    start = system.start(batch.targets[0], batch.controls[0], batch.past)
    every = system.simulate(start, batch.controls, batch.h, method).transpose(0, 1)
    Z, rows, M = every.shape
    return system.columns(every.reshape(Z, rows * M)).reshape(6, rows, M).transpose(0, 1)


def squares(predicted: torch.Tensor, batch: RolloutBatch, sigma: torch.Tensor) -> torch.Tensor:
    """Mean over the rows after the start of squared normalised errors, summed over the six columns: (M,), as Eq. 23.

    predicted: columns (N + 1, 6, M) of the windows of ``batch``; sigma: (6,). A column that was not measured counts
    nothing; heading errors are taken as they are, since both headings are continuous from the same start.
    """
    error = (predicted[1:] - batch.targets[1:]) * batch.mask[1:] / sigma[:, None]
    return (error**2).sum(dim=1).mean(dim=0)


def state_loss(system: TrainableSystem, batch: RolloutBatch, sigma: torch.Tensor, method: str = "rk4") -> torch.Tensor:
    """Eq. 23: mean over rows and windows of ``batch`` of squared errors of the columns of ``system``.

    sigma: (6,) by which errors are divided; method: "rk4" or "euler".
    """
    return squares(rollout(system, batch, method), batch, sigma).mean()


def measured_accelerations(batch: RolloutBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """Forward differences of the logged u, v, r of ``batch`` (N, 3, M) and where both rows were measured."""
    velocities, mask = batch.targets[:, 3:], batch.mask[:, 3:]
    return (velocities[1:] - velocities[:-1]) / batch.h, mask[1:] * mask[:-1]


def acceleration_loss(system: TrainableSystem, batch: RolloutBatch, sigma: torch.Tensor) -> torch.Tensor:
    """Eq. 16: mean over rows and windows of ``batch`` of squared errors of accelerations of ``system``.

    sigma: (3,) by which errors are divided.
    """
    measured, mask = measured_accelerations(batch)
    predicted = system.accelerations(batch.targets[:-1], batch.controls, batch.past)
    error = (predicted - measured) * mask / sigma[:, None]
    return (error**2).sum(dim=1).mean()

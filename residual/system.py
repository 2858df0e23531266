"""What every trainable dynamic model answers to, rollouts of many windows at once, and the losses.

All tensors are float64 and hold one trajectory per column, as in ``mmg.rollout``: states (Z, M), inputs (C, M), logged
columns (6, M). A model that remembers puts what it remembers into the rows of its state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.autograd.function import once_differentiable

from fitting.nlp.loss import Loss
from mmg.runge_kutta import rk4_step


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

    past: int = 0  # a class default: most systems have no memory

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        """State (Z, M) behind logged columns (6, M) under inputs (C, M); ``past`` is given where self.past > 0."""
        return logged

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        """d state / dt (Z, M) of states (Z, M) under inputs (C, M), SI."""
        raise NotImplementedError

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """State (Z, M) a step of h [s] later, inputs held: one Runge-Kutta (rk4) or Euler step of ``rates``."""
        if method == "euler":
            return z + h * self.rates(z, controls)  # for the published networks, which are defined by Euler steps
        return rk4_step(lambda state, _: self.rates(state, controls), z, h)

    def simulate(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """States (N + 1, Z, M) from z (Z, M) under inputs (N, C, M): one ``step`` after the other."""
        states = [z]
        for inputs in controls:  # (C, M), held over the step
            states.append(self.step(states[-1], inputs, h, method))
        return torch.stack(states)

    def columns(self, z: torch.Tensor, controls: torch.Tensor | None = None) -> torch.Tensor:
        """The six columns as they are logged, (6, M), of states (Z, M) under inputs (C, M).

        Only instruments whose values are among the inputs read these.
        """
        return z[:6]

    def accelerations(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        """Rates of u, v, r (N, 3, M) at measured rows (N, 6, M) under inputs (N, C, M), for the loss of Eq. 16.

        ``past`` holds the rows before the first one. A model that remembers overrides this (Eq. 13, 14 and 15).
        """
        N, _, M = logged.shape
        # all rows as points side by side: one call instead of N
        rows, inputs = logged.transpose(0, 1).reshape(6, N * M), controls.transpose(0, 1).reshape(-1, N * M)
        return self.rates(self.start(rows, inputs), inputs)[3:6].reshape(3, N, M).transpose(0, 1)

    def penalty(self) -> torch.Tensor:
        """What its size costs, a scalar, times ``TrainSettings.penalty`` beside the loss: the sum of squared weights
        (Wakita et al. 2024, Eq. 11)."""
        # weights are the parameters with two axes; biases cost nothing
        return sum(((p**2).sum() for p in self.parameters() if p.ndim == 2), torch.zeros((), dtype=torch.float64))


@dataclass(frozen=True)
class RolloutBatch:
    """M windows of N steps of h [s] as float64 tensors.

    controls: (N, C, M), the mean over each step; targets: (N + 1, 6, M) logged columns on the grid, the first row the
    start, 0 where not measured; mask: of the same shape, 0 there and 1 elsewhere, or the weights of a calibration.
    past: rows before the start; states: (Z, M) to start from instead of what is behind the first row.
    """

    h: float
    controls: torch.Tensor
    targets: torch.Tensor
    mask: torch.Tensor
    past: Past | None = None
    states: torch.Tensor | None = None

    def __len__(self) -> int:
        return self.controls.shape[2]

    def chosen(self, which: torch.Tensor) -> RolloutBatch:
        """Only these windows (numbers)."""
        past = Past(*(a[..., which] for a in self.past)) if self.past else None
        controls, targets, mask = (a[..., which] for a in (self.controls, self.targets, self.mask))
        states = None if self.states is None else self.states[:, which]
        return RolloutBatch(self.h, controls, targets, mask, past, states)


def rollout(system: TrainableSystem, batch: RolloutBatch, method: str = "rk4") -> torch.Tensor:
    """Logged columns (N + 1, 6, M) of the windows of ``batch`` simulated by ``system`` from their start.

    method: "rk4" or "euler".
    """
    start = batch.states
    if start is None:
        start = system.start(batch.targets[0], batch.controls[0], batch.past)
    # columns are made of all rows at once, as points: measurement has no memory beyond the state
    every = system.simulate(start, batch.controls, batch.h, method).transpose(0, 1)
    Z, rows, M = every.shape
    inputs = batch.controls[0].repeat(1, rows)
    return system.columns(every.reshape(Z, rows * M), inputs).reshape(6, rows, M).transpose(0, 1)


def normalised_errors(predicted: torch.Tensor, batch: RolloutBatch, sigma: torch.Tensor) -> torch.Tensor:
    """Errors (N, 6, M) of the columns ``predicted`` (N + 1, 6, M) in the windows of ``batch``, over ``sigma`` (6,).

    A column that was not measured counts nothing; heading errors are taken as they are, since both headings are
    continuous from the same start.
    """
    # without row 0, which is the start and has no error
    return (predicted[1:] - batch.targets[1:]) * batch.mask[1:] / sigma[:, None]


def squares(predicted: torch.Tensor, batch: RolloutBatch, sigma: torch.Tensor) -> torch.Tensor:
    """Mean over the rows after the start of squared ``normalised_errors``, summed over the six columns: (M,), as Eq.
    23. predicted: (N + 1, 6, M); batch, sigma (6,): as of those."""
    return (normalised_errors(predicted, batch, sigma) ** 2).sum(dim=1).mean(dim=0)


def state_loss(system: TrainableSystem, batch: RolloutBatch, sigma: torch.Tensor, method: str = "rk4") -> torch.Tensor:
    """Eq. 23: mean over rows and windows of ``batch`` of squared errors of the columns of ``system``.

    sigma: (6,) by which errors are divided; method: "rk4" or "euler".
    """
    return squares(rollout(system, batch, method), batch, sigma).mean()


def calibration_loss(system: TrainableSystem, batch: RolloutBatch, cost: Loss, method: str = "rk4") -> torch.Tensor:
    """Half the sum of the costs of the residuals of ``system`` on ``batch``, (): what samples have of an objective.

    The mask of the batch are the weights of a calibration (N + 1, 6, M); cost: of it; method: "rk4" or "euler".
    """
    return _Cost.apply(rollout(system, batch, method) - batch.targets, batch.mask, cost)


class _Cost(torch.autograd.Function):
    """The cost of a calibration in torch's graph, by its own functions of value and slope."""

    @staticmethod
    def forward(ctx: Any, error: torch.Tensor, weights: torch.Tensor, cost: Loss) -> torch.Tensor:
        e, w = error.numpy(), weights.numpy()
        e = np.where(w > 0, e, 0.0)  # beyond the end of a window a rollout may be no number
        ctx.slope = torch.from_numpy(cost.weight(w, e) * e)  # d (cost / 2) / d error, of every sample by itself
        return error.new_tensor(0.5 * cost.cost(w, e).sum())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, seed: torch.Tensor) -> tuple[Any, ...]:
        return seed * ctx.slope, None, None


def measured_accelerations(batch: RolloutBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """Forward differences of the logged u, v, r of ``batch`` (N, 3, M) and where both rows were measured."""
    velocities, mask = batch.targets[:, 3:], batch.mask[:, 3:]
    # forward, as an Euler step goes from one row to the next (Eq. 22)
    return (velocities[1:] - velocities[:-1]) / batch.h, mask[1:] * mask[:-1]


def acceleration_loss(system: TrainableSystem, batch: RolloutBatch, sigma: torch.Tensor) -> torch.Tensor:
    """Eq. 16: mean over rows and windows of ``batch`` of squared errors of accelerations of ``system``.

    sigma: (3,) by which errors are divided.
    """
    measured, mask = measured_accelerations(batch)
    predicted = system.accelerations(batch.targets[:-1], batch.controls, batch.past)
    error = (predicted - measured) * mask / sigma[:, None]
    return (error**2).sum(dim=1).mean()

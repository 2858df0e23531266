"""Training of one system from one seed: Adam on rollouts that grow, the best weights on the stop windows are kept.

Learning rate along a half cosine, gradients clipped, windows drawn anew in every epoch. What judges the result are
other windows, which the training never sees (``residual.training.folds``). A loss that is not finite, or a stop
error that
explodes, starts the training again at a lower rate, twice; then it is given up.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from fitting.interrupts import INTERRUPTED, Interrupts
from mmg.progress import OnProgress, Progress
from mmg.ship import Ship
from residual.rollout import Batch, acceleration_loss, state_loss
from residual.settings import TrainSettings
from residual.system import System
from residual.training.augmentation import SETS, augmented
from residual.training.window_errors import STRIDE, WINDOW, judge, window_errors
from residual.training.windows import Piece, jittered, windows

RESTARTS, LOWER = 2, 0.2
"""How often a diverged training starts again, and the factor on its learning rate."""


@dataclass(frozen=True)
class Scales:
    """What is known of the training data before training.

    feature (F,), output (3,): scales of the network; sigma (6,): of the loss; score (6,): of stop and judged windows;
    acceleration (3,): of Eq. 16; noise (6,): of the instruments, for jittering; seen (F, R): features of the rows.
    """

    feature: np.ndarray
    output: np.ndarray
    sigma: np.ndarray
    score: np.ndarray
    acceleration: np.ndarray
    noise: np.ndarray
    seen: np.ndarray


Build = Callable[[Ship, Scales, TrainSettings, int], System]
"""Makes the system of a seed; importable, so that it reaches other processes."""


@dataclass(frozen=True)
class Task:
    """One training. build(ship, scales, training, seed) makes the system and must be importable.

    train, held_out: pieces of trials on the grid of h [s], the latter to stop by; judge: those that judge, () where
    held_out also judges, which flatters; fold: number of the part that judges; seconds: limit of this one; stop: a
    file that ends it.
    """

    build: Build
    ship: Ship
    scales: Scales
    training: TrainSettings
    seed: int
    h: float
    train: tuple[Piece, ...]
    held_out: tuple[Piece, ...]
    seconds: float | None = None
    stop: Path | None = None
    judge: tuple[Piece, ...] = ()
    fold: int = 0


@dataclass(frozen=True)
class Outcome:
    """What a training ended with.

    status: "finished", "stopped" (limit or Ctrl-C: best weights so far) or "diverged". before, after: errors of the
    judged windows (30 s windows, 100 s restarts) of the untrained and of the best system; history: rows (epoch, length
    of rollouts [s], loss, error of the stop windows); state: name -> array of the best system's parameters; judged: the
    judged 30 s windows one by one, rows (run, first row of its piece, error before, error after); fold: of the task.
    """

    seed: int
    status: str
    before: tuple[float, float]
    after: tuple[float, float]
    history: tuple[tuple[int, float, float, float], ...]
    state: dict[str, np.ndarray] = field(repr=False)
    rate: float
    restarts: int
    seconds: float
    windows: int
    held_out_windows: int
    judged: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)), repr=False)
    fold: int = 0


class _Diverged(Exception):
    """The loss is not finite, or the held-out error exploded."""


def train_one(task: Task, progress: OnProgress | None = None) -> Outcome:
    """Train the system of a ``task``; never raises for a training that fails. progress: called after each epoch."""
    torch.set_num_threads(1)
    began, training = time.perf_counter(), task.training
    with Interrupts():
        for restart in range(RESTARTS + 1):
            rate = training.rate * LOWER**restart
            attempt = _Attempt(task, began, rate, progress)
            try:
                status = attempt.run()
                break
            except _Diverged:
                status = "diverged"
    attempt.system.load_state_dict(attempt.best, strict=False)
    systems = task.build(task.ship, task.scales, training, task.seed), attempt.system
    judged = judge(systems, task.judge or task.held_out, task.h, task.scales.score, training.method)
    return Outcome(
        task.seed,
        status,
        judged.before,
        judged.after,
        tuple(attempt.history),
        {name: value.numpy().copy() for name, value in attempt.best.items()},
        rate,
        restart,
        time.perf_counter() - began,
        attempt.count,
        len(judged.rows),
        judged.rows,
        task.fold,
    )


class _Attempt:
    """One attempt at one learning rate."""

    def __init__(self, task: Task, began: float, rate: float, progress: OnProgress | None) -> None:
        self.task, self.began, self.rate, self.progress = task, began, rate, progress
        t, h = task.training, task.h
        self.system = task.build(task.ship, task.scales, t, task.seed)
        self.sigma, self.score = (torch.as_tensor(a) for a in (task.scales.sigma, task.scales.score))
        self.draw = torch.Generator().manual_seed(task.seed)
        self.stages = stages(task)
        self.count = max((len(batch) for _, batch, _ in self.stages), default=0)
        held = windows(task.held_out, h, round(WINDOW / h), round(STRIDE / h), self.system.past)
        assert held is not None
        self.held, self.best = held, self._state()
        self.before = self.least = self._stop_error()
        self.history: list[tuple[int, float, float, float]] = [(0, 0.0, float("nan"), self.before)]

    def _state(self) -> dict[str, torch.Tensor]:
        return {name: p.detach().clone() for name, p in self.system.named_parameters()}

    def _stop_error(self) -> float:
        """Mean squared normalised error of the windows to stop by."""
        return float(window_errors(self.system, self.held, self.score, self.task.training.method).mean())

    def run(self) -> str:
        """Train through the stages; "finished" or "stopped"."""
        t = self.task.training
        optimizer = torch.optim.Adam(self.system.learned(), lr=self.rate)
        total = sum(epochs for _, _, epochs in self.stages)
        epoch, status = 0, "finished"
        for seconds, batch, epochs in self.stages:
            for _ in range(epochs):
                cosine = 0.5 * (1 + math.cos(math.pi * epoch / max(1, total)))
                for group in optimizer.param_groups:
                    group["lr"] = t.last_rate + (self.rate - t.last_rate) * cosine
                loss = self._epoch(optimizer, batch)
                epoch += 1
                self._keep(epoch, seconds, loss)
                if self.progress:
                    values = {"loss": loss, "error of 30 s windows": self.history[-1][3]}
                    self.progress(Progress(f"seed {self.task.seed}", epoch, total, values))
                if self._stopped():
                    status = "stopped"
                    break
            if status == "stopped":
                break
        return status

    def _epoch(self, optimizer: torch.optim.Optimizer, batch: Batch) -> float:
        """One pass over the windows in random order; mean loss."""
        t, scales = self.task.training, self.task.scales
        order = torch.randperm(len(batch), generator=self.draw)
        parts = order.tensor_split(max(1, round(len(batch) / t.batch)))
        losses = []
        for which in parts:
            some = batch.chosen(which)
            if t.jitter:
                some = jittered(some, t.jitter * torch.as_tensor(scales.noise), self.draw)
            optimizer.zero_grad()
            loss = self._loss(some)
            if not torch.isfinite(loss):
                raise _Diverged
            loss.backward()
            norm = torch.nn.utils.clip_grad_norm_(self.system.learned(), t.clip)
            if not torch.isfinite(norm):
                raise _Diverged
            optimizer.step()
            losses.append(float(loss.detach()))
            if self._stopped():
                break
        return float(np.mean(losses))

    def _loss(self, batch: Batch) -> torch.Tensor:
        t = self.task.training
        if t.loss == "acceleration":
            loss = acceleration_loss(self.system, batch, torch.as_tensor(self.task.scales.acceleration))
        else:
            loss = state_loss(self.system, batch, self.sigma, t.method)
        return loss + t.penalty * self.system.penalty() if t.penalty else loss

    @torch.no_grad()
    def _keep(self, epoch: int, seconds: float, loss: float) -> None:
        """Note the error of the stop windows and keep the weights if they are the best so far."""
        error = self._stop_error()
        self.history.append((epoch, seconds, loss, error))
        if not math.isfinite(error) or error > 100 * self.before + 1e-9:
            raise _Diverged
        if error < self.least:
            self.least, self.best = error, self._state()

    def _stopped(self) -> bool:
        task = self.task
        late = task.seconds is not None and time.perf_counter() - self.began > task.seconds
        return late or INTERRUPTED.requested or (task.stop is not None and task.stop.exists())


def stages(task: Task) -> list[tuple[float, Batch, int]]:
    """Length of the rollouts [s], windows and epochs of each stage of the curriculum for which windows fit."""
    t, h = task.training, task.h
    past = task.build(task.ship, task.scales, t, task.seed).past
    result = []
    for seconds, share in t.curriculum:
        if t.augment:
            noise = torch.as_tensor(task.scales.noise)
            batch = augmented(task.train, h, round(seconds / h), SETS[t.augment], noise, task.seed, past)
        else:
            batch = windows(task.train, h, max(1, round(seconds / h)), max(1, round(t.stride / h)), past)
        if batch is not None:
            result.append((seconds, batch, max(1, round(share * t.epochs))))
    return result

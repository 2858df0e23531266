"""Training of one system from one seed: Adam on rollouts that grow, the best weights on the stop windows are kept.

Learning rate along a half cosine, gradients clipped, windows drawn anew in every epoch. Where the penalty has several
weights, each goes on from where the one before ended, so that the stop windows choose the weight of the penalty as they
choose the epoch. What judges the result are other windows, which the training never sees (``residual.training.folds``):
they judge the choice as well. A loss that is not finite, or a stop error that explodes, starts the training again at a
lower rate, twice; then it is given up. Under a later weight it ends the training, and what was best stands.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from fitting.solvers.interrupts import INTERRUPTED, interrupts_noted
from mmg.progress import OnProgress, Progress
from mmg.ship import Ship
from residual.rollout import RolloutBatch, acceleration_loss, state_loss
from residual.settings import TrainSettings
from residual.system import TrainableSystem
from residual.training.adam import Adam
from residual.training.augmentation import SETS, augmented
from residual.training.folds import WINDOW, Split
from residual.training.scales import Scales
from residual.training.window_errors import STRIDE, compare_errors, window_errors
from residual.training.windows import jittered, windows

RESTARTS, LOWER = 2, 0.2
"""How often a diverged training starts again, and the factor on its learning rate."""
HORIZON, APART = 100, 15
"""Steps of the windows of a calibration (``fitting.settings.Settings.window``), and between their starts: they overlap
so that an epoch on them takes as long as one on windows of 30 steps every 5."""
Stage = tuple[float, RolloutBatch, int]
"""Length of rollouts [s], their windows, epochs."""
BuildSystem = Callable[[Ship, Scales, TrainSettings, int], TrainableSystem]
"""Makes the untrained system of a ship, scales, settings and a seed; importable, so that it reaches other processes."""


@dataclass(frozen=True)
class Task:
    """One training: build(ship, scales, settings, seed) makes the system, which trains, stops and is judged by
    ``split``. seconds: limit of this one; stop: a file that ends it.
    """

    build: BuildSystem
    ship: Ship
    scales: Scales
    settings: TrainSettings
    seed: int
    split: Split
    seconds: float | None = None
    stop: Path | None = None

    @property
    def h(self) -> float:
        """Step of grid and integration [s]."""
        assert self.settings.step is not None
        return self.settings.step

    def system(self) -> TrainableSystem:
        """The untrained system."""
        return self.build(self.ship, self.scales, self.settings, self.seed)


@dataclass(frozen=True)
class Outcome:
    """What a training ended with.

    status: "finished", "stopped" (limit or Ctrl-C: best weights so far) or "diverged". before, after: errors of the
    judged windows (30 s windows, 100 s restarts) of the untrained and of the best system; history: rows (epoch, length
    of rollouts [s], loss, error of the stop windows); state: name -> array of the best system's parameters; judged: the
    judged 30 s windows one by one, rows (run, first row of its piece, error before, error after); fold: of the task;
    path: per weight of the penalty the least error of the stop windows under it.
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
    path: tuple[tuple[float, float], ...] = ()

    @property
    def penalty(self) -> float | None:
        """The weight of the penalty under which the best system was found; None where that is the untrained one."""
        weight, least = min(self.path, key=lambda pair: pair[1], default=(None, math.inf))
        return weight if self.history and least < self.history[0][3] else None


class _Diverged(Exception):
    """The loss is not finite, or the held-out error exploded."""


def train_one(task: Task, progress: OnProgress | None = None) -> Outcome:
    """How the training of a ``task`` ended; a training that fails raises nothing. progress: called after each epoch."""
    torch.set_num_threads(1)
    began, settings = time.perf_counter(), task.settings
    with interrupts_noted():
        for restart in range(RESTARTS + 1):
            rate = settings.rate * LOWER**restart
            attempt = _Attempt(task, began, rate, progress)
            try:
                status = attempt.run()
                break
            except _Diverged:
                status = "diverged"
    attempt.system.load_state_dict(attempt.best, strict=False)
    systems = task.system(), attempt.system
    judged, before, after = compare_errors(systems, task.split.judge, task.h, task.scales.score, settings.method)
    return Outcome(
        seed=task.seed,
        status=status,
        before=before,
        after=after,
        history=tuple(attempt.history),
        state={name: value.numpy().copy() for name, value in attempt.best.items()},
        rate=rate,
        restarts=restart,
        seconds=time.perf_counter() - began,
        windows=attempt.count,
        held_out_windows=len(judged),
        judged=judged,
        fold=task.split.fold,
        path=tuple(attempt.path),
    )


class _Attempt:
    """One attempt at one learning rate."""

    def __init__(self, task: Task, began: float, rate: float, progress: OnProgress | None) -> None:
        self.task, self.began, self.rate, self.progress = task, began, rate, progress
        self.system = task.system()
        self.sigma, self.score = (torch.as_tensor(a) for a in (task.scales.sigma, task.scales.score))
        self.draw = torch.Generator().manual_seed(task.seed)
        self.stages = stages(task, self.system.past)
        self.later = later_stages(task, self.stages, self.system.past)
        self.count = max((len(batch) for _, batch, _ in self.stages), default=0)
        h = task.h
        held = windows(task.split.stop, h, round(WINDOW / h), round(STRIDE / h), self.system.past)
        assert held is not None
        self.held, self.best = held, self._state()
        self.before = self.least = self._stop_error()
        self.history: list[tuple[int, float, float, float]] = [(0, 0.0, float("nan"), self.before)]
        self.path: list[tuple[float, float]] = []

    def _state(self) -> dict[str, torch.Tensor]:
        return {name: p.detach().clone() for name, p in self.system.named_parameters()}

    def _stop_error(self) -> float:
        """Mean squared normalised error of the windows to stop by."""
        return float(window_errors(self.system, self.held, self.score, self.task.settings.method).mean())

    def run(self) -> str:
        """Train through the stages of each weight of the penalty; "finished" or "stopped"."""
        weights = self.task.settings.weights
        every = (self.stages, *[self.later] * (len(weights) - 1))
        plans = [[(seconds, batch) for seconds, batch, n in some for _ in range(n)] for some in every]
        for number, (weight, plan) in enumerate(zip(weights, plans, strict=True)):
            try:
                if not self._pass(plan, weight, sum(map(len, plans))):
                    return "stopped"
            except _Diverged:
                if not number:
                    raise
                break
        return "finished"

    def _pass(self, plan: Sequence[tuple[float, RolloutBatch]], weight: float, epochs: int) -> bool:
        """Train through a ``plan`` under a ``weight`` of the penalty, one of so many ``epochs`` in all; False where it
        was stopped."""
        t, optimizer = self.task.settings, Adam(self.system.learned(), self.rate)
        self.path.append((weight, math.inf))
        for done, (seconds, batch) in enumerate(plan):
            cosine = 0.5 * (1 + math.cos(math.pi * done / len(plan)))
            optimizer.rate = t.last_rate + (self.rate - t.last_rate) * cosine
            loss = self._epoch(optimizer, batch, weight)
            epoch = len(self.history)
            self._keep(epoch, seconds, loss)
            self.path[-1] = weight, min(self.path[-1][1], self.history[-1][3])
            if self.progress:
                values = {"loss": loss, "error of 30 s windows": self.history[-1][3]}
                self.progress(Progress(f"seed {self.task.seed}", epoch, epochs, values))
            if self._stopped():
                return False
        return True

    def _epoch(self, optimizer: Adam, batch: RolloutBatch, weight: float) -> float:
        """One pass over the windows in random order, under a ``weight`` of the penalty; mean loss."""
        t, scales = self.task.settings, self.task.scales
        parts = torch.randperm(len(batch), generator=self.draw).tensor_split(max(1, round(len(batch) / t.batch)))
        losses = []
        for which in parts:
            some = batch.chosen(which)
            if t.jitter:
                some = jittered(some, t.jitter * torch.as_tensor(scales.noise), self.draw)
            optimizer.zero_grad()
            loss = self._loss(some, weight)
            loss.backward()
            norm = torch.nn.utils.clip_grad_norm_(self.system.learned(), t.clip)
            if not torch.isfinite(loss) or not torch.isfinite(norm):
                raise _Diverged
            optimizer.step()
            losses.append(float(loss.detach()))
            if self._stopped():
                break
        return float(np.mean(losses))

    def _loss(self, batch: RolloutBatch, weight: float) -> torch.Tensor:
        t = self.task.settings
        if t.loss == "acceleration":
            loss = acceleration_loss(self.system, batch, torch.as_tensor(self.task.scales.acceleration))
        else:
            loss = state_loss(self.system, batch, self.sigma, t.method)
        return loss + weight * self.system.penalty() if weight else loss

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


def stages(task: Task, past: int) -> list[Stage]:
    """Length of the rollouts [s], windows and epochs of each stage of the curriculum of ``task`` for which windows fit.

    past: rows before each window that the system reads.
    """
    t, h = task.settings, task.h
    result = []
    for seconds, share in t.curriculum:
        if t.augment:
            how = SETS[t.augment], torch.as_tensor(task.scales.noise)
            batch = augmented(task.split.train, h, round(seconds / h), *how, task.seed, past)
        else:
            batch = windows(task.split.train, h, max(1, round(seconds / h)), max(1, round(t.stride / h)), past)
        if batch is not None:
            result.append((seconds, batch, max(1, round(share * t.epochs))))
    return result


def later_stages(task: Task, first: Sequence[Stage], past: int) -> list[Stage]:
    """The stages under each weight of the penalty of ``task`` but the first: the last of those under the ``first``,
    half of its epochs on windows as long as those of a calibration, where such fit.

    past: rows before each window that the system reads.
    """
    t, h = task.settings, task.h
    if len(t.weights) < 2 or not first:
        return []
    seconds, batch, epochs = first[-1]
    long = windows(task.split.train, h, HORIZON, max(round(t.stride / h), APART), past)
    if long is None or epochs < 2:
        return [first[-1]]
    return [(seconds, batch, epochs - epochs // 2), (HORIZON * h, long, epochs // 2)]


def restored(task: Task, outcomes: Sequence[Outcome]) -> list[TrainableSystem]:
    """The systems that trainings like ``task`` ended with, by their ``outcomes``; those that diverged are left out."""
    systems = []
    for o in outcomes:
        if o.status != "diverged":
            system = replace(task, seed=o.seed).system()
            system.load_state_dict({name: torch.as_tensor(a) for name, a in o.state.items()}, strict=False)
            systems.append(system)
    return systems

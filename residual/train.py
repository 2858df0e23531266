"""Training from several seeds: Adam on rollouts that grow, the best weights on the stop windows are kept.

Learning rate along a half cosine, gradients clipped, windows drawn anew in every epoch. What judges the result are
other windows, which the training never sees (``residual.splits``). A loss that is not finite, or a stop error that
explodes, starts the training again at a lower rate, twice; then it is given up. Finished seeds are kept as they
finish; ``--resume`` continues from them.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.optim.adam import adam

from cases.trial import Trial
from fitting.nlp.windows import Stretch, default_step, pieces_of
from fitting.parallel import run_all, width
from fitting.prediction.score import WINDOW
from fitting.report.run_folder import Real, Store, adapter, hash_of_ship, hashes_of_trials, plain
from fitting.solvers.control import Control, interrupts_noted
from fitting.solvers.rollout_loss import RolloutLoss
from mmg.errors import BadValue
from mmg.messages import LOGGER, OnProgress, Progress
from mmg.ship import Ship
from residual.settings import TrainSettings
from residual.splits import Split, splits_of
from residual.system import (
    RolloutBatch,
    TrainableSystem,
    acceleration_loss,
    calibration_loss,
    normalised_errors,
    rollout,
    state_loss,
)
from residual.windows import (
    STRIDE,
    Scales,
    augmented,
    by_campaign,
    calibration_windows,
    compare_errors,
    window_errors,
    windows,
)


class Adam:
    """Steps of ``parameters`` as ``torch.optim.Adam`` takes them (Kingma & Ba 2015), bit for bit.

    By the function of torch: its class imports torch's compiler, 1.4 s of processor time in each process that trains.
    """

    def __init__(self, parameters: Iterable[torch.nn.Parameter]) -> None:
        # of each: mean of its gradient and of its square, number of its steps, a tensor as the function wants it
        self.moments = [(p, torch.zeros_like(p), torch.zeros_like(p), torch.zeros(())) for p in parameters]

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """One step at a ``rate`` of learning of the parameters that have a gradient."""
        some = [(p, p.grad, *rest) for p, *rest in self.moments if p.grad is not None]
        values, gradients, means, squares, steps = (list(column) for column in zip(*some, strict=True))
        adam(
            values, gradients, means, squares, [], steps,
            amsgrad=False, maximize=False, lr=rate, beta1=0.9, beta2=0.999, eps=1e-8, weight_decay=0.0,
        )  # fmt: skip


# Share of its fall by which a stop error has to rise again, and weight of the newest one in its moving average, for a
# training to end (Wakita et al. 2024, Eq. 25 and 24).
RISE, NEWEST = 0.1, 0.1
RESTARTS, LOWER = 2, 0.2  # How often a diverged training starts again, and the factor on its rate. Set by hand.
# Time for the errors of one system over 30 and 100 s, by that for its stop windows: 1.3 were measured of an RNN.
JUDGING = 1.5
EXPLODED = 100.0  # Stop error by that of the untrained system from which on a training has diverged. Set by hand.
# Makes the untrained system of a ship, scales, settings and a seed; importable, so that it reaches other processes.
BuildSystem = Callable[[Ship, Scales, TrainSettings, int], TrainableSystem]


@dataclass(frozen=True)
class Task:
    """One training: build(ship, scales, settings, seed) makes the system, which trains, stops and is judged by
    ``split``. loss: of the calibration, where it trains; seconds: limit of this one; end: when all of them end, by
    ``time.time`` [s]; stop: a file that ends it;
    own_loss: of a user, of normalised errors (N, 6, M), in place of that of states.
    """

    build: BuildSystem
    ship: Ship
    scales: Scales
    settings: TrainSettings
    seed: int
    split: Split
    loss: RolloutLoss | None = None
    seconds: float | None = None
    end: float = math.inf
    stop: Path | None = None
    own_loss: Callable[[Tensor], Any] | None = None

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
    judged 30 s windows one by one, rows (run, first row of its piece, error before, error after); restarts_judged: of
    the 100 s restarts; fold: of the task.
    """

    __pydantic_config__: ClassVar = {"arbitrary_types_allowed": True}  # arrays, where a kept one is read
    seed: int
    status: str
    before: tuple[Real, Real]
    after: tuple[Real, Real]
    history: tuple[tuple[int, Real, Real, Real], ...]
    state: dict[str, np.ndarray] = field(repr=False)
    rate: float
    restarts: int
    seconds: float
    windows: int
    held_out_windows: int
    judged: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)), repr=False)
    fold: int = 0
    restarts_judged: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)), repr=False)


class _Diverged(Exception):
    """The loss is not finite, or the held-out error exploded."""


def train_one(task: Task, progress: OnProgress | None = None) -> Outcome:
    """How the training of a ``task`` ended; a training that fails raises nothing. progress: called after each epoch."""
    # seeds run side by side in processes: threads of each would only take processors from the others
    torch.set_num_threads(1)
    began, settings = time.perf_counter(), task.settings
    control = Control.within(task.seconds, progress)
    control = replace(control, end=min(control.end, task.end), stop=task.stop)
    with interrupts_noted():
        # each attempt begins with the same weights and draws, so that only the lower rate differs
        for restart in range(RESTARTS + 1):
            rate = settings.rate * LOWER**restart
            attempt = _Attempt(task, rate, control)  # also builds the system anew
            try:
                status = attempt.run()
                break
            except _Diverged:
                status = "diverged"
    # also after a divergence: the best weights before it are judged, for the record
    attempt.system.load_state_dict(attempt.best, strict=False)
    systems = task.system(), attempt.system
    # the untrained system is predicted once more: the windows that judge are not those whose error is in the history
    judged, restarts = compare_errors(systems, task.split.judge, task.h, task.scales.score, settings.method)
    # NaN and not zero where none fits: zero would be a perfect prediction
    means = [rows[:, 2:].mean(axis=0).tolist() if len(rows) else (math.nan, math.nan) for rows in (judged, restarts)]
    before, after = zip(*means, strict=True)
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
        restarts_judged=restarts,
        fold=task.split.fold,
    )


class _Attempt:
    """One attempt at one learning rate."""

    def __init__(self, task: Task, rate: float, control: Control) -> None:
        self.task, self.rate, self.control = task, rate, control
        self.system = task.system()
        self.sigma, self.score = (torch.as_tensor(a) for a in (task.scales.sigma, task.scales.score))
        # a generator of its own: the outcome of a seed must not depend on what else was drawn in its process
        self.draw = torch.Generator().manual_seed(task.seed)
        self.stages = stages(task, self.system.past)
        self.count = max((len(batch) for _, batch, _ in self.stages), default=0)
        # in units of the ship without a residual: the penalty then means the same on all ships and data
        self.unit = float(self._calibration(self.stages[0][1]).detach()) if task.loss and self.stages else 1.0
        h = task.h
        held = windows(task.split.stop, h, round(WINDOW / h), round(STRIDE / h), self.system.past)
        assert held is not None
        self.held, self.best = held, self._state()
        # the untrained weights are the first best ones: a training that never helps ends where it began
        began = time.perf_counter()
        self.before = self.least = self.average = self._stop_error()
        # the end of an epoch, and the judgement or scores, come within the limit of time too
        self.reserve = (time.perf_counter() - began) * (1 + JUDGING * (2 if task.split.judge else 1))
        # row 0 is the untrained system, which has no rollouts and no loss yet
        self.history: list[tuple[int, float, float, float]] = [(0, 0.0, math.nan, self.before)]

    @property
    def ends(self) -> bool:
        """Whether to stop now."""
        return self.control.stops or self.control.left < self.reserve

    def _state(self) -> dict[str, torch.Tensor]:
        # copies: the optimizer changes the parameters in place
        return {name: p.detach().clone() for name, p in self.system.named_parameters()}

    def _stop_error(self) -> float:
        """Mean squared normalised error of the windows to stop by."""
        return float(window_errors(self.system, self.held, self.score, self.task.settings.method).mean())

    def run(self) -> str:
        """Train through the stages of the curriculum; "finished" or "stopped"."""
        t, optimizer = self.task.settings, Adam(self.system.parameters())
        plan = [(seconds, batch) for seconds, batch, epochs in self.stages for _ in range(epochs)]
        if self.ends:
            return "stopped"
        for done, (seconds, batch) in enumerate(plan):
            # over the whole curriculum, not each stage: long rollouts, with their steep gradients, meet the low rates
            cosine = 0.5 * (1 + math.cos(math.pi * done / len(plan)))
            rate = t.last_rate + (self.rate - t.last_rate) * cosine
            loss = self._epoch(optimizer, rate, batch)
            self._keep(done + 1, seconds, loss)
            if self.control.progress:
                values = {"loss": loss, "error of 30 s windows": self.history[-1][3]}
                self.control.progress(Progress(f"seed {self.task.seed}", done + 1, len(plan), values))
            if self.ends:
                return "stopped"
            risen = self.average > self.least + RISE * (self.before - self.least)  # Wakita et al. (2024, Eq. 25)
            if t.stop_after and risen and done + 1 >= t.stop_after:
                break
        return "finished"

    def _epoch(self, optimizer: Adam, rate: float, batch: RolloutBatch) -> float:
        """One pass over the windows in random order at a ``rate``; mean loss."""
        t = self.task.settings
        # parts of about equal size, where a fixed size would leave a last part of few windows and noisy gradients
        parts = torch.randperm(len(batch), generator=self.draw).tensor_split(max(1, round(len(batch) / t.batch)))
        losses = []
        for which in parts:
            self.system.zero_grad()
            loss = self._loss(batch.chosen(which))
            loss.backward()
            # one rollout that nearly diverges has a gradient orders larger than the others and would undo the epoch
            norm = torch.nn.utils.clip_grad_norm_(self.system.parameters(), t.clip)
            # before the step: one with NaN makes every weight NaN. A finite loss may have a gradient that is not finite
            if not torch.isfinite(loss) or not torch.isfinite(norm):
                raise _Diverged
            optimizer.step(rate)
            losses.append(float(loss.detach()))
            if self.ends:
                break
        return float(np.mean(losses))

    def _loss(self, batch: RolloutBatch) -> torch.Tensor:
        t = self.task.settings
        if t.loss == "acceleration":
            loss = acceleration_loss(self.system, batch, torch.as_tensor(self.task.scales.acceleration))
        elif self.task.loss:
            loss = self._calibration(batch) / self.unit  # 1 for the ship without a residual
        elif own := self.task.own_loss:
            loss = own(normalised_errors(rollout(self.system, batch, t.method), batch, self.sigma))
            if not isinstance(loss, Tensor) or loss.dim() or not loss.requires_grad:
                raise BadValue("loss: must return a tensor of one number that is made of the errors (N, 6, M)")
        else:
            loss = state_loss(self.system, batch, self.sigma, t.method)
        return loss + t.penalty * self.system.penalty() if t.penalty else loss

    def _calibration(self, batch: RolloutBatch) -> torch.Tensor:
        """The loss of the calibration, mean over windows."""
        assert self.task.loss is not None
        return calibration_loss(self.system, batch, self.task.loss.cost, self.task.settings.method) / len(batch)

    @torch.no_grad()
    def _keep(self, epoch: int, seconds: float, loss: float) -> None:
        """Note the error of the stop windows and keep the weights if they are the best so far."""
        # after the epoch, with the weights as they now are; the loss is a mean over weights that changed meanwhile
        error = self._stop_error()
        self.history.append((epoch, seconds, loss, error))
        # the small term serves data on which the ship has no error to begin with
        if not math.isfinite(error) or error > EXPLODED * self.before + 1e-9:
            raise _Diverged
        self.average += NEWEST * (error - self.average)  # Wakita et al. (2024, Eq. 24)
        if error < self.least:
            self.least, self.best = error, self._state()


def stages(task: Task, past: int) -> list[tuple[float, RolloutBatch, int]]:
    """Length of the rollouts [s], windows and epochs of each stage of the curriculum of ``task``.

    Only of those for which windows fit; one stage with the windows of a calibration, where its loss trains. past: rows
    before each window that the system reads.
    """
    t, h = task.settings, task.h
    if task.loss:
        batch = calibration_windows(task.loss, task.split.train)
        return [(task.loss.h * len(batch.controls), batch, t.epochs)] if batch else []
    result = []
    for seconds, share in t.curriculum:
        if t.augment:
            noise = torch.as_tensor(task.scales.noise)
            batch = augmented(task.split.train, h, round(seconds / h), t.augment, noise, task.seed, past)
        else:
            batch = windows(task.split.train, h, max(1, round(seconds / h)), max(1, round(t.stride / h)), past)
        if batch is not None:
            result.append((seconds, batch, max(1, round(share * t.epochs))))
    return result


def restored(task: Task, outcomes: Sequence[Outcome]) -> list[TrainableSystem]:
    """The systems that trainings like ``task`` ended with, by their ``outcomes``; those that diverged are left out."""
    systems = []
    for o in outcomes:
        if o.status != "diverged":
            # built by its seed again: what is not a parameter, as scales, comes from the task
            system = replace(task, seed=o.seed).system()
            system.load_state_dict({name: torch.as_tensor(a) for name, a in o.state.items()}, strict=False)
            systems.append(system)
    return systems


class ModelKind(NamedTuple):
    """A kind of model that is trained, such as a residual on a ship.

    build: makes the untrained system; scales(ship, pieces, trials, h): of the training data; inputs(ship): their names;
    features(ship): (logged columns (6, M), inputs (C, M)) -> what the network sees, (F, M); campaigns: whether the
    values that campaigns of the ship have for themselves are inputs; own_loss: as of ``Task``.
    """

    build: BuildSystem
    scales: Callable[[Ship, Sequence[Stretch], Sequence[Trial], float], Scales]
    inputs: Callable[[Ship], tuple[str, ...]]
    features: Callable[[Ship], Callable[[Tensor, Tensor], Tensor]]
    campaigns: bool = False
    own_loss: Callable[[Tensor], Any] | None = None

    def pieces(self, ship: Ship, trials: Sequence[Trial], h: float) -> list[Stretch]:
        """The pieces of ``trials`` on a grid of ``h`` [s] with what the model reads."""
        pieces = pieces_of(trials, h, self.inputs(ship))
        return by_campaign(pieces, ship, trials) if self.campaigns else pieces


def tasks_of(
    kind: ModelKind,
    ship: Ship,
    trials: Sequence[Trial],
    settings: TrainSettings,
    validation: Sequence[Trial] = (),
    judged_apart: bool = True,
    loss: RolloutLoss | None = None,
) -> list[Task]:
    """One training of a ``kind`` of model of ``ship`` per seed of ``settings``, with the step filled in.

    trials: of which parts take turns to stop by and to judge by; validation: trials that judge instead; judged_apart:
    the windows that judge are not those that stop, which would flatter; loss: of the calibration, by which they train.
    Raises UserError where there is too little data.
    """
    h = settings.step or default_step(trials, ship.particulars["L"])
    pieces, held_out = (kind.pieces(ship, some, h) for some in (trials, validation))
    settings = replace(settings, step=h)
    splits = splits_of(settings, pieces, held_out, judged_apart)
    # of all pieces, those that judge included: the mean network needs one set of scales for all seeds
    scales = kind.scales(ship, pieces, trials, h)
    if settings.sigma is not None:
        if len(settings.sigma) != 6 or not min(settings.sigma) > 0:
            raise BadValue("sigma must be six positive numbers: x, y [m], psi [rad], u, v [m/s], r [rad/s]")
        scales = replace(scales, sigma=np.array(settings.sigma, dtype=float))
    # each seed takes the next turn of the split, so that seeds differ in weights and in what judges
    first = Task(kind.build, ship, scales, settings, settings.seed, splits[0], loss, own_loss=kind.own_loss)
    return [replace(first, seed=settings.seed + i, split=split) for i, split in enumerate(splits)]


# Settings that may change between an interrupted run and its continuation: they do not change its numbers.
FREE = ("workers", "time_limit")


def training_store(
    out: Path,
    ship: Ship,
    trials: Sequence[Trial],
    validation: Sequence[Trial],
    settings: TrainSettings,
    resume: bool = False,
) -> Store:
    """Where the finished seeds of a training are, or will be, kept, with what must be the same to continue it.

    out: its run folder; ship, trials, validation, settings: as given to ``residual.pipeline.train``, the trials without
    those held out by their role; resume: continue where ``out`` is there.
    """
    about = {
        "--model": getattr(settings, "kind", "hybrid"),
        # what changes no number may change between a run and its continuation
        "settings": {name: value for name, value in asdict(settings).items() if name not in FREE},
        "ship": hash_of_ship(ship),
        "trial files": hashes_of_trials(trials),
        "--validate": hashes_of_trials(validation),
    }
    return Store(out / "training", about, resume and out.exists())


_ROWS = ("judged", "restarts_judged")  # Kept as arrays beside those of the state; the rest as JSON, to the last bit


def save_outcome(store: Store, outcome: Outcome) -> None:
    """Keep the ``outcome`` of a seed in ``store``."""
    words = {f.name: getattr(outcome, f.name) for f in fields(Outcome) if f.name not in (*_ROWS, "state")}
    store.save(f"seed_{outcome.seed}", plain(words), {name: getattr(outcome, name) for name in _ROWS} | outcome.state)


def load_outcome(store: Store, seed: int) -> Outcome | None:
    """The training of a ``seed`` as ``store`` kept it, to the last bit; None where it is not complete."""
    kept = store.load(f"seed_{seed}")
    if kept is None:
        return None
    words, arrays = kept
    return adapter(Outcome).validate_python({**words, **{name: arrays.pop(name) for name in _ROWS}, "state": arrays})


def train_seeds(
    tasks: Sequence[Task], progress: OnProgress | None = None, store: Store | None = None
) -> tuple[list[Outcome], bool]:
    """Outcomes of the ``tasks`` of a training in their order, and whether Ctrl-C ended them early.

    progress: called after each epoch where one process trains, else after each seed; store: what it holds is not
    trained again, and what finishes is kept there. After Ctrl-C the trainings under way keep their best weights and
    those not begun are left out. Raises KeyboardInterrupt where none was begun, UserError where the store is of another
    run, OutOfTimeError where the limit of time in force, not that of the settings, ended one.
    """
    if store:
        store.open()
    settings = tasks[0].settings
    finished = {t.seed: o for t in tasks if (o := load_outcome(store, t.seed))} if store else {}
    missing = [task for task in tasks if task.seed not in finished]
    for seed in finished:
        LOGGER.info("seed %d: already trained", seed)
    workers = max(1, min(width(settings.workers), len(missing)))
    if missing:
        LOGGER.info("training from seed(s) %s in %d process(es)", ", ".join(str(t.seed) for t in missing), workers)
    # the limit is for all: a process trains its seeds one after the other, so that each has its part of it
    limit = settings.time_limit / math.ceil(len(missing) / workers) if settings.time_limit and missing else None
    done = len(tasks) - len(missing)
    with tempfile.TemporaryDirectory() as scratch:
        stop = Path(scratch) / "stop"

        def interrupted() -> None:
            # processes of a pool get no signal of their own on every system; all of them can look for a file
            stop.touch()
            LOGGER.info("interrupted: keeping the best weights so far")

        def note(outcome: Outcome | None) -> None:
            nonlocal done
            if outcome:
                done += 1
                better = f"judged 30 s windows {outcome.before[0]:.4f} -> {outcome.after[0]:.4f}"
                again = f", restarted {outcome.restarts} time(s) at a lower rate" if outcome.restarts else ""
                LOGGER.info(f"seed {outcome.seed}: {outcome.status} in {outcome.seconds:.0f} s, {better}{again}")
                if progress:
                    progress(Progress("seeds", done, len(tasks), {"error of 30 s windows": outcome.after[0]}))

        with interrupts_noted(interrupted):
            outer = Control.within(None)  # that in force, of which other processes do not know
            jobs = [(replace(task, stop=stop, seconds=limit, end=outer.end), store) for task in missing]
            # epochs of several processes would arrive mixed, and their function cannot be sent to them
            work = partial(_trained, progress=progress) if workers == 1 else _trained
            made = run_all(work, jobs, workers, note)
        broken = stop.exists()  # asked before the folder is gone
    # what has a limit for all its parts goes on with whole trainings only
    if limit is None and not broken and any(o is None or o.status == "stopped" for o in made):
        raise outer.out_of_time
    by_seed = finished | {o.seed: o for o in made if o}
    outcomes = [by_seed[task.seed] for task in tasks if task.seed in by_seed]
    if not outcomes:
        raise KeyboardInterrupt
    return outcomes, broken


def _trained(job: tuple[Task, Store | None], progress: OnProgress | None = None) -> Outcome | None:
    """One training, kept where it came to its end; None where it was stopped before it began."""
    task, store = job
    assert task.stop is not None
    if task.stop.exists() or time.time() > task.end:
        return None
    outcome = train_one(task, progress)
    # a stopped seed is not kept: continued, it is trained whole, to the same numbers as without an interruption
    if store and outcome.status != "stopped":
        save_outcome(store, outcome)
    return outcome

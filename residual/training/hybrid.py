"""Training of a residual on a calibrated ship: scales, tasks of the seeds, the mean network, the decision."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from cases.trial import Trial
from fitting.nlp.grid import default_step
from fitting.prediction.score import pooled_sigma
from mmg.errors import UserError
from mmg.messages import Message
from mmg.network import Network
from mmg.progress import OnProgress
from mmg.ship import Ship
from residual.bounded_network import Residual, Symmetric, TwoLayers, to_network
from residual.physics.operator import Physics
from residual.rollout import measured_accelerations
from residual.settings import TrainSettings
from residual.system import Hybrid, System
from residual.training.acceptance import decide
from residual.training.checkpoint import Store
from residual.training.decision import Decision
from residual.training.folds import FOLDS, GAP, Sides, sides_of
from residual.training.seeds import train_seeds
from residual.training.trainer import Build, Outcome, Scales, Task
from residual.training.window_errors import WINDOW
from residual.training.windows import Piece, features_of, loss_sigma, pieces_of, windows

OUTPUT = 0.3
"""Scale of the residual as a share of the rms accelerations of the ship on the training rows."""
MARGIN = 1e-9
"""Least scale, for what never changes in the training rows."""


@dataclass(frozen=True)
class TrainedResidual:
    """What training a residual made. ship: the calibrated ship; network: the mean of the residuals, None where every
    training diverged; decision: whether it is worth keeping; outcomes: of each seed; settings: with the step filled in;
    scales: of the training data; seconds: it took; interrupted: by Ctrl-C.
    """

    ship: Ship
    network: Network | None
    decision: Decision
    outcomes: tuple[Outcome, ...]
    settings: TrainSettings
    scales: Scales
    seconds: float
    interrupted: bool = False


def build_hybrid(ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> System:
    """A calibrated ship with a residual that is still zero."""
    return Hybrid(Physics(ship), residual_of(ship, scales, training, seed), scales.seen)


def residual_of(ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> TwoLayers:
    """An untrained residual of these settings."""
    if not training.symmetric:
        return Residual(scales.feature, scales.output, training.width, seed)
    own = Residual(scales.feature, scales.output, max(1, training.width // 2), seed)
    return Symmetric(own, ship.actuators)


def train_residual(
    ship: Ship,
    trials: Sequence[Trial],
    settings: TrainSettings,
    validation: Sequence[Trial] = (),
    progress: OnProgress | None = None,
    store: Store | None = None,
) -> TrainedResidual:
    """Train a residual on a calibrated ship from several seeds and decide whether their mean is worth keeping.

    Each seed stops by other parts of the ``trials`` and is judged by others again (``residual.training.folds``), or by
    ``validation`` where that is given. ship: its network, if any, is left out; settings: how to train; progress: called
    after each epoch or seed; store: finished seeds, which are not trained again. Raises UserError where there is too
    little to train on, stop or judge by, KeyboardInterrupt after Ctrl-C before any training began.
    """
    began = time.perf_counter()
    ship = ship.without_network()
    h = settings.step or default_step(trials, ship.particulars["L"])
    settings = replace(settings, step=h)
    pieces = pieces_of(trials, h, ship.inputs)
    held = pieces_of(validation, h, ship.inputs) if validation else []
    scales = scales_of(ship, pieces, [*trials], h)
    tasks = tasks_of(ship, scales, settings, pieces, held, None, apart=True)
    outcomes, interrupted = train_seeds(tasks, settings, progress, store)
    good = [o for o in outcomes if o.status != "diverged"]
    network = network_of(ship, scales, settings, good) if good else None
    seconds = time.perf_counter() - began
    return TrainedResidual(ship, network, decide(outcomes), tuple(outcomes), settings, scales, seconds, interrupted)


def tasks_of(
    ship: Ship,
    scales: Scales,
    training: TrainSettings,
    pieces: Sequence[Piece],
    held: Sequence[Piece],
    stop: Path | None,
    build: Build = build_hybrid,
    what: str = "a residual",
    apart: bool = False,
    judge: bool = True,
) -> list[Task]:
    """One training per seed, each with its share of the time limit. Raises UserError where data are too few.

    Without ``held`` parts of the pieces take turns to stop and to judge; without ``judge`` only to stop, and the same
    part judges, which flatters. With ``held`` all are judged by it and, unless ``apart``, also stop by it.
    """
    h = training.step
    assert h is not None
    limit = training.time_limit
    rounds = -(-training.seeds // max(1, training.workers))
    tasks = []
    for i in range(training.seeds):
        sides = Sides(list(pieces), list(held), list(held), 0)
        if not held or apart:
            dealt = sides_of(pieces, i, training.block, h, WINDOW, judge=judge and not held)
            judging = list(held) or (dealt.judge if judge else dealt.stop)
            sides = Sides(dealt.train, dealt.stop, judging, 0 if held else dealt.fold)
        _check(sides, h, training, bool(held), what)
        tasks.append(
            Task(
                build, ship, scales, training, training.seed + i, h, tuple(sides.train), tuple(sides.stop),
                limit / rounds if limit else None, stop, tuple(sides.judge), sides.fold,
            )
        )  # fmt: skip
    return tasks


def _check(sides: Sides, h: float, training: TrainSettings, given: bool, what: str) -> None:
    """Raises UserError unless a window fits into each side."""
    longest = max((p.steps * h for p in sides.train), default=0.0)
    shortest = training.curriculum[0][0]
    every = {id(p): p for p in (*sides.train, *sides.stop, *(() if given else sides.judge))}
    total = sum(p.steps * h for p in every.values())
    if given and windows(sides.judge, h, round(WINDOW / h), 1) is None:
        raise UserError(f"--validate: no trial holds {WINDOW:g} s without a gap, so nothing can be held out")
    if any(windows(side, h, round(WINDOW / h), 1) is None for side in (sides.stop, sides.judge)):
        raise UserError(
            f"too little data for {what}: {total:.0f} s in pieces without gaps; {FOLDS} runs of at least {WINDOW:g} s, "
            f"or three blocks of {WINDOW + GAP:g} s, are needed to train, to stop and to judge by different ones. Keep "
            "the calibrated ship, or give more trials"
        )
    if longest < shortest:
        raise UserError(
            f"too little data for {what}: the longest piece to train on is {longest:.0f} s, shorter than the "
            f"first rollouts of {shortest:g} s; keep the calibrated ship or give longer trials"
        )


def scales_of(ship: Ship, pieces: Sequence[Piece], trials: Sequence[Trial], h: float) -> Scales:
    """Scales from the training rows. Raises UserError when there are none."""
    if not pieces:
        raise UserError("too little data for a residual: no piece of a trial is longer than a step without a gap")
    physics = Physics(ship)
    seen = features_of(physics.model, pieces)
    feature = np.sqrt((seen**2).mean(axis=1))
    rows = windows(pieces, h, 1, 1)
    assert rows is not None
    with torch.no_grad():
        rates = physics.rates(physics.start(rows.targets[0], rows.controls[0]), rows.controls[0])[3:6].numpy()
    measured, mask = measured_accelerations(rows)
    spread = measured[0].numpy()[:, mask[0].numpy().all(axis=0)].std(axis=1)
    sigma = loss_sigma(pieces, ship.particulars["L"])
    placed = [t for t in trials if t.has_position]
    score = pooled_sigma(placed) if placed else sigma
    return Scales(
        feature=np.where(feature > MARGIN, feature, 1.0),
        output=OUTPUT * np.sqrt((rates**2).mean(axis=1)) + MARGIN,
        sigma=sigma,
        score=score,
        acceleration=np.maximum(spread, MARGIN),
        noise=noise_of(pieces),
        seen=seen,
    )


def noise_of(pieces: Sequence[Piece]) -> np.ndarray:
    """Noise of the logged columns on the grid (6,), from third differences, in which motion leaves little."""
    thirds = [np.diff(p.grid.states[p.first : p.last + 1], n=3, axis=0) for p in pieces if p.steps >= 3]
    if not thirds:
        return np.zeros(6)
    together = np.vstack(thirds)
    together = together[np.isfinite(together).all(axis=1)]
    return np.median(np.abs(together), axis=0) / 0.6745 / np.sqrt(20.0) if len(together) else np.zeros(6)


def network_of(ship: Ship, scales: Scales, training: TrainSettings, outcomes: Sequence[Outcome]) -> Network:
    """The mean of the residuals of outcomes, with the envelope of the training rows."""
    residuals = []
    for o in outcomes:
        residual = residual_of(ship, scales, training, o.seed)
        weights = {name.removeprefix("residual."): torch.as_tensor(v) for name, v in o.state.items()}
        residual.load_state_dict(weights, strict=False)
        residuals.append(residual)
    return to_network(residuals, ship.actuators, scales.seen.min(axis=1), scales.seen.max(axis=1))


def warnings_of(outcomes: Sequence[Outcome], settings: TrainSettings) -> tuple[Message, ...]:
    """Warnings on the seeds of ``settings`` that did not come to their end, by the ``outcomes`` of the others."""
    status = {o.seed: o.status for o in outcomes}
    seeds = range(settings.seed, settings.seed + settings.seeds)
    kinds = (
        ("diverged", "diverged, also at lower rates, and left out"),
        ("stopped", "stopped before the end"),
        ("missing", "not begun"),
    )
    found = []
    for kind, words in kinds:
        which = ", ".join(str(s) for s in seeds if status.get(s, "missing") == kind)
        found += [Message(f"{words}: seed(s) {which}", f"seeds_{kind}")] if which else []
    return tuple(found)

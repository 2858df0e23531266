"""What is trained, and the trainings of its seeds: what each trains on, stops by and is judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from torch import Tensor

from cases.trial import Trial
from fitting.nlp.grid import default_step
from mmg.errors import UserError
from mmg.ship import Ship
from residual.settings import BlackBoxSettings, TrainSettings
from residual.training.folds import FOLDS, GAP, Split, split_pieces
from residual.training.scales import Scales
from residual.training.trainer import BuildSystem, Task
from residual.training.window_errors import WINDOW
from residual.training.windows import Piece, pieces_of


class ModelKind(NamedTuple):
    """A kind of model that is trained, such as a residual on a ship.

    build: makes the untrained system; scales(ship, pieces, trials, h): of the training data; inputs(ship): their names;
    features(ship): (logged columns (6, M), inputs (C, M)) -> what the network sees, (F, M).
    """

    build: BuildSystem
    scales: Callable[[Ship, Sequence[Piece], Sequence[Trial], float], Scales]
    inputs: Callable[[Ship], tuple[str, ...]]
    features: Callable[[Ship], Callable[[Tensor, Tensor], Tensor]]


def tasks_of(
    kind: ModelKind,
    ship: Ship,
    trials: Sequence[Trial],
    settings: TrainSettings,
    validation: Sequence[Trial] = (),
    judged_apart: bool = True,
) -> list[Task]:
    """One training of a ``kind`` of model of ``ship`` per seed of ``settings``, with the step filled in.

    trials: of which parts take turns to stop by and to judge by; validation: trials that judge instead; judged_apart:
    as of ``training_tasks``. Raises UserError where there is too little data.
    """
    h = settings.step or default_step(trials, ship.particulars["L"])
    pieces, held_out = (pieces_of(some, h, kind.inputs(ship)) for some in (trials, validation))
    settings = replace(settings, step=h)
    _splits(settings, pieces, held_out, judged_apart)  # too few data are refused before scales are estimated
    scales = kind.scales(ship, pieces, trials, h)
    return training_tasks(kind.build, ship, scales, settings, pieces, held_out, judged_apart)


def training_tasks(
    build: BuildSystem,
    ship: Ship,
    scales: Scales,
    settings: TrainSettings,
    pieces: Sequence[Piece],
    held_out: Sequence[Piece] = (),
    judged_apart: bool = True,
) -> list[Task]:
    """One training per seed of ``settings``, on a grid of its step.

    build, ship, scales: make the system; pieces: of the training trials, parts of which take turns to stop by and to
    judge by; held_out: pieces that judge instead; judged_apart: the windows that judge are not those that stop, which
    would flatter. Raises UserError where data are too few.
    """
    splits = _splits(settings, pieces, held_out, judged_apart)
    return [Task(build, ship, scales, settings, settings.seed + i, split) for i, split in enumerate(splits)]


def _splits(
    settings: TrainSettings, pieces: Sequence[Piece], held_out: Sequence[Piece], judged_apart: bool
) -> list[Split]:
    """What each seed is trained on, stopped by and judged by; UserError where that is too little."""
    splits = []
    for i in range(settings.seeds):
        if held_out and not judged_apart:
            split = Split(list(pieces), list(held_out), list(held_out), 0)
        else:
            split = split_pieces(pieces, i, settings, WINDOW, judge=judged_apart and not held_out)
            if held_out:
                split = split._replace(judge=list(held_out), fold=0)
            elif not judged_apart:
                split = split._replace(judge=split.stop)
        _check(split, settings, bool(held_out))
        splits.append(split)
    return splits


def _check(split: Split, settings: TrainSettings, given: bool) -> None:
    """Raises UserError unless a window fits into each part; given: whether what judges is of other trials."""
    h = settings.step
    assert h is not None
    shortest, rows = settings.curriculum[0][0], round(WINDOW / h)
    longest = max((p.steps * h for p in split.train), default=0.0)
    what = "a network" if isinstance(settings, BlackBoxSettings) else "a residual"
    if given and all(p.steps < rows for p in split.judge):
        raise UserError(f"--validate: no trial holds {WINDOW:g} s without a gap, so nothing can be held out")
    if any(all(p.steps < rows for p in part) for part in (split.stop, split.judge)):
        every = {id(p): p for p in (*split.train, *split.stop, *(() if given else split.judge))}
        total = sum(p.steps * h for p in every.values())
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

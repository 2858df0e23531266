"""What is trained, and the trainings of its seeds: what each trains on, stops by and is judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from torch import Tensor

from cases.trial import Trial
from fitting.nlp.grid import default_step
from mmg.ship import Ship
from residual.settings import TrainSettings
from residual.training.folds import splits_of
from residual.training.pieces import Piece, pieces_of
from residual.training.scales import Scales
from residual.training.trainer import BuildSystem, Task


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
    splits_of(settings, pieces, held_out, judged_apart)  # too few data are refused before scales are estimated
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
    splits = splits_of(settings, pieces, held_out, judged_apart)
    return [Task(build, ship, scales, settings, settings.seed + i, split) for i, split in enumerate(splits)]

"""The trainings of several seeds: what each trains on, stops by and is judged by."""

from __future__ import annotations

from collections.abc import Sequence

from mmg.errors import UserError
from mmg.ship import Ship
from residual.settings import BlackBoxSettings, TrainSettings
from residual.training.folds import FOLDS, GAP, Split, split_pieces
from residual.training.scales import Scales
from residual.training.trainer import BuildSystem, Task
from residual.training.window_errors import WINDOW
from residual.training.windows import Piece


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
    tasks = []
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
        tasks.append(Task(build, ship, scales, settings, settings.seed + i, split))
    return tasks


def _check(split: Split, settings: TrainSettings, given: bool) -> None:
    """Raises UserError unless a window fits into each part; given: whether what judges is of other trials."""
    h = settings.step
    assert h is not None
    shortest, rows = settings.curriculum[0][0], round(WINDOW / h)
    longest = max((p.steps * h for p in split.train), default=0.0)
    every = {id(p): p for p in (*split.train, *split.stop, *(() if given else split.judge))}
    what = "a network" if isinstance(settings, BlackBoxSettings) else "a residual"
    if given and all(p.steps < rows for p in split.judge):
        raise UserError(f"--validate: no trial holds {WINDOW:g} s without a gap, so nothing can be held out")
    if any(all(p.steps < rows for p in part) for part in (split.stop, split.judge)):
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

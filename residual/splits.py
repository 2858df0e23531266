"""What of the gap-free pieces of trials each seed trains on, stops by and is judged by. Needs no torch.

Rotating fifths of the runs judge, or single runs of a few. What judges takes no part in the training, not even in the
choice of the weights: those chosen on the windows that then decide look better than they are (Cawley and Talbot, 2010,
J Mach Learn Res 11). Of fewer than WHOLE runs blocks of time judge, which cannot tell how another run would be
predicted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, groupby
from typing import NamedTuple

from fitting.nlp.windows import Stretch
from fitting.prediction.score import WINDOW
from mmg.errors import TooFewData
from residual.settings import BlackBoxSettings, TrainSettings

FOLDS = 5  # Parts into which the runs are split, or the blocks of fewer runs. Set by hand.
WHOLE = 3  # Fewest runs of which whole ones judge. Set by hand.
# Seconds left out between blocks of one run that serve differently: a run's next seconds know its motion and wind.
GAP = 30.0  # Set by hand: one window of the scores
# Lengths of blocks [s], of which shorter ones are tried where longer ones are fewer than FOLDS. Set by hand.
BLOCKS = (150.0, 120.0, 90.0, 75.0)


class Split(NamedTuple):
    """Stretches to train on, to stop by and to judge by; fold: number of the part that judges, or else stops."""

    train: list[Stretch]
    stop: list[Stretch]
    judge: list[Stretch]
    fold: int


def split_pieces(
    pieces: Sequence[Stretch], turn: int, settings: TrainSettings, least: float, judge: bool = True
) -> Split:
    """The split of the training number ``turn`` = 0, 1, ..., in which one part of ``pieces`` judges after the other.

    Of FOLDS runs with a piece of ``least`` [s] or more, whole runs; of WHOLE, one run judges and blocks of the others
    stop; of fewer all are blocks, GAP apart. ``settings``: with the step; judge: without it only one part is taken
    away, to stop by. A part is empty where the data are too few.
    """
    h = settings.step
    assert h is not None
    # only runs in which a window fits can judge or stop; the slack is for steps that are no binary fractions
    runs = list(dict.fromkeys(p.run for p in pieces if p.steps * h >= least - 1e-9))
    if len(runs) >= FOLDS:
        fold = turn % FOLDS
        of_run = {run: _role(number, turn, FOLDS, judge) for number, run in enumerate(runs)}
        parts = [(p, of_run.get(p.run, 0)) for p in pieces]  # runs too short for a window are still worth training on
    elif len(runs) >= WHOLE and judge:
        fold = turn % len(runs)
        others = [p for p in pieces if p.run != runs[fold]]
        # the judging run stays whole, as it decides; stopping may be by blocks, which cost fewer data to train on
        cut, _ = _blocks_by_role(others, turn, h, least + GAP, judge=False)
        parts = [*cut, *((p, 2) for p in pieces if p.run == runs[fold])]
    else:
        parts, fold = _blocks_by_role(pieces, turn, h, least + GAP, judge)
    train, stop, judging = ([p for p, part in parts if part == number] for number in range(3))  # as ``_role`` has them
    return Split(train, stop, judging, fold)


def _role(number: int, turn: int, folds: int, judge: bool) -> int:
    """What a run or block serves for: 0 to train, 1 to stop, 2 to judge. Later rounds stop by other parts."""
    part, fold = number % folds, turn % folds
    # one further than what judges, and one more in each later round, never the same part
    stop = (fold + 1 + turn // folds % (folds - 1)) % folds if judge else fold
    return 1 if part == stop else 2 if judge and part == fold else 0


def _blocks_by_role(
    pieces: Sequence[Stretch], turn: int, h: float, least: float, judge: bool
) -> tuple[list[tuple[Stretch, int]], int]:
    """Blocks GAP apart, and what each serves for; those shorter than ``least`` [s] are trained on."""
    for length in BLOCKS:
        # evenly: no short rest at the end of a piece, in which no window fits
        cut = [part for piece in pieces for part in piece.evenly(max(1, round(piece.steps * h / length)))]
        long = [b.steps * h >= least - 1e-9 for b in cut]
        if sum(long) >= FOLDS:  # as long as possible: each cut loses a gap to either side
            break
    folds = max(3, min(FOLDS, sum(long)))  # three at the least: one part each to train, to stop and to judge by
    roles = [
        _role(n - 1, turn, folds, judge) if is_long else 0 for is_long, n in zip(long, accumulate(long), strict=True)
    ]
    # half of the gap on either side of a cut, rounded up, so that no more rows than needed are lost
    return _apart(list(zip(cut, roles, strict=True)), math.ceil(GAP / 2 / h - 1e-9)), turn % folds


def _apart(parts: Sequence[tuple[Stretch, int]], rows: int) -> list[tuple[Stretch, int]]:
    """Neighbouring blocks that serve alike joined, cut short by ``rows`` where the next of the same run serves
    differently."""
    # a joined block holds longer rollouts than its parts
    alike = [list(some) for _, some in groupby(parts, lambda one: (id(one[0].record), one[1]))]
    joined, result = [(replace(some[0][0], last=some[-1][0].last), some[0][1]) for some in alike], []
    for k, (block, part) in enumerate(joined):
        neighbours = [joined[j] if 0 <= j < len(joined) else (None, part) for j in (k - 1, k + 1)]
        before, after = (rows * (b is not None and b.run == block.run and p != part) for b, p in neighbours)
        if block.steps > before + after:  # else nothing is left of it
            result.append((replace(block, first=block.first + before, last=block.last - after), part))
    return result


def splits_of(
    settings: TrainSettings, pieces: Sequence[Stretch], held_out: Sequence[Stretch], judged_apart: bool
) -> list[Split]:
    """What each seed of a training is trained on, stopped by and judged by. Needs no torch.

    settings: with the step; pieces: of the training trials; held_out: pieces that judge instead; judged_apart: the
    windows that judge are not those that stop. Raises UserError where that is too little.
    """
    splits = []
    for i in range(settings.seeds):
        if held_out and not judged_apart:
            # the same trials stop and judge: black boxes and comparisons are judged by test trials afterwards
            split = Split(list(pieces), list(held_out), list(held_out), 0)
        else:
            split = split_pieces(pieces, i, settings, WINDOW, judge=judged_apart and not held_out)
            if held_out:
                split = split._replace(judge=list(held_out), fold=0)
            elif not judged_apart:
                split = split._replace(judge=split.stop)
        # each split: with few runs a later turn can lack what the first has
        _check(split, settings, pieces, bool(held_out))
        splits.append(split)
    return splits


def _check(split: Split, settings: TrainSettings, pieces: Sequence[Stretch], given: bool) -> None:
    """Raises UserError unless a window fits into each part of ``pieces``; given: whether other trials judge."""
    h = settings.step
    assert h is not None
    shortest, rows = settings.curriculum[0][0], round(WINDOW / h)
    longest = max((p.steps * h for p in split.train), default=0.0)
    what = "a network" if isinstance(settings, BlackBoxSettings) else "a residual"
    if given and all(p.steps < rows for p in split.judge):
        raise TooFewData(f"--validate: no trial holds {WINDOW:g} s without a gap, so nothing can be held out")
    if any(all(p.steps < rows for p in part) for part in (split.stop, split.judge)):
        total = sum(p.steps * h for p in pieces)
        raise TooFewData(
            f"too little data for {what}: {total:.0f} s in pieces without gaps; {FOLDS} runs of at least {WINDOW:g} s, "
            f"or three blocks of {WINDOW + GAP:g} s, are needed to train, to stop and to judge by different ones. Keep "
            "the calibrated ship, or give more trials"
        )
    if longest < shortest:
        raise TooFewData(
            f"too little data for {what}: the longest piece to train on is {longest:.0f} s, shorter than the "
            f"first rollouts of {shortest:g} s; keep the calibrated ship or give longer trials"
        )

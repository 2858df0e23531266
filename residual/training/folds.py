"""What a seed trains on, stops by and is judged by: rotating fifths of the runs, or of blocks of time of a few runs.

What judges takes no part in the training, not even in the choice of the weights: those chosen on the windows that then
decide look better than they are (Cawley and Talbot, 2010, J Mach Learn Res 11).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

from residual.settings import TrainSettings
from residual.training.windows import Piece, blocks

FOLDS = 5
"""Parts into which the runs are split, or the blocks of fewer runs."""
GAP = 30.0
"""Seconds left out between blocks of one run that serve differently: a run's next seconds know its motion and wind."""
SHORTER = (120.0, 90.0, 75.0)
"""Lengths of blocks [s] tried where longer ones are fewer than FOLDS."""


class Split(NamedTuple):
    """Pieces to train on, to stop by and to judge by; fold: number of the part that judges, or else stops."""

    train: list[Piece]
    stop: list[Piece]
    judge: list[Piece]
    fold: int


def split_pieces(
    pieces: Sequence[Piece], turn: int, settings: TrainSettings, least: float, judge: bool = True
) -> Split:
    """The split of the training number ``turn`` = 0, 1, ..., in which one part of ``pieces`` judges after the other.

    Of FOLDS runs with a piece of ``least`` [s] or more, whole runs; of fewer, blocks as long as ``settings`` say, GAP
    apart. judge: without it only one part is taken away, to stop by. A part is empty where the data are too few.
    """
    h = settings.step
    assert h is not None
    runs = list(dict.fromkeys(p.run for p in pieces if p.steps * h >= least - 1e-9))
    if len(runs) >= FOLDS:
        fold = turn % FOLDS
        of_run = {run: _role(number, turn, FOLDS, judge) for number, run in enumerate(runs)}
        parts = [(p, of_run.get(p.run, 0)) for p in pieces]
    else:
        parts, fold = _blocks_by_role(pieces, turn, settings.block, h, least + GAP, judge)
        parts = _joined(_with_gaps(parts, math.ceil(GAP / 2 / h - 1e-9)))
    train, stop, judging = ([p for p, part in parts if part == number] for number in range(3))
    return Split(train, stop, judging, fold)


def _role(number: int, turn: int, folds: int, judge: bool) -> int:
    """What a run or block serves for: 0 to train, 1 to stop, 2 to judge. Later rounds stop by other parts."""
    part, fold = number % folds, turn % folds
    stop = (fold + 1 + turn // folds % (folds - 1)) % folds if judge else fold
    return 1 if part == stop else 2 if judge and part == fold else 0


def _blocks_by_role(
    pieces: Sequence[Piece], turn: int, seconds: float, h: float, least: float, judge: bool
) -> tuple[list[tuple[Piece, int]], int]:
    """Blocks and what each is for; those shorter than ``least`` [s] are trained on."""
    for length in (seconds, *(s for s in SHORTER if s < seconds)):
        cut = blocks(pieces, length, h)
        long = [b.steps * h >= least - 1e-9 for b in cut]
        if sum(long) >= FOLDS:
            break
    folds = max(3, min(FOLDS, sum(long)))
    roles = [
        _role(n - 1, turn, folds, judge) if is_long else 0 for is_long, n in zip(long, accumulate(long), strict=True)
    ]
    return list(zip(cut, roles, strict=True)), turn % folds


def _with_gaps(parts: Sequence[tuple[Piece, int]], rows: int) -> list[tuple[Piece, int]]:
    """Blocks cut short by ``rows`` wherever the next one of the same run serves differently."""
    result = []
    for k, (block, part) in enumerate(parts):
        before, after = (
            rows if 0 <= j < len(parts) and parts[j][0].run == block.run and parts[j][1] != part else 0
            for j in (k - 1, k + 1)
        )
        if block.steps > before + after:
            result.append((Piece(block.run, block.grid, block.first + before, block.last - after), part))
    return result


def _joined(parts: Sequence[tuple[Piece, int]]) -> list[tuple[Piece, int]]:
    """Neighbouring blocks that are trained on, joined again."""
    result: list[tuple[Piece, int]] = []
    for block, part in parts:
        last = result[-1][0] if result else None
        if last and part == result[-1][1] == 0 and last.grid is block.grid and last.last == block.first:
            result[-1] = (Piece(last.run, last.grid, last.first, block.last), 0)
        else:
            result.append((block, part))
    return result

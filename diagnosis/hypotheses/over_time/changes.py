"""Which candidates changed over a long log, one after the other, the strongest first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.hypotheses.over_time.change_test import MONTH, ChangeTest, DatedChange
from diagnosis.hypotheses.over_time.weights import DAY, Spells, spells
from fitting.prediction.innovations import Innovations

LEVEL = 0.0005
"""Chance of any change that is invented in a log. With an error that lasts for a day and is larger than that of a
spell, small chances come out up to three times too small, so that it is 0.15 % at most."""

LEAST = 0.1
"""Share of a candidate's typical size below which a change does not matter."""

MOST = 3
"""Changes that are looked for in one log."""

INFORMED = 0.05
"""Share of the median information below which a spell is left out."""

APART = 1.0
"""Days, in a month, between changes of several candidates that are one event: the strongest is named, the
others are its company."""

AGAIN = 3
"""How often a named change is estimated again, with weights by what it leaves."""

FEWEST = 8
"""Spells without which no change can be told."""


@dataclass(frozen=True)
class CandidateChange:
    """A candidate and its best change, given those that were named before. name: of the parameter; day: of its
    spells (B,); estimate, std: in each of them (B,)."""

    name: str
    change: DatedChange
    day: np.ndarray
    estimate: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class Changes:
    """What changed: named, strongest first; company: names of candidates that seem to change along with each of these;
    tested: every candidate before anything was named; spells: of all."""

    named: tuple[CandidateChange, ...]
    company: tuple[tuple[str, ...], ...]
    tested: tuple[CandidateChange, ...]
    spells: Spells


def find_changes(found: Innovations, begin: float, end: float, seed: int = 0) -> Changes:
    """What changed between ``begin`` and ``end`` [s] of a log with innovations ``found``; seed: of the bootstrap."""
    at = spells(found, begin, end)
    J, last = len(found.candidates), (end - begin) / 86400.0
    if len(at.day) < FEWEST:
        return Changes((), (), (), at)
    score, named, first = at.score.copy(), list[CandidateChange](), tuple[CandidateChange, ...]()
    company: list[set[str]] = []
    numbers: list[int] = []
    own = np.einsum("bjj->bj", at.information)
    good = own > INFORMED * np.median(own, axis=0)
    tests = {
        j: ChangeTest(at.day[good[:, j]], 1 / own[good[:, j], j], last) for j in range(J) if good[:, j].sum() >= FEWEST
    }
    while len(named) < MOST:
        rows = []
        for j, test in tests.items():
            keep = good[:, j]
            y = score[keep, j] / own[keep, j]
            change = test(y, np.random.default_rng([seed, j, len(named)]))
            rows.append((j, CandidateChange(found.candidates[j], change, at.day[keep], y, 1 / np.sqrt(own[keep, j]))))
        first = first or tuple(row for _, row in rows)
        sure = [(j, row) for j, row in rows if row.change.p_value * J <= LEVEL
                and abs(row.change.size) >= LEAST * found.typical[j]]  # fmt: skip
        apart = [
            (j, row)
            for j, row in sure
            if not any(_together(row.change, other.change, APART * last / MONTH) for other in named)
        ]
        for k, other in enumerate(named):
            company[k] |= {row.name for _, row in sure if _together(row.change, other.change, APART * last / MONTH)} - {
                other.name
            }
        if not apart:
            break
        j, best = max(apart, key=lambda item: item[1].change.gain)
        company.append(set())
        profile = np.interp(at.day, best.day, best.change.profile)
        score = score - at.information[:, :, j] * (best.change.size * profile)[:, None]
        named.append(best)
        numbers.append(j)
    for k, j in enumerate(numbers):
        others = [(i, row) for i, row in zip(numbers, named, strict=True) if i != j]
        named[k] = _sized(found, (begin, end), (j, named[k]), others, np.random.default_rng([seed, j, len(named)]))
    return Changes(tuple(named), tuple(tuple(sorted(names)) for names in company), first, at)


def _sized(
    found: Innovations,
    log: tuple[float, float],
    one: tuple[int, CandidateChange],
    others: Sequence[tuple[int, CandidateChange]],
    rng: np.random.Generator,
) -> CandidateChange:
    """A named change with its number, ``one``, estimated again with weights that do not hold it, and the ``others``,
    against the stretches that show them: where a change is large they looked as if something had moved the ship.

    found: innovations of a ``log`` from a begin to an end [s]; rng: draws the bootstrap.
    """
    j, best = one
    day = (found.t - log[0]) / DAY
    for _ in range(AGAIN):
        rows = [(i, row.change.size * np.interp(day, row.day, row.change.profile)) for i, row in [(j, best), *others]]
        made = sum(found.gains[:, :, i] * size[:, None] for i, size in rows)
        at = spells(found, *log, made)
        own, score = at.information[:, j, j], at.score[:, j].copy()
        for i, row in others:
            score -= at.information[:, j, i] * row.change.size * np.interp(at.day, row.day, row.change.profile)
        keep = own > INFORMED * np.median(own)
        y = score[keep] / own[keep]
        change = ChangeTest(at.day[keep], 1 / own[keep], (log[1] - log[0]) / DAY)(y, rng)
        best = CandidateChange(best.name, change, at.day[keep], y, 1 / np.sqrt(own[keep]))
    return best


def _together(a: DatedChange, b: DatedChange, apart: float) -> bool:
    """Whether two changes, less than so many days ``apart``, cannot be told apart by their dates."""
    return min(a.end_90[1], b.end_90[1]) + apart >= max(a.begin_90[0], b.begin_90[0])

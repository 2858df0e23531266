"""Which candidates changed over a long log, one after the other, the strongest first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.hypotheses.over_time.change_test import Change, ChangeTest
from diagnosis.hypotheses.over_time.innovations import Innovations
from diagnosis.hypotheses.over_time.weights import Spells, spells

LEVEL = 0.002
"""Chance of any change that is invented in a log: a month a year for forty years."""

LEAST = 0.1
"""Share of a candidate's typical size below which a change does not matter."""

MOST = 3
"""Changes that are looked for in one log."""

FEWEST = 8
"""Spells without which no change can be told."""


@dataclass(frozen=True)
class Tested:
    """A candidate and its best change, given those that were named before. name: of the parameter; estimate, std: of it
    in each spell (B,)."""

    name: str
    change: Change
    estimate: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class Changes:
    """What changed: named, strongest first; tested: every candidate before anything was named; spells: of both."""

    named: tuple[Tested, ...]
    tested: tuple[Tested, ...]
    spells: Spells


def find_changes(found: Innovations, begin: float, end: float, seed: int = 0) -> Changes:
    """What changed between ``begin`` and ``end`` [s] of a log with these innovations; ``seed`` of the bootstrap."""
    at = spells(found, begin)
    J, last = len(found.candidates), (end - begin) / 86400.0
    if len(at.day) < FEWEST:
        return Changes((), (), at)
    score, named, first = at.score.copy(), list[Tested](), tuple[Tested, ...]()
    own = np.einsum("bjj->bj", at.information)
    good = own > 1e-6 * np.median(own, axis=0)
    tests = {j: ChangeTest(at.day[good[:, j]], 1 / own[good[:, j], j], last) for j in range(J) if good[:, j].sum() >= FEWEST}
    while len(named) < MOST:
        rows = []
        for j, test in tests.items():
            keep = good[:, j]
            y = score[keep, j] / own[keep, j]
            change = test(y, np.random.default_rng([seed, j, len(named)]))
            rows.append((j, Tested(found.candidates[j], change, y, 1 / np.sqrt(own[keep, j]))))
        first = first or tuple(row for _, row in rows)
        sure = [(j, row) for j, row in rows if row.change.p_value * J <= LEVEL
                and abs(row.change.size) >= LEAST * found.typical[j]]  # fmt: skip
        if not sure:
            break
        j, best = max(sure, key=lambda item: item[1].change.gain)
        named.append(best)
        profile = np.interp(at.day, at.day[good[:, j]], best.change.profile)
        score = score - at.information[:, :, j] * (best.change.size * profile)[:, None]
    return Changes(tuple(named), first, at)

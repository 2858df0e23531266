"""Which of the tested differences between groups are causes in the ship: they go before coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from diagnosis.estimation.candidates import Candidate
from diagnosis.hypotheses.forward_selection import SAME_CLASS
from diagnosis.hypotheses.group_findings import GroupDifference
from fitting.uncertainty.group_test import GroupTest
from mmg.effects import EFFECTS


@dataclass(frozen=True)
class Tested:
    """A test of a candidate by the dynamics, and its row of the result."""

    candidate: Candidate
    test: GroupTest
    row: GroupDifference


NO_ROW = GroupDifference("", "", "", "", {}, 0.0, 0, 1.0, 0.0)
"""A row without content."""


def is_cause(t: Tested) -> bool:
    """Whether the tested ``t`` is an effect in the ship, such as fouling: coefficients change by such a cause only."""
    return t.candidate.effect in EFFECTS and t.row.nature == "ship"


def physical(best: Tested, clear: Sequence[Tested]) -> Tested:
    """The difference to name where ``best``, of those that are ``clear``, is a coefficient: a cause in the ship, if one
    explains as much."""
    if best.candidate.effect in EFFECTS:
        return best
    causes = [t for t in clear if is_cause(t) and t.row.log_bayes > best.row.log_bayes - 0.5 * SAME_CLASS]
    return max(causes, key=lambda t: t.row.log_bayes, default=best)


def without_idle(idle: Sequence[Tested], named: Sequence[Tested], clear: Sequence[Tested]) -> list[Tested]:
    """Returns the ``named`` differences without those that are ``idle``: none any more beside the last one.

    They explained as well what the last one does, if it stays. In its place stands a cause that does so, by the tests
    that were ``clear`` before anything was named.
    """
    gone = [t.candidate for t in idle]
    kept, last = [t for t in named[:-1] if t.candidate not in gone], named[-1]
    if last.candidate in gone:
        return kept
    at_first = next((t for t in clear if t.candidate == last.candidate), None)
    best = physical(at_first, clear) if at_first else last
    best = last if best is at_first else best
    alike = [*last.row.equivalence_class, last.row.name, *(t.row.name for t in idle)]
    same = tuple(dict.fromkeys(name for name in alike if name != best.row.name))
    return [*kept, replace(best, row=replace(best.row, equivalence_class=same))]

"""What is left over beside the names, or without any."""

from __future__ import annotations

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.judgement.judged_search import JudgedSearch
from diagnosis.judgement.matters import remainder_matters
from diagnosis.judgement.not_random import not_random
from diagnosis.judgement.verdict import has_remainder
from diagnosis.prepare import Prepared
from mmg.messages import Message


def left_over(
    ready: Prepared, result: JudgedSearch, fit: Estimate, tests: GriddedTrials | None, is_named: bool
) -> tuple[bool, list[Message]]:
    """Whether something of a size that matters is left beside the names, and what is to be said of it.

    ready: the problem; result: the search; fit: that of the answer; tests: trials that took no part, or None; is_named:
    whether something was named: else the sentences alone say what is left.
    """
    if not is_named:
        return False, not_random(ready, fit)
    if not remainder_matters(ready.problem, result.found, tests, result.held):
        return False, []
    said = [*not_random(ready, fit), *result.beside]
    expected = ready.problem.expected_unnamed
    return bool(said) or has_remainder(result.found, result.before, result.after, expected), said

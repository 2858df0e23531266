"""What is left over beside the names, or without any."""

from __future__ import annotations

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.left_findings import Pattern
from diagnosis.hypotheses.pattern import LEVEL_OF_PATTERN
from diagnosis.judgement.judged_search import JudgedSearch
from diagnosis.judgement.matters import remainder_matters
from diagnosis.judgement.not_random import not_random
from diagnosis.judgement.verdict import has_remainder
from diagnosis.prepare import Prepared
from mmg.messages import Message


def left_over(
    ready: Prepared, result: JudgedSearch, fit: Estimate, tests: GriddedTrials | None, fits: Pattern | None
) -> tuple[bool, list[Message]]:
    """Whether something of a size that matters is left beside the names, and what is to be said of it.

    ready: the problem; result: the search; fit: that of the answer; tests: trials that took no part, or None; fits: the
    pattern of what was named, None where nothing was: then the sentences alone say what is left.
    """
    if fits is None:
        return False, not_random(ready, fit)
    if not remainder_matters(ready.problem, result.found, tests, result.held):
        return False, []
    said = [*not_random(ready, fit), *result.beside]
    if fits.p_value < LEVEL_OF_PATTERN:
        words = f"what was named would need another size by {fits.parted_by} (p = {fits.p_value:.1g})"
        said.append(Message(f"{words}: another cause may lie behind it", "pattern"))
    expected = ready.problem.expected_unnamed
    return bool(said) or has_remainder(result.found, result.before, result.after, expected), said

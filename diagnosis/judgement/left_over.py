"""What is left over beside the names, or without any: a remainder of a size that matters, and what no random force
leaves, lines in a spectrum and forces that follow each other."""

from __future__ import annotations

from diagnosis.estimation.force_order import force_order
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.judgement.judged_search import JudgedSearch
from diagnosis.judgement.matters import remainder_matters
from diagnosis.judgement.verdict import has_remainder
from diagnosis.prepare import Prepared
from mmg.messages import Message

LINE_PROBABILITY = 1e-6
"""Probability by chance below which a line in the spectrum of the residuals counts as an unexplained remainder."""


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


def not_random(ready: Prepared, fit: Estimate) -> list[Message]:
    """Sentences on what is not random in a fit.

    ready: the problem with its fit without effects, whose spectrum counts; fit: with what is named, or without effects.
    """
    p = ready.problem
    rows = [_oscillation(ready)] if ready.line[0] < LINE_PROBABILITY else []
    order = None if ready.is_order_usual else force_order(p.steps, p.data, fit)
    if order is not None and not order.is_random:
        first, then = order.pair
        words = f"unexplained {first} and {then} follow each other in time (p = {order.p_value:.1g})"
        advice = "as of a ship that passes by, a stream that turns or a force with a memory of its own"
        rows.append(Message(f"{words}, {advice}", "ordered_forces"))
    return rows


def _oscillation(ready: Prepared) -> Message:
    """What the line in the spectrum of the residuals says."""
    period, apart = ready.line[1], ready.gap * ready.problem.data.h
    words = f"the residuals oscillate with a period of {period:.2g} s, as under waves or an engine"
    if period < 2 * apart:
        words += f" (seen with all samples; the tests compare one every {apart:.2g} s)"
    return Message(words, "oscillating_residuals")

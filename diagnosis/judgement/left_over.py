"""What is left over beside the names, or without any: a remainder of a size that matters, and what no random force
leaves, lines in a spectrum and forces that follow each other.

What is left beside a name matters to predictions, not to a test: where hardly any random force acts, every rounding is
significant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.force_order import force_order
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.judgement.judged_search import JudgedSearch, has_remainder
from diagnosis.prepare import Prepared
from diagnosis.validation.held_out import errors, start_states, window_length
from mmg.messages import Message

LEAST_SHARE = 0.05
"""Share of a gap up to which nobody is told of it."""
DRAWS = 8
"""Draws of the noise of the sensors."""


def matters(error: float, best: float, before: float) -> bool:
    """Whether predictions with an ``error`` leave more than LEAST_SHARE of the gap between the error ``before``, with
    nothing named, and the ``best`` one (mean squared errors of 30 s windows)."""
    return error - best > LEAST_SHARE * max(before - best, 0.0)


def remainder_matters(p: SearchProblem, found: Selection, tests: GriddedTrials | None, held: HeldOut | None) -> bool:
    """Whether predictions with the effects ``found`` have an error that the noise of the sensors does not explain, of a
    size that matters.

    p: the problem; tests: trials that took no part; held: the check on these, None without any: then the trials of
    ``p`` themselves are predicted. Returns True where these hold no whole window either.
    """
    data = p.data if held is None or tests is None else tests
    if held is not None:
        before, after = held.mse_before, held.mse_after
    else:
        before, after = (_mean_error(p.steps, p.data, fit.theta) for fit in (found.null, found.final))
    return not after or matters(after, sensor_error(p.steps, data, found.final), before)


def _mean_error(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> float:
    """Mean squared error of 30 s windows, 0 without any."""
    windows, _ = errors(steps, data, theta, window_length(steps.ship))
    return float(windows.mean()) if len(windows) else 0.0


def sensor_error(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> float:
    """Error of predictions of a flawless model, which begin at noisy rows and are compared with such: of the paths that
    ``fit`` predicts for the trials ``data``, logged with its noise. steps: the transition model. Returns the mean over
    windows and draws, 0 where the ship cannot be followed."""
    theta = fit.theta
    acted = acting(steps, data, theta)
    first = start_states(steps, acted, theta)[:1]
    path = steps.logged(steps.follow(np.repeat(first, len(data.y), axis=0), acted.controls, theta), theta)
    if not np.isfinite(path).all():
        return 0.0
    noise, rng = np.hypot(fit.noise.white, fit.noise.coloured), np.random.default_rng(0)
    drawn = (replace(data, y=path + noise * rng.standard_normal(path.shape)) for _ in range(DRAWS))
    return float(np.mean([_mean_error(steps, one, theta) for one in drawn]))


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

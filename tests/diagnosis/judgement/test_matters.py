"""What is left beside a name counts by what it does to predictions: in trials without random forces every rounding is
significant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.estimation.gridded_trials import grid_trials
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.judgement import left_over
from diagnosis.judgement.judged_search import JudgedSearch, limits
from diagnosis.judgement.left_over import LEAST_SHARE, matters, remainder_matters, sensor_error
from diagnosis.validation.held_out import WINDOW, errors
from mmg.messages import Message
from tests.diagnosis.judgement.test_verdict import ready
from tests.support.diagnosis_answers import held
from tests.support.diagnosis_cases import WHITE, candidate, full_steps, problem_of, pushed_trials, quiet
from tests.support.disturbed_trials import Disturbed

LONG = (("zigzag:20/20", 80.0), ("turning:-20", 80.0), ("random:11", 80.0))


def silent() -> Disturbed:
    """Noise of the sensors alone."""
    return quiet(X=0.0, Y=0.0, N=0.0)


def test_a_share_below_a_twentieth_is_not_said() -> None:
    assert not matters(0.1 + 0.99 * LEAST_SHARE, 0.1, 1.1) and matters(0.1 + 1.01 * LEAST_SHARE, 0.1, 1.1)
    assert not matters(0.09, 0.1, 1.1)  # better than the best by chance
    assert matters(0.12, 0.1, 0.1) and not matters(0.1, 0.1, 0.1)  # without any gap, all that is left counts


def test_the_error_of_a_flawless_model_is_that_of_the_sensors() -> None:
    steps, null = full_steps(0.5), ready().null
    exact = replace(null, theta=steps.ship.values, noise=null.noise.with_(white=WHITE, coloured=np.zeros(6)))
    found, expected = [], []
    for seed in (7, 8, 9):
        data = grid_trials(pushed_trials(seed, runs=LONG, how=silent()), steps.ship.inputs, 3.0, 0.5)
        expected.append(errors(steps, data, exact.theta, WINDOW)[0].mean())
        found.append(sensor_error(steps, data, exact))
    assert np.mean(found) == pytest.approx(np.mean(expected), rel=0.4)
    louder = replace(exact, noise=exact.noise.with_(white=2 * WHITE))
    assert sensor_error(steps, data, louder) == pytest.approx(4 * found[-1], rel=0.1)


def test_what_is_left_of_a_gap_is_told_from_the_noise_of_the_sensors() -> None:
    """On trials that took no part, or without any on the trials themselves."""
    problem, null = problem_of(pushed_trials(3, ["current:x=0.05,y=0.0"], LONG, how=silent()), 0.5)
    current = candidate("current")
    theta = null.theta.copy()
    theta[problem.steps.ship.symbols.index("current.x")] = 0.05
    theta[[problem.steps.ship.symbols.index(s) for s in problem.base.symbols]] = problem.base.mean
    right = replace(null, theta=theta, noise=null.noise.with_(white=WHITE))
    half = theta.copy()
    half[problem.steps.ship.symbols.index("current.x")] = 0.03
    for fit, expected in ((right, False), (replace(right, theta=half), True)):
        found = Selection((current,), null, fit, ())
        assert remainder_matters(problem, found, None, None) is expected
        before, after = (float(errors(problem.steps, problem.data, f.theta, WINDOW)[0].mean()) for f in (null, fit))
        check = replace(held(1 - after / before, (0.0, 1.0)), mse_before=before, mse_after=after)
        assert remainder_matters(problem, found, problem.data, check) is expected


def test_without_a_whole_window_to_predict_a_remainder_stays() -> None:
    problem, null = problem_of(pushed_trials(1, runs=(("zigzag:20/20", 25.0),)), 1.0)
    assert remainder_matters(problem, Selection((candidate("current"),), null, null, ()), None, None)


@pytest.mark.parametrize("size", [True, False])
def test_what_does_not_matter_is_no_remainder_and_nothing_is_said_of_it(
    size: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(left_over, "remainder_matters", lambda *_: size)
    monkeypatch.setattr(left_over, "not_random", lambda *_: [Message("oscillates", "oscillating_residuals")])
    unnamed = SimpleNamespace(beyond_chance=3.0, single=0.0)
    null = ready().null
    beside = (Message("what is left acts like", "impossible_size"),)
    result = JudgedSearch(
        Selection((candidate("current"),), null, null, ()), unnamed, unnamed, None, "named", (), None, beside=beside
    )  # type: ignore[arg-type]
    remainder, said = left_over.left_over(ready(), result, null, None, True)
    assert remainder is size
    assert [m.code for m in said] == ["oscillating_residuals", "impossible_size"] * size
    nothing, words = left_over.left_over(ready(), result, null, None, False)
    assert not nothing and [m.code for m in words] == ["oscillating_residuals"]


def test_coefficients_that_a_name_brings_back_are_not_doubted() -> None:
    null = ready().null
    away = replace(null, p=np.array([0.0, -4.2, *null.p[2:]]))
    found = SimpleNamespace(searches=[SimpleNamespace(scores=())])
    trials = pushed_trials(1, runs=LONG[:2])
    for named, expected in ((None, True), (null, False), (away, True)):
        rows = limits(replace(ready(), null=away), found, trials, trials, None, named)  # type: ignore[arg-type]
        assert ("far_from_prior" in [m.code for m in rows]) is expected

"""A name must act with one size everywhere: the right one does, a neighbour that fits in the mean does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.map_estimate import estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.hypotheses.pattern import LEVEL_OF_PATTERN, pattern
from diagnosis.hypotheses.refit import refit
from diagnosis.hypotheses.search_problem import SearchProblem
from tests.support.diagnosis_cases import WHITE, candidate, problem_of, pushed_trials, quiet


@pytest.fixture(scope="module")
def calm() -> SearchProblem:
    return problem_of(pushed_trials(1))[0]


def slow_rudder(problem: SearchProblem, lag: float, rate: float) -> float:
    """p of the pattern of a rudder lag, where the rudder follows its order with a ``lag`` [s] up to a ``rate`` [rad/s].

    The order is logged, in steps as the grid has them.
    """
    steps, data, rng = problem.steps, replace(problem.data, changes=None), np.random.default_rng(5)
    K, R = data.inputs.shape[:2]
    delta = steps.model.controls.index("delta")
    y, z = data.y.copy(), steps.settled(data.y[0].T, data.inputs[0].T, steps.ship.values)
    real = data.inputs[0, :, delta].copy()
    for k in range(K):
        order, acting = data.inputs[k, :, delta], data.inputs[k].T.copy()
        before = real.copy()
        wanted = order + (real - order) * np.exp(-data.h / lag) if lag else order
        real = real + np.clip(wanted - real, -rate * data.h, rate * data.h)
        acting[delta] = 0.5 * (before + real)
        force = 0.3 * np.array([[quiet().X], [quiet().Y], [quiet().N]]) * rng.standard_normal((3, R))
        z = steps.advance(z, acting, steps.coefficients(steps.ship.values, force))
        y[k + 1] = z[:6].T
    seen = replace(data, y=y + 0.5 * WHITE * rng.standard_normal(y.shape))
    start = initial_point(steps, seen, steps.ship.values, problem.base, initial_noise(steps.ship))
    null = estimate(steps, seen, start, iterations=12)
    effect = candidate("rudder_lag")
    fit = refit(steps, seen, problem.base, null, [effect], {effect.columns[0]: 1.0})
    return pattern(steps, seen, fit, [effect]).p_value


def test_the_right_effect_acts_with_one_size(calm: SearchProblem) -> None:
    assert slow_rudder(calm, 1.0, 9.0) > 10 * LEVEL_OF_PATTERN


def test_a_neighbour_that_fits_in_the_mean_does_not(calm: SearchProblem) -> None:
    assert slow_rudder(calm, 0.0, 0.08) < LEVEL_OF_PATTERN


def test_values_by_run_are_not_asked_whether_the_runs_need_others(calm: SearchProblem) -> None:
    """Their slopes in a run vanish but for the prior, so that the last digits of a fit were a proof."""
    start = initial_point(calm.steps, calm.data, calm.steps.ship.values, calm.base, initial_noise(calm.steps.ship))
    null = estimate(calm.steps, calm.data, start, iterations=4)
    current = candidate("current").in_each(np.unique(calm.data.run).tolist())
    fit = refit(calm.steps, calm.data, calm.base, null, [current], dict.fromkeys(current.columns, 0.0))
    away = replace(fit, p=fit.p + 1e-2)  # a hundredth of the prior, as where a fit has not fully converged
    assert pattern(calm.steps, calm.data, away, [current]).parted_by != "run"

"""The budget of the prediction error: what was put in has its share, and nothing has a share in what is random."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.linearisation import Point
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.parameters import set_values
from diagnosis.findings import Budget
from diagnosis.hypotheses.forward_selection import Selection, select_effects
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unexplained_force import estimated_force
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.judgement.budget import budget_of, left_out_errors
from diagnosis.validation.held_out import errors, window_length
from tests.support.diagnosis_cases import pushed_by, pushed_problem, pushed_trials
from tests.support.quick import first_quick

H, TRUTH = 0.5, "current:x=0.03,y=-0.02"


def gridded(problem: SearchProblem, seed: int, effects: list[str]) -> GriddedTrials:
    return grid_trials(pushed_trials(seed, effects), problem.steps.ship.inputs, 3.0, H)


def budget_for(problem: SearchProblem, found: Selection, tests: GriddedTrials | None) -> Budget:
    made = budget_of(replace(problem, tests=tests), found)
    assert made is not None
    return made


@cache
def streamed() -> tuple[SearchProblem, Selection]:
    """Trials in a current that the model lacks, and the selection."""
    problem, null = pushed_problem(1, TRUTH)
    return problem, select_effects(problem, null)


@pytest.mark.slow
@pytest.mark.parametrize("has_tests", [True, False])
def test_a_current_that_was_put_in_causes_the_avoidable_error(has_tests: bool) -> None:
    problem, found = streamed()
    made = budget_for(problem, found, gridded(problem, 2, [TRUTH]) if has_tests else None)
    (part,), rest = made.parts, made.unexplained
    assert rest is not None and made.by == ("test trials" if has_tests else "left-out runs")
    assert part.name == "current" and part.share > 0.8 and part.interval_90[0] <= part.share <= part.interval_90[1]
    assert part.share + rest.share == pytest.approx(1.0) and not made.matters
    before, after, floor = made.units["position_m"]
    assert before > 2 * after >= 2 * floor > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", first_quick([3, 4, 5]))
def test_where_nothing_is_missing_there_is_no_avoidable_error(seed: int) -> None:
    problem, null = pushed_problem(seed)
    made = budget_for(problem, Selection((), null, null, ()), gridded(problem, seed + 10, []))
    assert made.parts == () and made.unexplained is None and made.before == made.after >= made.floor


@pytest.mark.slow
def test_a_force_without_a_name_is_unexplained() -> None:
    problem, _ = pushed_problem(1)
    steps, data, null = pushed_by(problem, 1, 2, "cos", 0.6)
    missing = estimated_force(unnamed_forms(steps, data, null))
    made = budget_of(replace(problem, steps=steps, data=data, tests=data), Selection((), null, null, ()), missing)
    assert made is not None and made.unexplained is not None
    assert made.unexplained.share == 1.0 and made.matters and made.floor < 0.8 * made.before
    assert made.as_given is None


def test_a_ship_that_is_not_fitted_yet_errs_more_as_given() -> None:
    problem, null = pushed_problem(1)
    symbol = null.free.columns[0].symbol
    given = null.theta.copy()
    given[problem.steps.ship.symbols.index(symbol)] *= 3.0
    tests = replace(problem, tests=problem.data)
    made, same = (budget_of(tests, Selection((), null, null, ()), None, 0, theta) for theta in (given, null.theta))
    assert made is not None and made.as_given is not None and same is not None and same.as_given is not None
    assert made.as_given["error"] > made.before and made.as_given["position_m"] > made.units["position_m"][0]
    assert same.as_given["error"] == pytest.approx(same.before, rel=1e-12)
    problem, null = pushed_problem(1, runs=(("zigzag:20/20", 100.0),))  # a single run cannot be left out
    assert budget_of(problem, Selection((), null, null, ())) is None


@pytest.mark.slow
def test_a_run_is_left_out_as_by_a_fit_without_it() -> None:
    problem, found = streamed()
    fit, data = found.final, problem.data
    quick = left_out_errors(problem.steps, data, fit)
    run = data.run[0]
    rest = refitted(problem, fit, data.windows(data.run != run))
    own = data.windows(data.run == run)
    whole = errors(problem.steps, own, fit.theta, window_length(problem.steps.ship)).mean.mean()
    exact = errors(problem.steps, own, rest, window_length(problem.steps.ship)).mean.mean()
    assert quick.mean[quick.run == run].mean() == pytest.approx(exact, rel=0.1, abs=0.3 * abs(exact - whole))


def refitted(problem: SearchProblem, fit: Estimate, data: GriddedTrials) -> np.ndarray:
    """Coefficients fitted to some windows of the problem's trials, with the noise of the ``fit`` to all."""
    kept = np.isin(problem.data.run, data.run)
    path = replace(fit.path, z=fit.path.z[:, kept], force=fit.path.force[:, kept])
    start = Point(fit.theta, fit.free, fit.p, path, fit.noise)
    less = estimate(problem.steps, data, start, 10, fixed_noise=True)
    values = less.free.mean + less.free.std * less.p
    return set_values(problem.steps.ship, data, less.theta, less.free.columns, values)

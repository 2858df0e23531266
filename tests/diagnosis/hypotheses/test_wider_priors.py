"""Whether the coefficients of a ship are as well known as their priors state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.forward_selection import ODDS, Selection, select_effects
from diagnosis.hypotheses.refit import SearchProblem, refit
from diagnosis.hypotheses.wider_priors import likely_widths, wider_priors
from tests.support.diagnosis_cases import pushed_problem

RUNS = (("zigzag:20/20", 60.0), ("turning:-20", 60.0), ("zigzag:10/10", 60.0))
OFF = 10.0  # How far coefficients are off, in stated standard deviations


def problem_off(seed: int) -> tuple[SearchProblem, Estimate]:
    """A quiet ship, given with coefficients that are OFF standard deviations from hers."""
    problem, null = pushed_problem(seed, runs=RUNS, h=1.0)
    base = problem.base
    size = 0.15 * base.std  # so that the trials tell them
    given = base.mean + OFF * size * np.random.default_rng(seed).standard_normal(len(size))
    stated = replace(base, mean=np.clip(given, base.lower, base.upper), std=size)
    problem = replace(problem, base=stated)
    return problem, refit(problem, null, (), {}, 12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_widths_of_priors_that_are_too_narrow_are_found(seed: int) -> None:
    problem, null = problem_off(seed)
    found = wider_priors(problem, null, ())
    assert found is not None and found.evidence > ODDS
    assert OFF / 3 < found.factor < 3 * OFF  # few coefficients tell it
    assert found.problem.base.std == pytest.approx(found.factor * problem.base.std)
    again = wider_priors(found.problem, found.fit, ())
    assert again is None or again.evidence < ODDS


@pytest.mark.slow
def test_sound_priors_stay_as_they_are() -> None:
    problem, null = pushed_problem(1, runs=RUNS, h=1.0)
    assert likely_widths(problem, Selection((), null, null, ())) is None


@pytest.mark.slow
def test_what_wider_priors_explain_alone_has_no_name() -> None:
    problem, null = problem_off(2)
    found = select_effects(problem, null)
    wider = likely_widths(problem, found)
    assert wider is not None
    assert not select_effects(wider.problem, wider.fit).effects

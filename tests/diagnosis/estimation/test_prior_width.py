"""How wide the priors of the coefficients should have been."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from diagnosis.estimation.candidates import Column
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.prior_width import DOUBT, likely_width, narrowed, refitted_at, widened, width_notices
from diagnosis.hypotheses.refit import refit
from tests.support.diagnosis_cases import FEW, candidate, problem_of, pushed_trials

P, SAMPLES = 12, 40
INFORMATION = np.random.default_rng(3).standard_normal((SAMPLES, P)) * np.logspace(1, -2, P)
"""Slopes of linear observations with unit noise on coefficients in prior standard deviations: some tell much, others
nothing."""
NONE: dict[str, Any] = {"theta": np.zeros(0), "path": None, "noise": None, "nll": 0.0}


def linear_fit(values: np.ndarray, seed: int, factor: float = 1.0) -> tuple[Estimate, np.ndarray]:
    """The fit of linear observations of coefficients ``values`` [stated standard deviations], with priors ``factor``
    times as wide as stated; and the observations."""
    A = INFORMATION * factor
    y = INFORMATION @ values + np.random.default_rng(seed).standard_normal(SAMPLES)
    covariance = np.linalg.inv(A.T @ A + np.eye(P))
    columns = tuple(Column(f"c_{i}") for i in range(P))
    free = Priors(columns, np.zeros(P), factor * np.ones(P), np.full(P, -np.inf), np.full(P, np.inf))
    found = Estimate(p=covariance @ A.T @ y, covariance=covariance, free=free, iterations=1, converged=True, **NONE)
    return found, y


@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_the_width_is_that_of_the_largest_marginal_likelihood(factor: float) -> None:
    """Whatever priors the fit has; of linear observations the marginal likelihood is a normal density."""
    found, y = linear_fit(2.0 * np.random.default_rng(1).standard_normal(P), 2, factor)

    def evidence(s: float) -> float:
        law = multivariate_normal(np.zeros(SAMPLES), np.eye(SAMPLES) + s**2 * INFORMATION @ INFORMATION.T)
        return float(law.logpdf(y)) - 0.5 * (np.log(s) / DOUBT) ** 2

    width = likely_width(found, factor)
    assert width.gain == pytest.approx(evidence(width.factor) - evidence(factor), abs=1e-8)
    assert all(evidence(width.factor) >= evidence(width.factor * by) for by in (0.97, 1.03))
    assert 1.2 < width.factor < 3.0


def test_the_width_is_found_within_its_error() -> None:
    """Of ships whose priors are wrong by factors as they are thought to be, 90 % lie within 1.645 errors."""
    rng, inside, errors = np.random.default_rng(7), [], []
    for seed in range(400):
        truth = np.exp(DOUBT * rng.standard_normal())
        width = likely_width(linear_fit(truth * rng.standard_normal(P), seed)[0])
        inside.append(abs(np.log(width.factor / truth)) < 1.645 * width.error)
        errors.append(width.error)
        assert width.gain >= 0
    assert 0.86 < np.mean(inside) < 0.94 and np.mean(errors) < 0.7 * DOUBT


def test_priors_of_effects_and_values_by_run_stay_and_a_ship_of_none_keeps_its_priors() -> None:
    found, _ = linear_fit(np.ones(P), 1)
    columns = (*found.free.columns[:-2], Column("current.x"), Column("c_0", 3))
    free = replace(found.free, columns=columns)
    wider = widened(free, 3.0)
    np.testing.assert_allclose(wider.std, [3.0] * (P - 2) + [1.0] * 2)
    alone = free.only([c.symbol == "current.x" for c in columns])
    one = replace(found, free=alone, p=found.p[:1], covariance=found.covariance[:1, :1])
    assert likely_width(one, 0.7) == (0.7, DOUBT, 0.0)


def test_a_fit_with_wider_priors_is_what_it_would_have_been_from_the_start() -> None:
    problem, null = problem_of(pushed_trials(4), 0.5)
    wide = refitted_at(problem.steps, problem.data, null, 2.0)
    other = refit(problem.steps, problem.data, widened(problem.base, 2.0), null, [], {})
    np.testing.assert_allclose(wide.free.std, 2 * null.free.std)
    np.testing.assert_allclose(wide.p, other.p, atol=0.02)
    assert wide.nll == pytest.approx(other.nll, abs=0.05)


def test_stated_priors_stay_where_the_ship_explodes_with_narrower_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, null = problem_of(pushed_trials(4), 0.5)
    same = replace(null, p=0.1 * null.p)
    _, base, factor = narrowed(problem.steps, problem.data, same, problem.base, 2)
    assert factor < 0.8 and np.allclose(base.std, factor * problem.base.std)

    def exploding(*given: object) -> Estimate:
        raise BrokenModelError("it explodes")

    monkeypatch.setattr("diagnosis.estimation.prior_width.estimate", exploding)
    found, base, factor = narrowed(problem.steps, problem.data, same, problem.base, 2)
    assert found is same and base is problem.base and factor == 1.0

"""Sizes of noise from residuals, and solves in turn that use them."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.nlp.problem import Problem
from fitting.settings import Settings
from fitting.solvers.control import Control
from fitting.solvers.noise import NoiseSolves, Resumption, correlation_time, solve_with_noise_estimation
from tests.support.synthetic_runs import SIGMA, problem, runs


def solved(p: Problem, resumed: Resumption | None = None, draft: bool = False, **settings: object) -> NoiseSolves:
    return solve_with_noise_estimation(p, p.start(), Settings(**settings), Control(), resumed, draft=draft)


def test_few_windows_come_first_and_the_last_solve_can_be_left_out_and_made_later() -> None:
    p = problem(window=10.0, trials=runs()[0])
    whole, early, once = solved(p), solved(p, draft=True), solved(p, sigma=tuple(SIGMA))
    every = len(p.segments.run)
    assert every > 54 and [row["windows"] for row in whole.passes] == [12, 36, every, every]
    assert once.solution.converged and [row["windows"] for row in once.passes] == [every]
    assert early.draft and not whole.draft and len(early.passes) == 3 and not early.solution.converged
    assert [row["objective"] for row in early.passes] == [row["objective"] for row in whole.passes[:3]]
    late = solved(early.problem, early.resumption)
    assert late.solution.converged and not late.draft and len(late.passes) == 1
    assert late.solution.objective == pytest.approx(whole.solution.objective, rel=1e-9)
    np.testing.assert_allclose(late.problem.sigma, whole.problem.sigma, rtol=1e-12)


def test_white_noise_has_a_correlation_time_of_about_one() -> None:
    rng = np.random.default_rng(0)
    assert correlation_time([rng.normal(size=500) for _ in range(10)], 100) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("phi", [0.5, 0.8, 0.9])
def test_an_autoregressive_residual_has_its_known_correlation_time(phi: float) -> None:
    # the sum stops where the autocorrelation falls below 0.05, which leaves out up to about a tenth
    rng = np.random.default_rng(1)
    series = []
    for _ in range(20):
        e = np.zeros(2000)
        for k in range(1, 2000):
            e[k] = phi * e[k - 1] + rng.normal()
        series.append(e)
    assert correlation_time(series, 200) == pytest.approx((1 + phi) / (1 - phi), rel=0.15)

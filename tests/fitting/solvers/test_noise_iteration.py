"""Solves in turn: who makes which, and that the estimates do not hang on it."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from fitting.nlp.fisher_information import information
from fitting.nlp.problem import Problem
from fitting.settings import Settings
from fitting.solvers import noise_iteration
from fitting.solvers.noise_iteration import NoiseSolves, solve_with_noise_estimation
from tests.support.synthetic_runs import SIGMA, problem, runs


def solved(p: Problem, x: np.ndarray, settings: Settings) -> NoiseSolves:
    return solve_with_noise_estimation(p, x, settings, time.perf_counter(), None)


@pytest.mark.parametrize("sigma, expected", [(None, ["solve_led"] * 4), (tuple(SIGMA), ["solve"])])
def test_ipopt_alone_makes_an_only_solve(
    sigma: tuple[float, ...] | None, expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, whole = [], noise_iteration.solve_in_time

    def noted(*given: Any) -> Any:
        made.append((given[-1].__name__, len(given[0].segments.run)))
        return whole(*given)

    monkeypatch.setattr(noise_iteration, "solve_in_time", noted)
    p = problem(window=10.0, trials=runs()[0])
    found = solved(p, p.start(), Settings(sigma=sigma))
    assert [name for name, _ in made] == expected and found.solution.converged
    every = len(p.segments.run)
    assert every > 54 and [count for _, count in made] == ([every] if sigma else [12, 36, every, every])


def test_the_last_solve_can_be_left_out_and_made_later() -> None:
    p = problem(window=10.0, trials=runs()[0])
    whole, early = (
        solve_with_noise_estimation(p, p.start(), Settings(), time.perf_counter(), None, draft=draft)
        for draft in (False, True)
    )
    assert early.draft and not whole.draft and len(early.passes) == 3 and not early.solution.converged
    assert [row["objective"] for row in early.passes] == [row["objective"] for row in whole.passes[:3]]
    x, began = early.solution.x, time.perf_counter()
    late = solve_with_noise_estimation(early.problem, x, Settings(), began, None, early.resumption)
    assert late.solution.converged and not late.draft and len(late.passes) == 1
    assert late.solution.objective == pytest.approx(whole.solution.objective, rel=1e-9)
    np.testing.assert_allclose(late.problem.sigma, whole.problem.sigma, rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_estimates_are_the_same_whoever_makes_the_first_solve(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    p = problem(window=10.0, trials=runs()[0])
    x = p.start(np.random.default_rng(seed).normal(size=p.P))
    led = solved(p, x, Settings())
    made, whole = [], noise_iteration.solve_in_time

    def ipopt_first(*given: Any) -> Any:
        made.append(given[:-1] + ((given[-1],) if made else (noise_iteration.solve,)))
        return whole(*made[-1])

    monkeypatch.setattr(noise_iteration, "solve_in_time", ipopt_first)
    alone = solved(p, x, Settings())
    assert [given[-1].__name__ for given in made] == ["solve"] + ["solve_led"] * 3
    assert led.solution.converged and alone.solution.converged
    std = np.sqrt(np.diag(np.linalg.inv(information(alone.problem, alone.solution.x).hessian)))
    ours, theirs = (found.problem.split(found.solution.x)[1] for found in (led, alone))
    assert (np.abs(ours - theirs) < 0.05 * std).all()
    np.testing.assert_allclose(led.problem.sigma, alone.problem.sigma, rtol=0.01)

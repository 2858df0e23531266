"""Information and score of each window, states eliminated: against single shooting and finite differences."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from fitting.nlp.fisher_information import information
from fitting.nlp.problem import Problem
from fitting.solvers.solve import Solution, solve
from tests.fitting.nlp.test_effects_in_the_fit import crowded
from tests.support.synthetic_runs import problem


@lru_cache(maxsize=4)
def solved(kind: str) -> tuple[Problem, Solution]:
    """A solution of a plain ship, and of one with memory and measurement effects."""
    p = {"plain": problem, "crowded": lambda: crowded(5)}[kind]()
    s = solve(p, p.start(), tolerance=1e-9)
    assert s.violation < 1e-8
    return p, s


@pytest.mark.slow
def test_it_is_that_of_single_shooting() -> None:
    """On a plain ship; that of single shooting agrees with least squares of scipy (test_shooting)."""
    p, s = solved("plain")
    whole = problem(K=200)
    alone = solve(whole, whole.start(), tolerance=1e-9)
    found, reference = information(p, s.x), information(whole, alone.x)
    scale = np.sqrt(np.einsum("wii->wi", reference.fisher).max(axis=0)) + 1e-9
    size = np.outer(scale, scale)
    np.testing.assert_allclose(found.fisher / size, reference.fisher / size, atol=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plain", "crowded"])
def test_scores_and_prior_cancel_at_the_optimum(kind: str) -> None:
    p, s = solved(kind)
    found = information(p, s.x)
    lower, upper = p.p_bounds()
    inside = (found.p > lower + 1e-3) & (found.p < upper - 1e-3)
    total = found.score.sum(axis=0) + found.p
    size = np.abs(found.score).sum(axis=0) + np.abs(found.p) + 1
    assert inside.any() and (np.abs(total / size)[inside] < 1e-4).all()
    assert (np.linalg.eigvalsh(found.fisher) > -1e-6 * np.abs(found.fisher).max()).all()


def profiled(p: Problem, at: np.ndarray, windows: np.ndarray) -> float:
    """Cost of some windows without the prior, minimised over their states at fixed coefficients."""
    theta = p.prior.mean + p.prior.std * at
    part = Problem(p.ship, p.prior, p.kernels, p.segments.subset(windows), p.sigma).with_bounds(theta, theta)
    s = solve(part, part.start(at), tolerance=1e-10)
    assert s.converged
    return s.objective - 0.5 * float(at @ at)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plain", "crowded"])
def test_the_score_is_the_slope_of_the_profiled_cost_of_a_window(kind: str) -> None:
    p, s = solved(kind)
    found, rng = information(p, s.x), np.random.default_rng(0)
    lower, upper = p.p_bounds()
    inside = (found.p > lower + 1e-2) & (found.p < upper - 1e-2)
    d = rng.normal(size=p.P) * inside
    d /= np.linalg.norm(d) * 1e3
    for w in (0, len(found.run) - 1):
        up, middle, down = (profiled(p, found.p + step * d, np.array([w])) for step in (1, 0, -1))
        size = np.sqrt(d @ found.fisher[w] @ d)
        assert (up - down) / 2 == pytest.approx(found.score[w] @ d, abs=2e-4 * size + 1e-7, rel=2e-3)
        # curvature: Gauss-Newton against the exact one, which sees residuals of the order of the noise
        assert up + down - 2 * middle == pytest.approx(d @ found.fisher[w] @ d, rel=0.35)


def test_runs_are_sums_of_windows() -> None:
    p, s = solved("plain")
    found = information(p, s.x)
    by_run = found.by_run()
    np.testing.assert_allclose(by_run.score.sum(axis=0), found.score.sum(axis=0))
    np.testing.assert_allclose(by_run.hessian, found.hessian)
    assert len(by_run.run) == len(np.unique(found.run))

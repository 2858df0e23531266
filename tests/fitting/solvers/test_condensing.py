"""The condensed step against a sparse solution of the whole KKT system, and quadratic programs under bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import lsq_linear

from fitting.nlp.problem import Problem, upper_triangle
from fitting.solvers.condensing import gauss_newton, lead, newton, solved, within_bounds
from fitting.uncertainty.refits import reweighted
from tests.fitting.nlp.test_effects_in_the_fit import crowded
from tests.fitting.nlp.test_run_constants import small
from tests.fitting.nlp.test_shooting import matrix
from tests.support.synthetic_runs import problem


def drawn() -> Problem:
    """A replicate of a bootstrap, which has the scales of the problem that it is drawn from."""
    whole = problem()
    whole.scale = 1.3 * whole.scale
    counts = np.arange(len(whole.segments.run)) % 3
    return reweighted(whole, whole.start(), counts, np.zeros(whole.P))[0]


PROBLEMS = {"plain": problem, "one interval": lambda: problem(200), "crowded": lambda: crowded(5),
            "runs": lambda: small(7, True), "drawn": drawn}  # fmt: skip


def unbounded(p: Problem) -> Problem:
    return p.with_bounds(np.full(p.P, -1e9), np.full(p.P, 1e9))


@pytest.mark.parametrize("kind", ["plain", "one interval", "runs", "drawn"])
def test_the_exact_step_solves_the_whole_system(kind: str) -> None:
    p = unbounded(PROBLEMS[kind]())
    near, rng = lead(p, p.start(), 1e-8, 60), np.random.default_rng(0)
    x, lam = near.x + 1e-4 * rng.normal(size=p.n), near.multipliers
    step = solved(p, newton(p, x, lam), p.split(x)[1])
    assert step is not None
    order = p.patterns[1][1]
    H = matrix(p.patterns[1][0], upper_triangle(*p.hessian_parts(x, 1.0, lam, middle=True))[order])
    H, J = H + sp.triu(H, 1).T, matrix(p.patterns[0][0], p.jacobian(x))
    whole = sp.bmat([[H, J.T], [J, None]]).tocsc()
    found = sp.linalg.spsolve(whole, -np.concatenate([p.gradient(x), p.defects(x)]))
    ours = np.concatenate([step.nodes.reshape(-1), step.p, step.multipliers])
    size = np.abs(found[: p.n]).max(), np.abs(found[p.n :]).max()
    np.testing.assert_allclose(ours[: p.n], found[: p.n], atol=1e-7 * size[0])
    np.testing.assert_allclose(ours[p.n :], found[p.n :], atol=1e-6 * size[1])
    assert step.decrease == pytest.approx(p.gradient(x) @ ours[: p.n], rel=1e-6)


@pytest.mark.parametrize("kind", list(PROBLEMS))
def test_both_subproblems_have_the_gradient_and_the_linearised_defects_of_the_problem(kind: str) -> None:
    p = PROBLEMS[kind]()
    rng = np.random.default_rng(1)
    x = p.start(0.1 * rng.normal(size=p.P))
    one, other = gauss_newton(p, x), newton(p, x, np.zeros(p.m))
    for sub in (one, other):
        gradient = np.concatenate([sub.slope.reshape(-1), sub.shared_slope])
        np.testing.assert_allclose(gradient, p.gradient(x), rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
        np.testing.assert_allclose(sub.off.reshape(-1), p.defects(x), atol=1e-12)
    np.testing.assert_allclose(one.maps, other.maps)
    step = solved(unbounded(p), one, p.split(x)[1])
    assert step is not None
    d = np.concatenate([step.nodes.reshape(-1), step.p])
    linear = matrix(p.patterns[0][0], p.jacobian(x)) @ d + p.defects(x)
    np.testing.assert_allclose(linear, 0, atol=1e-8 * np.abs(p.defects(x)).max())


def test_numbers_that_are_not_finite_give_no_step() -> None:
    p = problem()
    sub = gauss_newton(p, p.start())
    assert solved(p, replace(sub, shared=sub.shared * np.nan), np.zeros(p.P)) is None


@pytest.mark.parametrize("seed", range(6))
def test_quadratic_programs_under_bounds_are_solved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(30, 12)), rng.normal(size=30)
    lower, upper = -np.abs(rng.normal(size=12)) * 0.2, np.abs(rng.normal(size=12)) * 0.2
    if seed == 0:  # held coefficients
        lower[:3] = upper[:3] = 0.0
    H, g = A.T @ A, -A.T @ b
    d = within_bounds(H, g, lower, upper)
    wide = np.where(lower < upper, upper, upper + 1e-12)
    np.testing.assert_allclose(d, lsq_linear(A, b, (lower, wide), tol=1e-14).x, atol=1e-6)
    assert (d >= lower).all() and (d <= upper).all()

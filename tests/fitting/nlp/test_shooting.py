"""Multiple shooting: values, exact derivatives, and agreement with independent solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from cases.shipfiles.ship_file import load_ship
from fitting.nlp.fisher_information import information
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import cut
from fitting.solvers.solve import solve
from mmg.rollout import Simulator
from tests.support.calibrated import FREE
from tests.support.synthetic_runs import SIGMA, assert_exact_derivatives, kernel, problem, runs


def somewhere(p: Problem, seed: int = 0) -> np.ndarray:
    return p.start() + 0.02 * np.random.default_rng(seed).normal(size=p.n)


def test_interval_ends_agree_with_the_simulator() -> None:
    p = problem(K=7)
    seg = p.segments
    start = seg.nodes[seg.start].T
    end, interior = p.shooting.values(start, p.ship.values)
    full = np.flatnonzero(seg.steps == 7)
    out = Simulator(p.ship).run(start[:, full], seg.controls[:, :, full], seg.h)
    np.testing.assert_allclose(end[:, full], out[-1], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(interior[:, :, full], out[1:-1], rtol=1e-10, atol=1e-12)


def test_short_last_intervals_end_after_their_own_steps() -> None:
    p = problem(K=7)
    seg = p.segments
    short = np.flatnonzero(seg.steps < 7)
    assert len(short)
    end, _ = p.shooting.values(seg.nodes[seg.start].T, p.ship.values)
    for i in short:
        n = seg.steps[i]
        out = Simulator(p.ship).run(seg.nodes[seg.start[[i]]].T, seg.controls[:n, :, [i]], seg.h)
        np.testing.assert_allclose(end[:, i], out[-1, :, 0], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("K", [1, 5, 7])
def test_derivatives_are_exact(K: int) -> None:
    p = problem(K)
    assert_exact_derivatives(p, somewhere(p))


@pytest.mark.parametrize("K", [1, 5, 40])
def test_the_optimum_does_not_depend_on_the_shooting_interval(K: int) -> None:
    reference = solve(problem(K=10), problem(K=10).start())
    p = problem(K)
    other = solve(p, p.start())
    assert reference.converged and other.converged
    assert other.objective == pytest.approx(reference.objective, rel=1e-6)


@pytest.mark.slow
def test_scipy_finds_the_same_optimum_of_a_small_problem() -> None:
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing([s for s in ship.symbols if s not in FREE])
    prior = Prior.of(ship)
    trials = runs()[0][:2]
    ours = Problem(ship, prior, kernel(prior.symbols), cut(trials, 1.0, 60.0, 5), SIGMA)
    whole = Problem(ship, prior, kernel(prior.symbols), cut(trials, 1.0, 60.0, 200), SIGMA)
    found = solve(ours, ours.start())
    seg = whole.segments

    def residuals(x: np.ndarray) -> np.ndarray:
        z0 = seg.nodes[seg.start] + x[whole.P :].reshape(-1, 6) * whole.scale
        end, interior = whole.shooting.values(z0.T, whole.coefficients(x[: whole.P]))
        parts = [
            np.sqrt(whole.node_weight[seg.start]) * (z0 - seg.nodes[seg.start]),
            np.sqrt(whole.node_weight[seg.end]) * (end.T - seg.nodes[seg.end]),
            np.sqrt(whole.weight) * (interior - seg.targets),
            x[: whole.P],
        ]
        return np.concatenate([part.reshape(-1) for part in parts])

    theirs = least_squares(residuals, np.zeros(whole.P + 6 * seg.intervals), xtol=1e-12, ftol=1e-12)
    assert found.converged
    assert theirs.cost == pytest.approx(found.objective, rel=1e-5)
    np.testing.assert_allclose(theirs.x[: whole.P], ours.split(found.x)[1], atol=1e-3)
    H, n = theirs.jac.T @ theirs.jac, whole.P  # the initial states of the windows projected out
    hessian = H[:n, :n] - H[:n, n:] @ np.linalg.solve(H[n:, n:], H[n:, :n])
    np.testing.assert_allclose(information(ours, found.x).hessian, hessian, atol=5e-3 * np.abs(hessian).max())


def test_bounds_hold_at_the_optimum() -> None:
    p = problem()
    lower, upper = p.prior.mean - 0.2 * p.prior.std, p.prior.mean + 0.2 * p.prior.std
    tight = p.with_bounds(lower, upper)
    s = solve(tight, tight.start())
    theta = tight.coefficients(tight.split(s.x)[1])[tight.kernels.free]
    assert s.converged
    assert (theta >= lower - 1e-12).all() and (theta <= upper + 1e-12).all()
    assert (np.abs(tight.split(s.x)[1]) > 0.2 - 1e-4).any()

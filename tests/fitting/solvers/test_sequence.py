"""The condensing sequence: optimality where it ends, the same optimum as IPOPT's, and when it leaves IPOPT alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fitting.nlp.fisher_information import information
from fitting.nlp.loss import LOSSES
from fitting.nlp.problem import Problem
from fitting.solvers import solve as solving
from fitting.solvers.condensing import Lead, lead, polished
from fitting.solvers.control import Control
from fitting.solvers.solve import by_ipopt, solve
from tests.fitting.nlp.test_effects_in_the_fit import crowded
from tests.fitting.nlp.test_run_constants import small
from tests.fitting.nlp.test_shooting import matrix
from tests.support.synthetic_runs import problem


def tight() -> Problem:
    p = problem()
    return p.with_bounds(p.prior.mean - 0.2 * p.prior.std, p.prior.mean + 0.2 * p.prior.std)


def held() -> Problem:
    p = problem()
    still = np.arange(p.P) < 5
    here = p.prior.mean
    return p.with_bounds(np.where(still, here, p.prior.lower), np.where(still, here, p.prior.upper))


def robust(name: str) -> Problem:
    p = problem()
    return p.with_changes(loss=replace(p.loss, name=name))


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "crowded": lambda: crowded(5),
    "runs": lambda: small(7, True),
    "tight": tight,
    "held": held,
    **{name: partial(robust, name) for name in LOSSES},
}


@pytest.mark.parametrize("kind", list(PROBLEMS))
def test_one_exact_step_balances_gradient_and_multipliers(kind: str) -> None:
    p = PROBLEMS[kind]()
    found = lead(p, p.start(), 1e-7, 60)
    assert found.reached

    def unbalanced(at: Lead) -> float:
        slope = p.gradient(at.x) + matrix(p.patterns[0][0], p.jacobian(at.x)).T @ at.multipliers
        slope[p.S * p.B :] += at.bound
        return float(np.abs(slope).max())

    last = polished(p, found)
    left = 0.4 if kind == "tight" else 0.05  # many bounds: the Hessian is made positive across them
    assert unbalanced(last) < max(left * unbalanced(found), 1e-7)
    assert np.abs(p.defects(last.x)).max() < 1e-6


@pytest.mark.parametrize("kind", list(PROBLEMS))
def test_it_ends_at_a_point_that_is_optimal(kind: str) -> None:
    p = PROBLEMS[kind]()
    found = lead(p, p.start(), 1e-9, 60)
    assert found.reached
    slope = p.gradient(found.x) + matrix(p.patterns[0][0], p.jacobian(found.x)).T @ found.multipliers
    slope[p.S * p.B :] += found.bound
    assert np.abs(slope).max() < 1e-3 * np.abs(p.gradient(found.x)).max()
    assert np.abs(p.defects(found.x)).max() < 1e-5
    at, (lower, upper) = p.split(found.x)[1], p.p_bounds()
    assert (at >= lower).all() and (at <= upper).all()
    assert np.abs(found.bound[(at > lower + 1e-9) & (at < upper - 1e-9)]).max(initial=0.0) == 0.0


@pytest.mark.parametrize("kind", ["crowded", "runs", "tight", "student"])
def test_led_and_alone_ipopt_find_the_same_optimum_and_covariance(kind: str) -> None:
    p = PROBLEMS[kind]()
    alone, led = by_ipopt(p, p.start()), solve(p, p.start())
    assert alone.converged and led.converged
    assert led.objective == pytest.approx(alone.objective, rel=1e-6)
    ours, theirs = (np.linalg.inv(information(p, s.x).hessian) for s in (led, alone))
    size = np.sqrt(np.diag(theirs))
    np.testing.assert_allclose(ours / np.outer(size, size), theirs / np.outer(size, size), atol=1e-4)
    assert led.history[-1][0] == pytest.approx(led.objective, rel=1e-6)
    assert led.iterations == len(led.history) - 1


def test_random_starts_reach_the_same_optimum() -> None:
    p, rng = problem(), np.random.default_rng(3)
    reference = by_ipopt(p, p.start())
    for _ in range(5):
        end = solve(p, p.start(rng.normal(scale=0.5, size=p.P)))
        assert end.converged and end.objective == pytest.approx(reference.objective, rel=1e-6)


def test_a_rough_solve_ends_without_ipopt(monkeypatch: pytest.MonkeyPatch) -> None:
    p = problem()
    best = by_ipopt(p, p.start())
    monkeypatch.setattr(solving, "by_ipopt", None)
    rough = solve(p, p.start(), rough=True)
    assert rough.status == "Solved_To_Acceptable_Level" and not rough.converged
    assert rough.objective == pytest.approx(best.objective, rel=3e-3) and rough.violation < 1e-2


def test_where_it_does_not_come_to_its_end_ipopt_begins_as_if_it_had_not_been(monkeypatch: pytest.MonkeyPatch) -> None:
    p = problem()
    alone = by_ipopt(p, p.start())
    monkeypatch.setattr(solving, "STEPS", 2)
    led = solve(p, p.start())
    np.testing.assert_array_equal(led.x, alone.x)
    assert (led.iterations, led.history) == (alone.iterations, alone.history)


def test_limits_stop_as_without_it() -> None:
    p = problem()
    alone, led = (each(p, p.start(), Control(iterations=3)) for each in (by_ipopt, solve))
    assert led.status == alone.status == "Maximum_Iterations_Exceeded"
    np.testing.assert_array_equal(led.x, alone.x)
    late = solve(p, p.start(), Control.within(1e-9))
    assert late.status == "Maximum_WallTime_Exceeded"


def test_a_model_that_is_not_finite_is_left_to_ipopt() -> None:
    q = problem()
    x = q.start()
    x[0] = np.nan
    broken = lead(q, x, 1e-7, 40)
    assert not broken.reached and len(broken.history) == 1


def test_each_iterate_is_told_and_can_stop_it() -> None:
    p, seen = problem(), list[tuple[float, float]]()

    def stop(objective: float, violation: float) -> bool:
        seen.append((objective, violation))
        return len(seen) == 3

    found = lead(p, p.start(), 1e-7, 40, stop)
    assert not found.reached and found.history == seen and len(seen) == 3


def test_steps_that_gain_little_end_it_where_that_is_asked_for() -> None:
    p = problem()
    whole, early = lead(p, p.start(), 1e-12, 60), lead(p, p.start(), 1e-12, 60, stalled=1e-2)
    assert early.reached and len(early.history) < len(whole.history)
    assert early.history == whole.history[: len(early.history)]
    assert p.objective(early.x) == pytest.approx(p.objective(whole.x), rel=0.05)


def test_it_does_not_stall_where_intervals_do_not_join() -> None:
    p = problem()
    early = lead(p, p.start(), 1e-12, 60, stalled=1e9)
    assert early.reached and np.abs(p.defects(early.x)).max() > 1e-6
    joined = lead(p, p.start(), 1e-12, 60, stalled=1e9, feasible=1e-6)
    assert joined.reached and np.abs(p.defects(joined.x)).max() < 1e-6
    assert len(joined.history) > len(early.history)
    assert not lead(p, p.start(), 1e9, 3, feasible=0.0).reached

"""Solves: the condensing sequence and IPOPT, which certifies it, solves in turn that estimate the noise, and what ends
them early."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.shipfiles.ship_file import load_ship
from fitting.calibrate import FitOptions, calibrate
from fitting.nlp.fisher_information import information
from fitting.nlp.loss import LOSSES
from fitting.nlp.problem import Problem, upper_triangle
from fitting.result import FitResult, read_fit
from fitting.settings import Settings
from fitting.solvers import solve as solving
from fitting.solvers.condensing import Lead, gauss_newton, lead, newton, polished, solved, within_bounds
from fitting.solvers.control import (
    INTERRUPTED,
    LEFT_OUT,
    OBSERVER,
    Control,
    Made,
    interrupts_noted,
    left_out_message,
    make_in_turn,
    unbroken,
)
from fitting.solvers.control import unless_interrupted as unless
from fitting.solvers.noise import NoiseSolves, correlation_time, solve_with_noise_estimation
from fitting.solvers.solve import by_ipopt, solve
from fitting.uncertainty.refits import reweighted
from mmg.messages import Progress, has_code
from tests.support.calibrated import FREE
from tests.support.synthetic_runs import SIGMA, coarse_runs, crowded, matrix, problem, runs, with_constants

pytestmark = pytest.mark.usefixtures("blank_figures")


def tight() -> Problem:
    p = problem()
    return p.with_bounds(p.prior.mean - 0.2 * p.prior.std, p.prior.mean + 0.2 * p.prior.std)


def held() -> Problem:
    p = problem()
    still, here = np.arange(p.P) < 5, p.prior.mean
    return p.with_bounds(np.where(still, here, p.prior.lower), np.where(still, here, p.prior.upper))


def robust(name: str) -> Problem:
    p = problem()
    return p.with_changes(loss=replace(p.loss, name=name))


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "crowded": lambda: crowded(5),
    "runs": lambda: with_constants(7, True),
    "tight": tight,
    "held": held,
    **{name: partial(robust, name) for name in LOSSES},
}


def unbalanced(p: Problem, at: Lead) -> float:
    """Largest slope of the Lagrangian where the sequence ended."""
    slope = p.gradient(at.x) + matrix(p.patterns[0][0], p.jacobian(at.x)).T @ at.multipliers
    slope[p.S * p.B :] += at.bound
    return float(np.abs(slope).max())


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(PROBLEMS))
def test_it_ends_at_a_point_that_is_optimal(kind: str) -> None:
    p = PROBLEMS[kind]()
    rough, found = (lead(p, p.start(), tolerance, 60) for tolerance in (1e-7, 1e-9))
    # one exact step balances gradient and multipliers; across many bounds its Hessian is made positive
    assert unbalanced(p, polished(p, rough)) < max(0.4 * unbalanced(p, rough), 1e-7)
    assert found.reached and unbalanced(p, found) < 1e-3 * np.abs(p.gradient(found.x)).max()
    assert np.abs(p.defects(found.x)).max() < 1e-5
    at, (lower, upper) = p.split(found.x)[1], p.p_bounds()
    assert (at >= lower).all() and (at <= upper).all()
    assert np.abs(found.bound[(at > lower + 1e-9) & (at < upper - 1e-9)]).max(initial=0.0) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["runs", "tight", "student"])
def test_led_and_alone_ipopt_find_the_same_optimum_and_covariance(kind: str) -> None:
    p = PROBLEMS[kind]()
    alone, led = by_ipopt(p, p.start()), solve(p, p.start())
    assert alone.converged and led.converged
    assert led.objective == pytest.approx(alone.objective, rel=1e-6)
    ours, theirs = (np.linalg.inv(information(p, s.x).hessian) for s in (led, alone))
    size = np.sqrt(np.diag(theirs))
    np.testing.assert_allclose(ours / np.outer(size, size), theirs / np.outer(size, size), atol=1e-4)


def test_a_rough_solve_ends_without_ipopt(monkeypatch: pytest.MonkeyPatch) -> None:
    p = problem()
    best = by_ipopt(p, p.start())
    monkeypatch.setattr(solving, "by_ipopt", None)
    rough = solve(p, p.start(), rough=True)
    assert rough.status == "Solved_To_Acceptable_Level" and not rough.converged
    assert rough.objective == pytest.approx(best.objective, rel=3e-3) and rough.violation < 1e-2


def test_limits_stop_as_without_it_and_ipopt_begins_as_if_it_had_not_been(monkeypatch: pytest.MonkeyPatch) -> None:
    p = problem()
    alone, led = (each(p, p.start(), Control(iterations=3)) for each in (by_ipopt, solve))
    assert led.status == alone.status == "Maximum_Iterations_Exceeded" and "--resume" in led.advice
    assert not led.converged and led.objective == pytest.approx(p.objective(led.x))
    np.testing.assert_array_equal(led.x, alone.x)
    late = solve(p, p.start(), Control.within(1e-9))
    assert late.status == "Maximum_WallTime_Exceeded"
    monkeypatch.setattr(solving, "STEPS", 2)  # where it does not come to its end
    alone, led = (each(p, p.start()) for each in (by_ipopt, solve))
    np.testing.assert_array_equal(led.x, alone.x)
    assert led.iterations == alone.iterations


def test_a_model_that_is_not_finite_gives_no_step_and_is_left_to_ipopt() -> None:
    p = problem()
    sub, x = gauss_newton(p, p.start()), p.start()
    assert solved(p, replace(sub, shared=sub.shared * np.nan), np.zeros(p.P)) is None
    x[0] = np.nan
    broken = lead(p, x, 1e-7, 40)
    assert not broken.reached and len(broken.history) == 1


def test_each_iterate_is_told_and_can_end_it_as_do_steps_that_gain_little_and_intervals_join() -> None:
    p, seen = problem(), list[tuple[float, float]]()
    whole = lead(p, p.start(), 1e-12, 60, lambda *told: seen.append(told) is not None)
    assert whole.history == seen
    stopped = lead(p, p.start(), 1e-12, 60, lambda *_: True)
    assert not stopped.reached and stopped.history == whole.history[:1]
    early = lead(p, p.start(), 1e-12, 60, stalled=1e-2)
    assert early.reached and len(early.history) < len(whole.history)
    assert early.history == whole.history[: len(early.history)]
    assert p.objective(early.x) == pytest.approx(p.objective(whole.x), rel=0.05)
    early = lead(p, p.start(), 1e-12, 60, stalled=1e9)
    assert early.reached and np.abs(p.defects(early.x)).max() > 1e-6
    joined = lead(p, p.start(), 1e-12, 60, stalled=1e9, feasible=1e-6)
    assert joined.reached and np.abs(p.defects(joined.x)).max() < 1e-6
    assert len(joined.history) > len(early.history)
    assert not lead(p, p.start(), 1e9, 3, feasible=0.0).reached


# The condensed step against a sparse solution of the whole KKT system, and quadratic programs under bounds
def drawn() -> Problem:
    """A replicate of a bootstrap, which has the scales of the problem that it is drawn from."""
    whole = problem()
    whole.scale = 1.3 * whole.scale
    counts = np.arange(len(whole.segments.run)) % 3
    return reweighted(whole, whole.start(), counts, np.zeros(whole.P))[0]


CONDENSED = {"one interval": lambda: problem(200), "runs": lambda: with_constants(7, True), "drawn": drawn}


def unbounded(p: Problem) -> Problem:
    return p.with_bounds(np.full(p.P, -1e9), np.full(p.P, 1e9))


@pytest.mark.parametrize("kind", CONDENSED)
def test_the_exact_step_solves_the_whole_system(kind: str) -> None:
    p = unbounded(CONDENSED[kind]())
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


@pytest.mark.parametrize("kind", CONDENSED)
def test_both_subproblems_have_the_gradient_and_the_linearised_defects_of_the_problem(kind: str) -> None:
    p = CONDENSED[kind]()
    x = p.start(0.1 * np.random.default_rng(1).normal(size=p.P))
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


def pulls(H: np.ndarray, g: np.ndarray, d: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Slope (P,) at ``d`` of what may still move: zero at the minimum (Karush, Kuhn and Tucker)."""
    pull = g + H @ d
    stopped = (np.isclose(d, lower) & (pull > 0.0)) | (np.isclose(d, upper) & (pull < 0.0)) | (lower == upper)
    return np.where(stopped, 0.0, pull)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 40), st.floats(0.0, 0.999))
def test_nothing_that_may_move_within_bounds_would_gain(seed: int, count: int, alike: float) -> None:
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((60, count)) * 10 ** rng.uniform(-2, 1, count)
    columns = alike * columns[:, :1] + np.sqrt(1 - alike**2) * columns  # hardly told apart
    H, g = columns.T @ columns + 0.01 * np.eye(count), 20 * rng.standard_normal(count)
    lower, upper = -rng.uniform(0, 1, count) * (rng.random(count) < 0.7), rng.uniform(0.01, 1, count)
    held = rng.random(count) < 0.1
    upper[held] = lower[held]
    upper[~held & (rng.random(count) < 0.1)] = np.inf
    d = within_bounds(H, g, lower, upper)
    assert (d >= lower).all() and (d <= upper).all()
    assert np.abs(pulls(H, g, d, lower, upper)).max() < 1e-6 * np.abs(g).max()


# A fit that was stopped and resumed ends with the values of one that was not
TIMES = {"created", "command", "timings_s", "seconds"}


def fitted(settings: Settings, stop_at: int = 0, resume: FitResult | None = None, effect: str = "") -> FitResult:
    """Six coefficients on one run in 24 windows; Ctrl-C at the iterate ``stop_at`` of all."""
    ship = load_ship("esso_osaka_3m")
    ship = (ship.with_effect(effect) if effect else ship).fixing([s for s in ship.symbols if s not in FREE])
    seen: list[Progress] = []

    def press(event: Progress) -> None:
        seen.append(event)
        INTERRUPTED.requested = INTERRUPTED.requested or len(seen) == stop_at

    options = FitOptions(next_trial=False, instruments=(), resume=resume)
    with interrupts_noted():
        return calibrate(resume.start if resume else ship, coarse_runs()[0][:1], (), settings, options, press)


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in TIMES}
    return [without_times(v) for v in value] if isinstance(value, list) else value


SETTINGS = Settings(window=5.0)


@pytest.fixture(scope="module")
def whole() -> FitResult:
    return fitted(SETTINGS)


@pytest.mark.slow
@pytest.mark.parametrize("stop_at", [1, 4, 7, 9, 10])
def test_ctrl_c_at_any_iterate_changes_no_value(stop_at: int, whole: FitResult, tmp_path: Any) -> None:
    stopped = fitted(SETTINGS, stop_at)
    assert stopped.status == "User_Requested_Stop" and not stopped.converged
    stopped.save(tmp_path / "run")
    resumed = fitted(SETTINGS, resume=read_fit(tmp_path / "run"))
    assert without_times(resumed.to_dict()) == without_times(whole.to_dict())
    assert resumed.ship == whole.ship and resumed.iterate and whole.iterate
    for name, values in whole.iterate.items():
        np.testing.assert_array_equal(resumed.iterate[name], values)


# Sizes of noise from residuals, and solves in turn that use them
def in_turn(p: Problem, **settings: object) -> NoiseSolves:
    return solve_with_noise_estimation(p, p.start(), Settings(**settings), Control())


@pytest.mark.slow
def test_few_windows_come_first_and_known_noise_needs_one_solve() -> None:
    p = problem(window=10.0, trials=runs()[0])
    whole, once = in_turn(p), in_turn(p, sigma=tuple(SIGMA))
    every = len(p.segments.run)
    assert every > 54 and [row["windows"] for row in whole.passes] == [12, 36, every, every]
    assert once.solution.converged and [row["windows"] for row in once.passes] == [every]


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.8, 0.9])  # 0: white
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


# Ctrl-C while it is held: what may be left out ends at once and is named, what may not goes on
def pressed() -> str:
    signal.raise_signal(signal.SIGINT)
    return "went on"


def test_what_may_be_left_out_ends_at_once_and_is_named() -> None:
    with interrupts_noted():
        made = Made()
        make_in_turn({"scores": lambda: None, "profiles": pressed, "figures": lambda: pytest.fail("begun")}, made)
        assert made == {"scores": None} and made.missing == ["profiles", "figures"]
        assert list(made.seconds) == ["scores", "profiles", "figures"]
        assert has_code([left_out_message(made.missing)], LEFT_OUT)


def test_what_may_not_be_left_out_goes_on_and_nothing_is_raised_through_a_library() -> None:
    with interrupts_noted():
        assert pressed() == "went on" and INTERRUPTED.requested
    with interrupts_noted():

        def work() -> str:
            with unbroken():
                seen.append(pressed())
            return "not reached"

        seen: list[str] = []
        assert unless(work) is None and seen == ["went on"]


def test_a_second_ctrl_c_ends_all_and_an_error_of_the_work_is_its_own() -> None:
    with pytest.raises(KeyboardInterrupt), interrupts_noted():
        pressed()
        pressed()
    with interrupts_noted(), pytest.raises(ZeroDivisionError):
        unless(lambda: 1 / 0)
    with pytest.raises(KeyboardInterrupt):  # outside it is raised as usual
        unless(pressed)


def test_the_observer_is_told_when_it_is_held_noted_and_released(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(OBSERVER, "told", told.append)
    with interrupts_noted():
        pressed()
    assert told == ["held", "noted", "released"]

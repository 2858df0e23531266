"""A fit that was stopped and resumed ends with the values of one that was not."""

from __future__ import annotations

import signal
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from fitting.calibrate import FitOptions, calibrate
from fitting.nlp.problem import Problem
from fitting.result import FitResult, read_fit
from fitting.settings import Settings
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
from fitting.solvers.noise import NoiseSolves, Resumption, correlation_time, solve_with_noise_estimation
from mmg.messages import has_code
from mmg.progress import Progress
from tests.support.calibrated import FREE
from tests.support.synthetic_runs import SIGMA, coarse_runs, problem, runs

pytestmark = pytest.mark.usefixtures("blank_figures")
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


@pytest.mark.longest
@pytest.mark.slow
def test_a_wider_iteration_limit_changes_no_value_and_the_same_one_goes_on_from_the_best(whole: FitResult) -> None:
    limited = fitted(Settings(window=5.0, max_iterations=2))
    assert not limited.converged
    resumed = fitted(SETTINGS, resume=limited)
    assert without_times(resumed.to_dict()) == without_times(whole.to_dict())
    settings, found = Settings(window=5.0, max_iterations=4), None
    for _ in range(12):
        found = fitted(settings, resume=found)
        if found.converged:
            break
    assert found and found.converged and found.objective == pytest.approx(whole.objective, rel=0.02)


# Sizes of noise from residuals, and solves in turn that use them
def solved(p: Problem, resumed: Resumption | None = None, draft: bool = False, **settings: object) -> NoiseSolves:
    return solve_with_noise_estimation(p, p.start(), Settings(**settings), Control(), resumed, draft=draft)


@pytest.mark.slow
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

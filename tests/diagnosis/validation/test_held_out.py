"""How far the gap closes on trials that took no part: windows, their errors, and the reduction with its interval."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.refit import SearchProblem, refit
from diagnosis.report.words import held_words
from diagnosis.validation import held_out
from diagnosis.validation.held_out import (
    STRIDE,
    WINDOW,
    compare,
    errors,
    filtered_along,
    likelihood_of,
    scales,
    start_states,
    window_length,
    window_words,
)
from tests.support.diagnosis_cases import (
    OFF_NEUTRAL,
    candidate,
    full_steps,
    pushed_problem,
    pushed_trials,
    theta_of,
)
from tests.support.quick import first_quick

EFFECT = "current:x=0.03,y=-0.02"
H = 0.5
OTHERS = (("zigzag:-20/20", 80.0), ("random:5", 100.0), ("turning:25", 60.0))


def others(runs: tuple[tuple[str, float], ...] = OTHERS, seed: int = 31) -> GriddedTrials:
    """Trials that took no part, with the effect."""
    return grid_trials(pushed_trials(seed, [EFFECT], runs), full_steps(H).ship, H)


@cache
def fits() -> tuple[SearchProblem, Estimate, Estimate]:
    """The training trials, and the fits without and with the effect that they have."""
    problem, null = pushed_problem(1, EFFECT)
    effect = candidate("current")
    start = dict(zip(effect.columns, (0.02, -0.01), strict=True))
    return problem, null, refit(problem, null, [effect], start)


@cache
def closed() -> tuple[GriddedTrials, HeldOut]:
    problem, null, true = fits()
    data = others()
    held = compare((problem.steps, data, null), (problem.steps, data, true))
    assert held is not None
    return data, held


def one_step_likelihood(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> np.ndarray:
    """Of each window of ``data``."""
    here = filtered_along(steps, data, fit)
    assert here is not None
    return likelihood_of(here)


def simulated(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray | None = None) -> GriddedTrials:
    """The windows as the model itself moves from their first rows: no noise, no forces."""
    theta = steps.ship.values if theta is None else theta
    acted = acting(steps, data, theta)
    y, z = data.y.copy(), steps.settled(data.y[0].T, acted.inputs[0].T, theta)
    for k in range(len(data.inputs)):
        z = steps.advance(z, acted.controls[k].T, theta)
        y[k + 1] = z[:6].T
    return replace(data, y=y)


@pytest.mark.slow
def test_what_another_size_of_the_noise_gains_is_no_gain_of_the_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit with an effect has smaller random forces in its own trials, and too small ones in others."""
    problem, null, true = fits()
    data, _ = closed()
    fits_of_sizes = true, replace(true, noise=true.noise.with_(force=0.5 * true.noise.force))
    own, other = (one_step_likelihood(problem.steps, data, fit).sum() for fit in fits_of_sizes)
    assert other == pytest.approx(own, abs=1.0)
    assert one_step_likelihood(problem.steps, data, null).sum() > own + 20
    monkeypatch.setattr(held_out, "FITS", 1)
    once = [one_step_likelihood(problem.steps, data, fit).sum() for fit in fits_of_sizes]
    assert abs(once[1] - once[0]) > 30.0  # what it would count for


REMEMBERED = ("rudder_backlash.b", "rudder_lag.T", "control_delay.tau", "hull_memory.T")


@pytest.mark.parametrize("effect", first_quick(["", *REMEMBERED]))
def test_the_true_model_predicts_its_own_motion_without_error(effect: str) -> None:
    """A window begins with what the actuators and the hull remember of the run before."""
    steps = full_steps(H)
    theta = theta_of(steps, {effect: OFF_NEUTRAL[effect]} if effect else {})
    data = simulated(steps, others(), theta)
    for length in (WINDOW,) if effect else (H, WINDOW, 0.0):
        found = errors(steps, data, theta, length).mean
        assert len(found) and found.max() < (1e-12 if effect else 1e-18)
    if not effect:
        return
    middle = data.steps.min() // 2
    settled = steps.settled(data.y[middle].T, data.inputs[middle].T, theta)  # to the inputs as they were logged
    assert np.abs(start_states(steps, data, theta)[middle].T - settled).max() > 1e-4  # which being settled is not


def test_an_error_counts_in_units_of_its_scale_and_only_where_it_was_measured() -> None:
    steps = full_steps(H)
    data = simulated(steps, others())
    theta, sigma = steps.ship.values, scales(3.0)
    assert sigma[0] == pytest.approx(0.3) and sigma[2] == pytest.approx(np.radians(5.0))
    later = data.y.copy()
    later[1:, :, 0] += 2.0 * sigma[0]
    later[1:, :, 5] -= 1.0 * sigma[5]
    off = replace(data, y=later)
    np.testing.assert_allclose(errors(steps, off, theta, 0.0).mean, (4 + 1) / 6, rtol=1e-9)
    unplaced = data.measured.copy()
    unplaced[..., :2] = False
    np.testing.assert_allclose(errors(steps, replace(off, measured=unplaced), theta, 0.0).mean, 1 / 4, rtol=1e-9)


def test_a_window_every_stride_that_fits_into_its_run_and_begins_at_a_whole_row() -> None:
    steps, data = full_steps(H), others()
    theta = steps.ship.values
    run = errors(steps, data, theta, WINDOW).run
    seconds = data.steps * H
    expected = [int((s - WINDOW) // STRIDE) + 1 for s in seconds]
    assert [int((run == r).sum()) for r in range(3)] == expected and len(run) == sum(expected)
    assert expected == [4, 5, 3]
    holes = data.measured.copy()
    holes[round(STRIDE / H), 0, 4] = False  # the second window of the first run has no start
    run = errors(steps, replace(data, measured=holes), theta, WINDOW).run
    assert int((run == 0).sum()) == expected[0] - 1
    assert list(errors(steps, data, theta, 0.0).run) == [0, 1, 2]


def test_equal_models_close_nothing_and_a_run_shorter_than_a_window_says_nothing() -> None:
    problem, null, true = fits()
    short, long = others((("zigzag:-20/20", 25.0),)), others(OTHERS[:2])
    assert compare((problem.steps, short, null), (problem.steps, short, true)) is None
    held = compare((problem.steps, long, null), (problem.steps, long, null))
    assert held is not None
    assert held.reduction == 0.0 and held.interval_90 == (0.0, 0.0) and held.mse_before == held.mse_after > 0
    assert all(a == b for a, b in [*held.by_run.values(), *held.horizons.values()])


def test_the_true_model_closes_the_gap_and_the_interval_says_so() -> None:
    data, held = closed()
    assert 0.3 < held.reduction < 1.0 and held.mse_after < held.mse_before
    assert 0 < held.interval_90[0] < held.reduction < held.interval_90[1] < 1
    assert set(held.horizons) == {"1 step", "30 s", "whole run"}
    assert all(after < before for before, after in held.horizons.values())
    # the numbers of the runs make up the whole
    assert held.windows == 12 and list(held.by_run) == list(data.trials)
    weights = np.array([4, 5, 3]) / 12
    before, after = (weights @ np.array([pair[i] for pair in held.by_run.values()]) for i in (0, 1))
    assert (held.mse_before, held.mse_after) == pytest.approx((before, after), rel=1e-9)
    assert held.reduction == pytest.approx(1 - after / before, rel=1e-9)
    assert held.metric == "30 s" and held.horizons["30 s"] == (held.mse_before, held.mse_after)
    reductions = [1 - b / a for a, b in held.by_run.values()]
    assert min(reductions) - 1e-12 <= held.interval_90[0] and held.interval_90[1] <= max(reductions) + 1e-12


def test_where_the_ship_explodes_single_steps_say_nothing_and_windows_stay() -> None:
    problem, null, _ = fits()
    data = others(OTHERS[:2])
    exploding = replace(null, theta=theta_of(problem.steps, {"N_r": 5.0}))
    assert filtered_along(problem.steps, data, exploding) is None
    held = compare((problem.steps, data, null), (problem.steps, data, exploding))
    assert held is not None
    assert np.isfinite([held.mse_before, held.mse_after, *held.interval_90]).all() and held.reduction < 0


def test_windows_of_a_large_ship_are_called_by_the_seconds_that_they_have() -> None:
    large = load_ship("kvlcc2_full")
    assert window_words(large) == f"{window_length(large):.0f} s" == "310 s"
    held = replace(closed()[1], metric=window_words(large))
    assert "310 s" in held_words(held, "none")

"""Inputs as they act: a delay moves the record and a lag filters it, exactly, and both have their slopes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.trial import Trial
from diagnosis.estimation.acting_inputs import acting, linearised
from diagnosis.estimation.gridded_trials import PARTS, grid_trials
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import full_model, full_steps, path_near, pushed_trials, short_data, theta_of

H = 1.0


def moved(trial: Trial, delay: float) -> Trial:
    """The trial whose rudder and revolutions were moved ``delay`` seconds later."""
    later = {n: np.interp(trial.t - delay, trial.t, trial[n]) for n in ("n", "delta")}
    return replace(trial, columns={**trial.columns, **later})


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.3, 1.0, 2.7])
def test_a_delay_moves_the_record_of_all_windows_with_what_was_before_them(delay: float) -> None:
    steps = full_steps(H)
    trials = pushed_trials(3, runs=(("random:11", 700.0),))  # more than a window
    names = full_model().ship.inputs
    data = grid_trials(trials, names, 3.0, H, straight=True)
    assert len(data.steps) > 1
    expected = grid_trials([moved(t, delay) for t in trials], names, 3.0, H, straight=True)
    found = acting(steps, data, theta_of(steps, {"control_delay.tau": delay}))
    delta = names.index("delta")
    kept = data.inside
    error = (found.inputs - expected.inputs)[kept]
    assert np.abs(error[:, delta]).max() < 0.02 * np.ptp(data.inputs[kept][:, delta])
    assert np.abs((found.changes - expected.changes)[kept][:, delta]).max() < 0.1 * np.abs(expected.changes).max()
    wind = [names.index(n) for n in ("wind_north", "wind_east")]
    np.testing.assert_array_equal(found.inputs[..., wind], data.inputs[..., wind])
    back = acting(steps, found, steps.ship.values)
    np.testing.assert_allclose(back.inputs, data.inputs, atol=1e-12)
    np.testing.assert_allclose(back.changes, data.changes, atol=1e-12)


def test_a_lag_answers_a_step_as_first_order_systems_do() -> None:
    step, T = 0.05, 0.7
    record = np.concatenate([np.zeros((10, 1, 1)), np.ones((200, 1, 1))])
    found = EFFECTS["rudder_lag"].acted(record, step, T)[10:, 0, 0]
    edges = step * np.arange(201)
    expected = 1 + T / step * np.diff(np.exp(-edges / T))  # mean over each part of 1 - exp(-t / T)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_nothing_is_late_at_neutral_values_and_windows_may_differ() -> None:
    steps, data = full_steps(H), short_data(H)
    assert acting(steps, data, steps.ship.values) is data
    theta = np.repeat(steps.ship.values[:, None], 2, axis=1)
    theta[steps.ship.symbols.index("rudder_lag.T"), 1] = 1.0
    found, alone = acting(steps, data, theta), acting(steps, data, theta[:, 1])
    np.testing.assert_array_equal(found.inputs[:, 0], data.inputs[:, 0])
    np.testing.assert_array_equal(found.inputs[:, 1], alone.inputs[:, 1])
    assert np.abs(alone.inputs[:, 0] - data.inputs[:, 0]).max() > 0.01
    # without a record means and changes stand for it
    late = theta_of(steps, {"control_delay.tau": 0.5})
    found, whole = (acting(steps, some, late) for some in (replace(data, record=None), data))
    delta = full_model().ship.inputs.index("delta")
    assert np.abs(found.inputs - whole.inputs)[1:, :, delta].max() < 0.1
    assert np.abs(found.inputs - data.inputs)[..., delta].max() > 0.1


@pytest.mark.parametrize("symbol", ["control_delay.tau", "rudder_lag.T"])
@pytest.mark.parametrize("value", [0.0, 0.6])
def test_responses_of_a_step_are_those_of_finite_differences(symbol: str, value: float) -> None:
    steps, data = full_steps(H), short_data(H)
    theta = theta_of(steps, {symbol: value})
    path = path_near(steps, data, theta)
    force, every = path.force[:-1], np.arange(steps.S)
    at = steps.symbols.index(symbol)

    def end(changed: float) -> np.ndarray:
        there = theta_of(steps, {symbol: changed})
        return linearised(steps, data, there, path.z, force, [], every).end

    G = linearised(steps, data, theta, path.z, force, [steps.symbols.index("Y_v"), at], every).G[..., 1]
    small = H / PARTS
    low = value - small if value > 0 or EFFECTS[symbol.split(".")[0]].acts_before else value
    expected = (end(value + small) - end(low)) / (value + small - low)
    exist = data.inside
    np.testing.assert_allclose(G[exist], expected[exist], atol=1e-9 * np.abs(expected[exist]).max())
    assert np.abs(G[exist]).max() > 1e-3

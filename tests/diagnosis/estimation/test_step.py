"""What the grid leaves of the trials: inputs that change within a step, whole samples, steps as fine as needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.trial import Trial
from diagnosis.estimation.gridded_trials import can_divide, grid_trials
from diagnosis.estimation.linearisation import TIMING, Point, initial_trajectory, timing_columns
from diagnosis.estimation.noise_sizes import MOST, initial_noise, swallows
from diagnosis.estimation.parameters import NO_PRIORS
from diagnosis.estimation.residual_checks import finer_step
from tests.support.diagnosis_cases import SHIP, full_steps, pushed_problem, pushed_trials


def ramp(rate: float = 0.01, dt: float = 0.1) -> Trial:
    """A trial whose rudder rises at a ``rate`` [rad/s], sampled every ``dt`` [s]."""
    trial = pushed_trials(1, runs=(("zigzag:20/20", 40.0),))[0]
    t = np.arange(0.0, 40.0, dt)
    columns = {k: np.interp(t, trial.t, v) for k, v in trial.columns.items()} | {"t": t, "delta": rate * t}
    return replace(trial, columns=columns)


def test_an_input_that_rises_steadily_changes_over_a_step_by_its_rate() -> None:
    data = grid_trials([ramp()], SHIP.inputs, 3.0, 1.0, straight=True)
    inside = data.inside[:, 0]
    i = SHIP.inputs.index("delta")
    np.testing.assert_allclose(data.changes[inside, 0, i], 0.01, rtol=0.03)
    assert data.controls.shape[2] == 2 * data.inputs.shape[2] and data.sample == pytest.approx(0.1)


def test_a_step_under_a_rising_input_is_that_of_many_short_ones() -> None:
    steps, short = full_steps(1.0), full_steps(0.1)
    theta, C = steps.ship.values, steps.C
    mean, rise = np.zeros((C, 1)), np.zeros((C, 1))
    n, delta = (steps.model.controls.index(name) for name in ("n", "delta"))
    mean[n], mean[delta], rise[delta] = 9.0, 0.2, 0.2
    z = steps.settled(np.array([[0.0, 0.0, 0.3, 0.4, 0.01, 0.005]]).T, mean, theta)
    whole, held, fine = steps.advance(z, np.vstack([mean, rise]), theta), steps.advance(z, mean, theta), z
    for k in range(10):
        fine = short.advance(fine, mean + rise * ((k + 0.5) / 10 - 0.5), theta)
    off, before = (np.abs(x - fine)[:6].max() for x in (whole, held))
    assert off < 0.1 * before


def test_quiet_sensors_ask_for_finer_steps_and_noisy_ones_do_not() -> None:
    problem, null = pushed_problem(1, h=1.0)
    assert finer_step(problem.steps, problem.data, null, 0.25) is None
    quieter = replace(null, noise=null.noise.with_(white=0.02 * null.noise.white))
    finer = finer_step(problem.steps, problem.data, quieter, 0.25)
    assert finer is not None and finer < 1.0 and finer % 0.25 == pytest.approx(0.0)
    # held over samples of 0.45 s, a random force passed for a memory of the hull where sensors were quiet
    assert finer_step(problem.steps, problem.data, quieter, 1.0) is None
    finer = finer_step(problem.steps, problem.data, quieter, 1.0, divisible=True)
    assert finer is not None and 1.0 / finer == pytest.approx(round(1.0 / finer)) and 0.25 <= finer < 0.9


def test_states_are_compared_where_they_were_measured_and_uneven_samples_are_not_divided() -> None:
    trial = ramp(dt=0.6)
    whole, parts = (grid_trials([trial], SHIP.inputs, 3.0, h) for h in (0.6, 0.2))
    assert whole.steps_of_sample == 1 and parts.steps_of_sample == 3
    assert parts.measured[::3].all() and not parts.measured[1::3].any() and not parts.measured[2::3].any()
    np.testing.assert_allclose(parts.y[::3], whole.y, atol=1e-12)
    np.testing.assert_array_equal(parts.thinned(4).good[::3], whole.thinned(4).good)
    trial = ramp(dt=0.5)
    assert can_divide([trial], 0.5) and not can_divide([trial, ramp(dt=0.3)], 0.5)
    late = trial.t + 0.1 * np.sin(np.arange(len(trial.t)))
    assert not can_divide([replace(trial, columns={**trial.columns, "t": late})], 0.5)


def test_a_force_beyond_all_that_moves_the_ship_swallows_it() -> None:
    noise = initial_noise(SHIP)
    assert not swallows(noise, SHIP) and swallows(noise.with_(force=0.9 * MOST * noise.force), SHIP)


def test_timing_columns_are_what_a_late_input_does() -> None:
    """A rudder that acts TIMING of a sample late is behind by that share of its rate."""
    steps = full_steps(1.0)
    data = grid_trials([ramp(dt=0.5)], steps.ship.inputs, 3.0, 1.0, straight=True)
    path = initial_trajectory(steps, data, steps.ship.values)
    point = Point(steps.ship.values, NO_PRIORS, np.zeros(0), path, initial_noise(steps.ship))
    found = timing_columns(steps, data, point, np.arange(6))
    i = steps.model.controls.index("delta")
    late = data.inputs.copy()
    late[..., i] -= 0.01 * TIMING * 0.5
    K, R = late.shape[:2]
    z = path.z[:-1].reshape(K * R, -1).T
    ends = [steps.advance(z, c.reshape(K * R, -1).T, steps.ship.values) for c in (late, data.inputs)]
    expected = (ends[0] - ends[1])[:6].T.reshape(K, R, 6)
    inside = data.inside
    np.testing.assert_allclose(found[inside][:, :, 1], expected[inside], atol=0.05 * np.abs(expected).max())
    assert not timing_columns(steps, replace(data, sample=0.0), point, np.arange(6)).size

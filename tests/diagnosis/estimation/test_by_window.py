"""Coefficients by window: columns of one run, steps and likelihood with values of their own in each run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.candidates import Column
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.linearisation import Point, initial_covariance, initial_trajectory, linearise_and_filter
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import Priors, get_values, set_values
from tests.support.diagnosis_cases import (
    OFF_NEUTRAL,
    RUNS,
    full_model,
    full_steps,
    off_neutral,
    pushed_trials,
    short_data,
    theta_of,
)

H = 1.0
Y_V, CURRENT_0 = Column("Y_v"), Column("current.x", 0)


def three_windows() -> GriddedTrials:
    """Three windows of short runs without any effect, of which the first two are of one run."""
    data = grid_trials(pushed_trials(1, runs=tuple((m, 40.0) for m, _ in RUNS)), full_model().ship.inputs, 3.0, H)
    return replace(data, run=np.array([0, 0, 1]), trials=data.trials[:2])


def window(data: GriddedTrials, r: int) -> GriddedTrials:
    """One window alone."""
    only = slice(r, r + 1)
    cut = {k: getattr(data, k)[:, only] for k in ("t", "y", "good", "measured", "inputs", "changes", "record")}
    return replace(data, steps=data.steps[only], run=data.run[only], **cut)


def test_values_placed_by_run_change_that_runs_windows_alone_and_are_read_again() -> None:
    data, ship = three_windows(), full_model().ship
    columns, values = (Y_V, CURRENT_0, Column("current.y", 1), Column("tow.X", 1)), np.array([-0.4, 0.03, -0.02, 0.5])
    theta = set_values(ship, data, ship.values, columns, values)
    assert theta.shape == (len(ship.symbols), 3)
    expected = np.repeat(ship.values[:, None], 3, axis=1)
    for symbol, value, windows in (
        ("Y_v", -0.4, [0, 1, 2]), ("current.x", 0.03, [0, 1]), ("current.y", -0.02, [2]), ("tow.X", 0.5, [2])
    ):  # fmt: skip
        expected[ship.symbols.index(symbol), windows] = value
    np.testing.assert_array_equal(theta, expected)
    np.testing.assert_allclose(get_values(ship, data, theta, columns), values, rtol=1e-15)
    # a symbol of the ship is its mean over the windows, and what was there is no longer where it is placed for all
    assert get_values(ship, data, theta, [Column("current.x")])[0] == pytest.approx(0.02)
    again = set_values(ship, data, theta, [Column("current.x"), Column("current.y", 0)], np.array([0.01, 0.04]))
    np.testing.assert_array_equal(again[ship.symbols.index("current.x")], 0.01)
    np.testing.assert_array_equal(again[ship.symbols.index("current.y")], [0.04, 0.04, -0.02])


def by_window() -> tuple[GriddedTrials, np.ndarray]:
    """Two windows, in one of which all effects act and in the other some of them otherwise: (all, 2) coefficients."""
    steps = full_steps(H)
    second = {k: -0.5 * v for k, v in OFF_NEUTRAL.items() if k.split(".")[0] in ("current", "tow", "antenna_offset")}
    second |= {"rudder_lag.T": 1.5, "control_delay.tau": 0.2, "hull_memory.T": 2.0, "Y_v": -0.3}
    return short_data(H), np.column_stack([off_neutral(steps), theta_of(steps, second)])


def test_a_likelihood_with_coefficients_by_window_is_the_sum_of_those_of_the_windows() -> None:
    steps, (data, theta) = full_steps(H), by_window()
    noise, every = initial_noise(steps.ship), np.arange(steps.S)
    path = initial_trajectory(steps, data, theta)
    columns = (Y_V, CURRENT_0, Column("tow.N", 1))
    free = Priors(columns, np.zeros(3), np.array([0.1, 0.02, 0.05]), np.full(3, -np.inf), np.full(3, np.inf))
    nowhere = np.zeros(3)
    both = linearise_and_filter(steps, data, Point(theta, free, nowhere, path, noise), every)
    start, total = initial_covariance(steps, data, path.z[0], theta, every), 0.0
    for r in range(2):
        own, w = window(data, r), slice(r, r + 1)
        z = initial_trajectory(steps, own, theta[:, r])
        np.testing.assert_allclose(path.z[:, w], z.z, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(start[w], initial_covariance(steps, own, z.z[0], theta[:, r], every), rtol=1e-9)
        alone = linearise_and_filter(steps, own, Point(theta[:, r], free, nowhere, z, noise), every)
        np.testing.assert_allclose(both.white[:, w], alone.white, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(both.logdet_gradient[w], alone.logdet_gradient, rtol=1e-6, atol=1e-8)
        total += alone.nll
    assert both.nll == pytest.approx(total, rel=1e-10)
    for r, silent in ((0, 2), (1, 1)):  # the column of the other run
        assert not both.white[:, r, :, silent].any() and both.logdet_gradient[r, silent] == 0
        assert both.white[:, r, :, 3 - silent].any()

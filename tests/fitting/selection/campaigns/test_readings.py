"""Readings of the kinematics as data on constants of campaigns: the same as a prior, and gone with their run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cases.shipfiles.ship_file import load_ship
from fitting.nlp.fisher_information import Information
from fitting.nlp.run_constants import ByCampaign, prior_with
from fitting.selection.campaigns.candidates import with_constants
from fitting.selection.campaigns.readings import (
    ReadConstant,
    RunReadings,
    readings_as_rows,
    reduced_with,
    with_readings,
)
from fitting.selection.left_out_runs import estimates_without

NUMBER = np.array([0, 0, 1, 1])
READ = RunReadings(np.array([0.1, 0.3, 1.0, np.nan]), np.array([0.1, 0.1, 0.2, np.nan]), NUMBER)
OWN = ByCampaign(("gyro.T",), ("spring", "autumn"), tuple(NUMBER), {"gyro.T": READ.of_campaigns(2)})


def windows(p: np.ndarray) -> Information:
    """Four windows of four runs that say little of two constants behind a shared coefficient."""
    fisher = np.zeros((4, 3, 3))
    fisher[:, 0, 0] = 4.0
    fisher[np.arange(4), 1 + NUMBER, 1 + NUMBER] = 0.5
    score = (fisher @ (p - 0.2)[:, None])[:, :, 0]
    return Information(fisher, score, p, np.arange(4), ("Y_v", "T@0", "T@1"), np.eye(3), p.copy())


def test_runs_of_a_campaign_are_averaged_by_their_precision_and_one_without_reading_says_nothing() -> None:
    (first, std), (second, other) = READ.of_campaigns(2)
    np.testing.assert_allclose([first, std, second, other], [0.2, 0.1 / np.sqrt(2), 1.0, 0.2])
    assert RunReadings(np.full(2, np.nan), np.full(2, np.nan), np.array([0, 1])).of_campaigns(2)[1][1] == np.inf


def test_what_is_told_of_campaigns_multiplies_the_prior_of_their_distribution() -> None:
    ship = with_constants(load_ship("esso_osaka_3m"), ("gyro.T",), (0.5,), (0.4,))
    told, bare = prior_with(ship, OWN, ()), prior_with(ship, replace(OWN, told={}), ())
    precision = np.array([200.0, 25.0]) + 1 / 0.4**2
    np.testing.assert_allclose(told.std[-2:], precision**-0.5)
    np.testing.assert_allclose(told.mean[-2:], (np.array([0.2 * 200, 1.0 * 25]) + 0.5 / 0.4**2) / precision)
    np.testing.assert_array_equal(told.mean[:-2], bare.mean[:-2])
    np.testing.assert_allclose(bare.std[-2:], 0.4)


def test_as_rows_the_estimate_is_the_same_and_a_run_left_out_takes_its_reading_along() -> None:
    ship = with_constants(load_ship("esso_osaka_3m"), ("gyro.T",), (0.5,), (0.4,))
    prior = prior_with(ship.fixing([s for s in ship.free if s != "Y_v"]), OWN, ())
    info = windows(np.array([0.3, 0.1, -0.2]))
    rows = readings_as_rows(info, prior, OWN, {"gyro.T": READ})
    bounds = (np.full(3, -1e3), np.full(3, 1e3))
    whole, alone = (estimates_without(i, [(), (2,), (3,)], bounds) for i in (info, rows))
    np.testing.assert_allclose(alone[0], whole[0], atol=1e-9)
    np.testing.assert_allclose(alone[2], whole[2], atol=1e-9)
    mean, std = prior.mean[-1], prior.std[-1]
    weight = 0.5 / std**2  # of the window that is left, which says mean + 0.2 std
    left = (weight * (mean + 0.2 * std) + 0.5 / 0.4**2) / (weight + 1 / 0.4**2)
    np.testing.assert_allclose(mean + std * alone[1, 2], left, atol=1e-9)
    assert mean + std * whole[1, 2] > left + 0.05


def test_a_reading_is_a_quadratic_about_its_value_whatever_the_dispersion_of_the_windows() -> None:
    info = windows(np.zeros(3))
    read = [ReadConstant(READ, np.array([1, 2]), np.array([0.5, 0.5]), np.array([0.3, 0.3]))]
    bare, told = (reduced_with(info, r, np.array([1, 2]), 4.0) for r in ([], read))
    np.testing.assert_allclose(np.diag(told.A - bare.A), 0.3**2 * np.array([200.0, 25.0]))
    value = 0.5 + 0.3 * -np.linalg.solve(told.A - bare.A, told.b - bare.b)
    np.testing.assert_allclose(value, [0.2, 1.0])
    assert with_readings(info, []) is info

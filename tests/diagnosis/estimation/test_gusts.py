"""Gusts that the anemometer does not show: what they push by, their size and memory, and that they are no finding."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.simulation.gusts import Wind
from cases.simulation.simulate import simulate
from cases.trial import Trial
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.gusts import with_gusts
from diagnosis.estimation.linearisation import initial_trajectory
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import BESIDE_GUSTS, LEAST_FORCE, initial_noise, least_force
from diagnosis.estimation.residual_checks import with_correlation_time, with_gust_memory
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.judgement.budget import simulated_trials
from tests.support.diagnosis_cases import FEW, FREE, SHIP, full_steps, priors_of, quiet
from tests.support.disturbed_trials import disturbed_trial, drawn_ship, process

RUNS = (("zigzag:20/20", 120.0), ("random:11", 120.0), ("turning:-20", 120.0), ("random:5", 120.0))
GUST, MEMORY, STEP = 0.15, 1.0, 0.2
WINDS = ((1.0, 0.3), (2.0, 2.0), (3.0, 4.0), (2.5, 5.5))
"""Speed [m/s] and direction [rad] of the steady wind that the logs show."""


def blown_trials(seed: int, share: float = GUST) -> list[Trial]:
    """Runs of a ship with small random forces in wind that swings about what is logged by a ``share`` of it."""
    trials, ship = [], drawn_ship(FEW, seed)
    for number, ((words, seconds), (speed, direction)) in enumerate(zip(RUNS, WINDS, strict=True)):
        maneuver = parse_maneuver(words, ship, n=10.0, duration=seconds)
        clean = simulate(ship, maneuver, 0.1, Wind(speed, direction), seed, maneuver.start)
        rng = np.random.default_rng([seed, number])
        felt = clean["wind_speed"] * np.maximum(1 + share * process(len(clean.t), 0.1, MEMORY, rng), 0.1)
        real = replace(clean, columns={**clean.columns, "wind_speed": felt})
        seen = disturbed_trial(ship, real, quiet(X=0.005, Y=0.015, N=0.01), 10 * seed + number)
        logged = {**seen.columns, "wind_speed": clean["wind_speed"]}
        trials.append(replace(seen, columns=logged, name=f"run_{number}"))
    return trials


@lru_cache(maxsize=2)
def blown(share: float = GUST) -> GriddedTrials:
    """Such trials on a grid, with what gusts push by."""
    steps = full_steps(STEP)
    return with_gusts(steps, grid_trials(blown_trials(3, share), steps.ship.inputs, 3.0, STEP))


@lru_cache(maxsize=2)
def fitted(with_them: bool) -> tuple[GriddedTrials, Estimate]:
    """The fit with gusts among the random forces, or without."""
    steps, data = full_steps(STEP), blown() if with_them else replace(blown(), gusts=None)
    start = initial_point(steps, data, steps.ship.values, priors_of(SHIP, FREE), initial_noise(steps.ship))
    found = with_correlation_time(steps, data, estimate(steps, data, start, iterations=12))
    return data, with_gust_memory(steps, data, found)


def test_a_gust_pushes_as_a_stronger_wind_does() -> None:
    """Of the ship's own wind force, once more through the equations of motion."""
    steps, data = full_steps(STEP), blown()
    assert data.gusts is not None
    k, at = 200, [steps.model.controls.index(name) for name in ("wind_north", "wind_east")]
    z = steps.settled(data.y[k].T, data.inputs[k].T, steps.ship.values)
    every = steps.coefficients(steps.ship.values, np.zeros((3, data.y.shape[1])))
    for gust, turned in ((0.02, False), (-0.03, True)):
        air = data.inputs[k].T.copy()
        north, east = air[at]
        air[at] += gust * np.array([-east, north] if turned else [north, east])
        push = gust * data.gusts[k, :, :, int(turned)].T
        blown_rates, rates = steps.rates(z, air, every)[0], steps.rates(z, data.inputs[k].T, every)[0]
        pushed_rates = steps.rates(z, data.inputs[k].T, steps.coefficients(steps.ship.values, push))[0]
        change = blown_rates - rates
        assert np.abs(change[:, 3:6]).max() > 1e-6
        assert (np.abs(pushed_rates - rates - change) <= 0.05 * np.abs(change).max(axis=0)).all()


@pytest.mark.slow
def test_their_size_and_memory_are_found() -> None:
    """The wind's own speed along it, little across; the random force stays as small as gusts leave it."""
    (data, found), typical = fitted(True), initial_noise(full_steps(STEP).ship)
    noise = found.noise
    assert noise.gust[0] == pytest.approx(GUST, rel=0.25) and noise.gust[1] < 0.4 * GUST
    assert 0.4 * MEMORY < noise.gust_tau < 2.5 * MEMORY
    assert (noise.force < np.maximum(0.03 * typical.force, 1.1 * least_force(noise, data, typical))).all()


@pytest.mark.slow
def test_they_leave_a_share_of_their_force_to_the_random_force() -> None:
    """In a single run the fit would leave nothing, and everything would look sure."""
    steps, data = full_steps(STEP), blown()
    assert data.gusts is not None
    typical, noise = initial_noise(steps.ship), fitted(True)[1].noise
    least = least_force(noise.with_(gust=np.array([0.1, 0.0])), data, typical)
    expected = BESIDE_GUSTS * 0.1 * np.sqrt((data.gusts[data.inside] ** 2).mean(axis=0))[:, 0]
    np.testing.assert_allclose(least, np.maximum(expected, LEAST_FORCE * typical.force))
    assert (noise.force >= 0.9 * least_force(noise, data, typical)).all()  # of gusts one step before
    np.testing.assert_array_equal(least_force(noise, replace(data, gusts=None), typical), LEAST_FORCE * typical.force)


@pytest.mark.slow
def test_campaigns_that_are_simulated_have_them_as_well() -> None:
    data, found = fitted(True)
    steps = full_steps(STEP)
    (seen,) = simulated_trials(steps, data, found, 1, np.random.default_rng(1))
    again = estimate(steps, seen, replace(found, path=initial_trajectory(steps, seen, found.theta)), 8)
    assert again.noise.gust[0] == pytest.approx(found.noise.gust[0], rel=0.3)


@pytest.mark.slow
def test_what_they_do_is_no_finding() -> None:
    """Without them among the random forces it is one: the likelihood asks for them."""
    steps, (data, found), bare = full_steps(STEP), fitted(True), fitted(False)[1]
    assert found.nll < bare.nll - 20.0
    assert unnamed_forms(steps, data, found).evidence < ODDS

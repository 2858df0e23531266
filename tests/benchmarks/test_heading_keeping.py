"""Heading-keeping: the loop against a plain one, the worst particle of a linear ship, the figure, random controls."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ensembles.fixed_ship import FixedShip
from benchmarks.ensembles.heading_keeping import (
    LOST,
    HeadingKeeping,
    Judgement,
    costs,
    grid,
    headings,
    judge,
    random_winds,
)
from benchmarks.ensembles.heading_keeping_figure import judgement_plot
from benchmarks.random_controls import RandomControls, random_control_trials
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import Wind
from fitting.prediction.score import pooled_sigma
from tests.support import hybrids
from tests.support.yaw import INPUTS, Yaw

CALM = HeadingKeeping(speed=0.5, n=10.0, winds=(Wind(0.0),), seconds=60.0, h=0.5, rate=10.0)
PAIRS = grid(np.array([0.5, 2.0, 8.0]), np.array([1.0, 10.0]))


def test_the_worst_particle_of_a_linear_ship_is_the_slowest_to_answer() -> None:
    """With the same gains a yaw that answers less to its rudder comes back to its heading later."""
    members = [Yaw(0.05, 1.0), Yaw(0.005, 1.0), Yaw(0.1, 1.0)]
    found = judge(members, members[0], INPUTS, PAIRS[[1]], CALM)
    assert found.particles.shape == (3, 1)
    assert int(np.argmax(found.particles[:, 0])) == 1
    assert found.worst[0] == found.particles[1, 0] > 1.3 * found.true[0]
    assert found.true[0] == pytest.approx(found.particles[0, 0], rel=1e-12)
    assert found.overestimated(found.worst) == 0.0 < found.overestimated(found.particles[2])


def test_the_loop_is_that_of_the_pd_law_with_limits() -> None:
    """Against a plain loop of one run: order from psi and r, clipped, at a limited rate, held over the step."""
    ship, (kp, kd) = Yaw(0.1, 3.0), (2.0, 1.5)
    task = replace(CALM, heading=0.3, error=0.5, limit=0.4, rate=0.3)
    psi, r, delta, expected = 0.8, 0.0, 0.0, [0.5]
    for _ in range(task.steps):
        order = min(max(-kp * (psi - 0.3) - kd * r, -0.4), 0.4)
        delta += min(max(order - delta, -0.15), 0.15)
        end = 0.1 * delta
        psi, r = psi + end * 0.5 + (r - end) * 3 * (1 - math.exp(-0.5 / 3)), end + (r - end) * math.exp(-0.5 / 3)
        expected.append(psi - 0.3)
    found = headings([ship], INPUTS, np.array([[kp, kd]]), task)[:, 0, 0, 0]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_gains_and_winds_do_not_mix() -> None:
    """Columns of one call are those of separate calls, in wind that pushes."""
    true = FixedShip(hybrids.ship())
    winds = random_winds(2, (1.0, 2.0), 0)
    task = replace(CALM, winds=winds, seconds=20.0)
    together = headings([true, true], hybrids.ship().inputs, PAIRS, task)
    assert together.shape == (41, 2, 6, 2)
    for w in range(2):
        single = headings([true], hybrids.ship().inputs, PAIRS[[3]], replace(task, winds=winds[w : w + 1], seed=w))
        np.testing.assert_allclose(together[:, 1, 3, w], single[:, 0, 0, 0], atol=1e-12)
    assert np.abs(together[..., 0] - together[..., 1]).max() > 1e-4


def test_a_run_that_is_lost_costs_more_than_any_other() -> None:
    errors = np.full((5, 1, 2, 1), 0.1)
    errors[3:, 0, 1, 0] = np.nan
    found = costs(errors)
    assert found[0, 0] == pytest.approx(0.1)
    assert found[0, 1] == LOST
    assert costs(np.full((5, 1, 1, 1), 50.0))[0, 0] <= LOST


@pytest.mark.parametrize("sampling", ["ts1", "ts-infinity"])
def test_the_judgement_is_reproducible(sampling: str) -> None:
    members = [Yaw(0.1, 2.0), Yaw(0.02, 2.0)]
    one, two = (judge(members, members[0], INPUTS, PAIRS, CALM, 4, sampling).particles for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert one.shape == (4, 6)


def test_random_controls_stay_in_their_range_and_move_every_actuator() -> None:
    ship, how = load_ship("vectwin_3m"), RandomControls(seconds=60.0, rudder=60.0)
    trials = random_control_trials(ship, 2, 0, how)
    for trial in trials:
        for name, low, high in (("delta_port", -105, 35), ("delta_starboard", -35, 105)):
            degrees = np.degrees(trial[name])
            assert low - 1e-9 <= degrees.min() < degrees.max() <= high + 1e-9
            changes = np.flatnonzero(np.diff(degrees)) + 1
            assert set(trial.t[changes]) <= set(np.arange(10.0, 61.0, 10.0))
        assert np.ptp(trial["n_bow"]) > 0 and np.ptp(trial["wind_speed"]) > 0 and np.ptp(trial["n"]) == 0
    again = random_control_trials(ship, 2, 0, how)
    np.testing.assert_array_equal(again[1]["r"], trials[1]["r"])
    assert np.abs(trials[0]["r"] - trials[1]["r"]).max() > 0


def test_the_spread_of_states_can_be_taken_from_trials_of_any_actuators() -> None:
    trials = random_control_trials(load_ship("vectwin_3m"), 1, 0, RandomControls(seconds=30.0))
    assert pooled_sigma(trials)[5] == pytest.approx(trials[0]["r"].std())


def test_the_figure_marks_promises_that_are_too_good() -> None:
    gains = grid(np.array([0.5, 1.0]), np.array([1.0, 2.0, 4.0]))
    true = np.radians([2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    particles_ = np.stack([true, true])
    particles_[:, 2] *= 0.5
    figure = judgement_plot(
        {"few": Judgement(gains, particles_, true)}, np.array([0.5, 1.0]), np.array([1.0, 2.0, 4.0])
    )
    truth, single, worst = figure.axes[:3]
    assert [np.asarray(ax.lines[0].get_xdata()).size for ax in (truth, single, worst)] == [0, 1, 1]
    assert np.asarray(worst.lines[0].get_xydata()).tolist() == [[4.0, 0.5]]

"""KVLCC2 in the standard manoeuvres against a reference simulation of the same equations."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest

from cases.criteria.figures import since, turning_figures
from cases.criteria.standard_runs import figures_of
from cases.maneuvers.definitions import Maneuver, parse_maneuver
from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.model import assemble

APPROACH = {"kvlcc2_l7": (1.179, 15.82), "kvlcc2_full": (7.9739, 2.34)}
"""Speed [m/s] and rudder rate [deg/s]."""

TURNS = {
    ("kvlcc2_l7", 35): (3.077, 1.325, 3.109),
    ("kvlcc2_l7", -35): (3.088, 1.325, 3.094),
    ("kvlcc2_full", 35): (2.976, 1.270, 3.004),
    ("kvlcc2_full", -35): (3.001, 1.281, 3.013),
}
STEADY = {"kvlcc2_l7": (0.381, 0.865, 19.1), "kvlcc2_full": (0.377, 0.890, 19.4)}
ZIGZAGS = {
    ("kvlcc2_l7", 10): (5.1, 14.1),
    ("kvlcc2_l7", -10): (7.3, 9.0),
    ("kvlcc2_l7", 20): (10.6, 16.0),
    ("kvlcc2_l7", -20): (13.9, 11.8),
    ("kvlcc2_full", 10): (4.9, 13.3),
    ("kvlcc2_full", -10): (7.1, 8.6),
    ("kvlcc2_full", 20): (10.5, 15.6),
    ("kvlcc2_full", -20): (13.7, 11.5),
}
LAST_DIGIT = 0.055
"""Overshoots are printed with one decimal [deg]; the smooth model is up to 0.005 deg off the exact one."""


def maneuvered(name: str, text: str, dt: float) -> tuple[Maneuver, Trial]:
    """A manoeuvre from the approach of the reference; dt in L/U."""
    speed, rate = APPROACH[name]
    ship = load_ship(name)
    maneuver = parse_maneuver(text, ship, speed=speed, rudder_rate=np.radians(rate))
    return maneuver, simulate(ship, maneuver, dt=dt * ship.particulars["L"] / speed)


@pytest.mark.parametrize(("name", "rudder_angle"), TURNS)
def test_turning_circles(name: str, rudder_angle: int) -> None:
    """Advance, transfer, tactical diameter by L within 1 % of the reference simulation; 0.05 % measured."""
    maneuver, trial = maneuvered(name, f"turning:{rudder_angle}", 0.005)
    figures = turning_figures(since(trial, maneuver.parameters["order_time"]), maneuver.parameters["rudder"])
    L = load_ship(name).particulars["L"]
    got = [figures[key] / L for key in ("advance", "transfer", "tactical_diameter")]
    np.testing.assert_allclose(got, TURNS[name, rudder_angle], rtol=0.01)
    if rudder_angle > 0:
        u, v, r = trial.states[-1, 3:]
        steady = np.hypot(u, v) / maneuver.speed, r * L / np.hypot(u, v), np.degrees(np.arctan2(-v, u))
        np.testing.assert_allclose(steady, STEADY[name], rtol=0.01)


@cache
def ramp_step(name: str) -> ca.Function:
    """One Runge-Kutta step with the rudder moving evenly from one angle to the other; the smooth model."""
    ship = load_ship(name)
    n = revolutions_for(ship, APPROACH[name][0])
    rates = assemble(ship, symbols=()).rates
    z, before, after, h = ca.SX.sym("z", 6), ca.SX.sym("before"), ca.SX.sym("after"), ca.SX.sym("h")

    def f(state, delta):
        return rates(state, ca.vertcat(n, delta, 0, 0), [])

    k1 = f(z, before)
    k2 = f(z + h / 2 * k1, (before + after) / 2)
    k3 = f(z + h / 2 * k2, (before + after) / 2)
    k4 = f(z + h * k3, after)
    return ca.Function("step", [z, before, after, h], [z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)], {"cse": True})


def overshoots(name: str, degrees: int, step: float) -> tuple[float, float]:
    """First two overshoots [deg] when the heading is looked at every ``step`` L/U, as the reference does."""
    speed, rate = APPROACH[name]
    h = step * load_ship(name).particulars["L"] / speed
    state, delta, side, peaks = np.array([0, 0, 0, speed, 0, 0.0]), 0.0, np.sign(degrees), [0.0]
    angle = np.radians(abs(degrees))
    advance = ramp_step(name)
    while len(peaks) < 4:
        if side * state[2] >= angle:
            side = -side
            peaks.append(0.0)
        order = side * angle
        reached = delta + np.clip(order - delta, -np.radians(rate) * h, np.radians(rate) * h)
        state = np.array(advance(state, delta, reached, h)).ravel()
        delta = reached
        peaks[-1] = max(peaks[-1], -side * state[2])
    return float(np.degrees(peaks[1] - angle)), float(np.degrees(peaks[2] - angle))


@pytest.mark.parametrize(("name", "degrees"), ZIGZAGS)
def test_zigzag_overshoots_sampled_as_in_the_reference(name: str, degrees: int) -> None:
    """Within 1 % of the reference simulation, and to its printed decimal: steps of 0.01 L/U, rudder in ramps."""
    got = overshoots(name, degrees, 0.01)
    np.testing.assert_allclose(got, ZIGZAGS[name, degrees], rtol=0.01)
    np.testing.assert_allclose(got, ZIGZAGS[name, degrees], atol=LAST_DIGIT, rtol=0)


@pytest.mark.parametrize(("name", "degrees"), [("kvlcc2_l7", 10), ("kvlcc2_full", -20)])
def test_zigzag_overshoots_of_the_library(name: str, degrees: int) -> None:
    """With fine steps the counter order is not late: within 3 % of the reference, 1 % of the same in ramps.

    The reference sees the heading every 0.01 L/U (0.06 s of the model): its counter orders are up to that much
    late, which is 0.1 deg of overshoot, 2.4 % of 7.3 deg. Smoothing is no part of it: exact branches give the
    same to 0.2 %.
    """
    maneuver, trial = maneuvered(name, f"zigzag:{degrees}/{abs(degrees)}", 0.004)
    figures = figures_of(trial, maneuver)
    got = np.degrees([figures["overshoot_1"], figures["overshoot_2"]])
    np.testing.assert_allclose(got, ZIGZAGS[name, degrees], rtol=0.03)
    np.testing.assert_allclose(got, overshoots(name, degrees, 0.002), rtol=0.01)

"""Direct spiral and pull-out: what is ordered, when it goes on, and what the curve says of the ship."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cases.criteria.figures import pull_out_figures, since, spiral_curve, spiral_figures, steady_rates
from cases.criteria.measured_maneuvers import held_stretches
from cases.criteria.standard_runs import check_completeness, simulated_run
from cases.maneuvers.definitions import STEADY_CHANGE, parse_maneuver
from cases.maneuvers.orders import StepOrders, spiral_angles
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial

SHIP = load_ship("esso_osaka_3m")


@pytest.mark.parametrize(
    ("largest", "step", "degrees"),
    [(15, 5, [15, 10, 5, 0, -5, -10, -15, -10, -5, 0, 5, 10, 15]), (-6, 6, [-6, 0, 6, 0, -6])],
)
def test_spiral_goes_to_the_other_side_and_back(largest: float, step: float, degrees: list[float]) -> None:
    np.testing.assert_allclose(np.degrees(spiral_angles(math.radians(largest), math.radians(step))), degrees, atol=1e-9)


def test_next_angle_waits_until_the_turn_rate_is_steady() -> None:
    """Turn rate 0.1 (1 - exp(-t / 10)): it changes by 0.001 in the 5 s before 10 ln(64.87) = 41.7 s."""
    orders = StepOrders(10.0, 0.0, (0.2, 0.0), 5.0, 0.001)
    state = np.zeros(6)
    switched = None
    for t in np.arange(0.0, 60.0, 0.1):
        state[5] = 0.1 * (1 - math.exp(-t / 10))
        order = orders(t, state)
        assert order is not None
        if order[1] == 0.0:
            switched = t
            break
    assert switched == pytest.approx(10 * math.log(0.1 * math.expm1(0.5) / 0.001), abs=0.11)


@pytest.fixture(scope="module")
def esso() -> Trial:
    return simulate(SHIP, parse_maneuver("spiral:15/5", SHIP, speed=0.38), 0.25)


def test_every_angle_of_the_spiral_is_held_until_steady(esso: Trial) -> None:
    maneuver = parse_maneuver("spiral:15/5", SHIP, speed=0.38)
    run = since(esso, maneuver.parameters["order_time"])
    expected = [15, 10, 5, 0, -5, -10, -15, -10, -5, 0, 5, 10, 15]
    np.testing.assert_allclose(np.degrees(steady_rates(run)[0]), expected, atol=0.01)
    assert check_completeness(esso, maneuver) == ()
    for hold in held_stretches(run.t, run.delta):
        rows = (run.t > hold.end - 0.9 * maneuver.parameters["window"]) & (run.t <= hold.end)
        assert np.ptp(run.r[rows]) <= STEADY_CHANGE * 0.38 / 3.0 * 1.01


def test_spiral_of_a_ship_stable_on_course_has_no_loop_and_rises_with_the_rudder(esso: Trial) -> None:
    maneuver = parse_maneuver("spiral:15/5", SHIP, speed=0.38)
    order_time = maneuver.parameters["order_time"]
    figures = spiral_figures(since(esso, order_time))
    assert figures["loop_height"] * 3.0 / 0.38 < 0.01
    assert math.degrees(figures["loop_width"]) < 0.5
    curve = spiral_curve(since(esso, order_time))
    assert curve is not None and curve.turn == 6
    for rudder, rate in curve.branches:
        assert (np.diff(rudder) > 0).all() and (np.diff(rate) > 0).all()
    assert spiral_figures(since(simulated_run(SHIP, "turning:35", 0.38).trial, order_time)) == {}


def hysteresis(step: float, half_width: float, height: float, side: float = 1.0) -> Trial:
    """A spiral of 10 deg, first to ``side``: r = 0.01 delta / deg, plus ``height`` of the side it turns to.

    The side changes where the rudder passes ``half_width`` [deg] on the other one.
    """
    degrees = np.degrees(spiral_angles(side * math.radians(10), math.radians(step)))
    rates = []
    for angle in degrees:
        if side * angle < -half_width:
            side = -side
        rates.append(0.01 * angle + side * height)
    delta, r = np.radians(np.repeat(degrees, 100)), np.repeat(rates, 100)
    t = 0.1 * np.arange(len(r))
    nothing = np.zeros(len(r))
    columns = {"t": t, "psi": nothing, "u": nothing + 1, "v": nothing, "n": nothing, "r": r, "delta": delta}
    return Trial("hysteresis", columns)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_loop_of_an_unstable_ship_has_the_height_and_width_it_was_made_with(side: float) -> None:
    """Branches 0.1 apart; each jumps between 4 and 5 deg on the other side, where it crosses zero."""
    figures = spiral_figures(since(hysteresis(1.0, 4.5, 0.05, side), 0.0))
    assert figures["loop_height"] == pytest.approx(0.1)
    assert 8.0 <= math.degrees(figures["loop_width"]) <= 10.0
    assert figures["rate_at_midships"] == pytest.approx(0.0, abs=1e-12)
    narrow = spiral_figures(since(hysteresis(1.0, 1.5, 0.05), 0.0))
    assert 2.0 <= math.degrees(narrow["loop_width"]) <= 4.0


def test_a_spiral_without_a_way_back_has_no_loop_to_measure() -> None:
    whole = hysteresis(2.0, 2.5, 0.05)
    there = Trial("there", {name: a[: 11 * 100] for name, a in whole.columns.items()})
    assert spiral_curve(since(there, 0.0)) is not None
    assert spiral_figures(since(there, 0.0)) == {}


@pytest.mark.parametrize("side", [1, -1])
def test_pull_out_of_a_stable_ship_decays_to_the_same_small_rate_from_either_side(side: int) -> None:
    run = simulated_run(SHIP, f"pull-out:{side * 20}", 0.38)
    assert side * run.figures["steady_rate"] * 3.0 / 0.38 > 0.1
    assert abs(run.figures["residual_share"]) < 0.03
    assert run.trial["delta"][-1] == pytest.approx(0.0, abs=1e-9)


def test_pull_out_figures_are_the_ends_of_both_holds() -> None:
    """0.05 rad/s under rudder, decaying to 0.01 rad/s."""
    t = np.arange(0.0, 200.0, 0.1)
    r = np.where(t < 100, 0.05, 0.01 + 0.04 * np.exp(-(t - 100) / 5))
    nothing = np.zeros(len(t))
    columns = {"t": t, "psi": nothing, "u": nothing + 1, "v": nothing, "r": r, "delta": np.where(t < 100, 0.3, 0.0)}
    figures = pull_out_figures(since(Trial("pull-out", columns), 0.0))
    assert figures == pytest.approx({"steady_rate": 0.05, "residual_rate": 0.01, "residual_share": 0.2}, rel=1e-6)
    steady = {**columns, "delta": nothing + 0.3}
    assert pull_out_figures(since(Trial("turn", steady), 0.0)) == {}


def test_a_spiral_cut_short_by_its_duration_says_so() -> None:
    maneuver = parse_maneuver("spiral:15/5", SHIP, speed=0.38, duration=30.0)
    notices = check_completeness(simulate(SHIP, maneuver), maneuver)
    assert len(notices) == 1

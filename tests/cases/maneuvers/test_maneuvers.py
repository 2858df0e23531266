"""Manoeuvres: text to orders, approach, rate limits, Froude scaling, figures; engines that are stopped and reversed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cases.criteria import figures as read
from cases.criteria.imo import imo_figures
from cases.criteria.measured_maneuvers import held_stretches
from cases.criteria.standard_runs import check_completeness, figures_of, figures_of_each, simulated_run, simulated_trial
from cases.maneuvers import self_propulsion
from cases.maneuvers.definitions import (
    MOST_RUDDER,
    STEADY_CHANGE,
    Controller,
    HeadingControl,
    Limits,
    Zigzag,
    parse_maneuver,
    random_telegraph,
    spiral_angles,
    stopping_notices,
)
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import simulate_batch
from cases.trial import Trial
from mmg.components.propeller.four_quadrant import A_Q, B_Q
from mmg.errors import OutOfRange, UserError
from mmg.rollout import Simulator
from mmg.ship import Ship

SHIP = load_ship("esso_osaka_3m")


@pytest.mark.parametrize(
    "text",
    ["", "spin:35", "turning", "turning:", "turning:0", "turning:abc", "turning:nan", "turning:95",
     "zigzag:20", "zigzag:20/-20", "spiral:15", "spiral:15/4", "spiral:15/-5", "spiral:a/5", "pull-out",
     "pull-out:0", "heading", "heading:20", "heading:20/1", "heading:20/-1/2", "heading:181/1/2", "heading:20/x/2",
     "heading:20/1/inf", "zigzag:a/b", "random:x", "random:-1", "straight:3", "crash-stop:5"],
)  # fmt: skip
def test_ill_formed_text_is_one_clear_line(text: str) -> None:
    with pytest.raises(UserError) as caught:
        parse_maneuver(text, SHIP)
    assert "\n" not in str(caught.value) and text in str(caught.value)


@pytest.mark.parametrize(
    ("change", "r", "rudder"), [(20.0, 0.0, 30.0), (20.0, 2.0, 22.0), (-20.0, 0.0, -30.0), (90.0, 0.0, 35.0)]
)
def test_a_heading_controller_orders_gains_times_error_and_turn_rate_within_the_usual_rudder(
    change: float, r: float, rudder: float
) -> None:
    control = HeadingControl(9.0, 5.0, math.radians(change), 1.5, 4.0)
    assert control(0.0, np.zeros(6)) == (9.0, 0.0)  # before the order
    order = pytest.approx(np.clip(control.change * 1.5, -MOST_RUDDER, MOST_RUDDER))
    assert control(5.0, np.array([0, 0, 0.3, 0.4, 0, 0])) == (9.0, order)
    n, delta = control(6.0, np.array([0, 0, 0.3, 0.4, 0, math.radians(r)])) or (0.0, 0.0)
    assert (n, math.degrees(delta)) == (9.0, pytest.approx(rudder))


@pytest.mark.parametrize("approach", [{"n": -3.0}, {"n": 0.0}, {"speed": 0.0}, {"speed": 30.0}, {"n": math.nan}])
def test_an_approach_that_cannot_be_held_is_refused(approach: dict[str, float]) -> None:
    with pytest.raises(OutOfRange):
        parse_maneuver("turning:35", SHIP, n=approach.get("n"), speed=approach.get("speed"))


def test_self_propulsion_and_steady_speed_are_inverse() -> None:
    assert self_propulsion.speed_for(SHIP, self_propulsion.revolutions_for(SHIP, 0.3)) == pytest.approx(0.3, rel=1e-9)
    assert self_propulsion.speed_for(SHIP, 10.0) == pytest.approx(0.39539, rel=5e-4)


def test_straight_running_keeps_the_approach_speed() -> None:
    trial = simulate(SHIP, parse_maneuver("straight", SHIP, duration=60), dt=0.5)
    np.testing.assert_allclose(trial["u"], trial["u"][0], rtol=1e-9)
    np.testing.assert_allclose(trial["y"], 0.0, atol=1e-12)


def test_limits_follow_froude_and_actuators_never_move_faster() -> None:
    assert math.degrees(Limits.for_length(3.0).rudder_rate) == pytest.approx(20.0)
    assert math.degrees(Limits.for_length(320.0).rudder_rate) == pytest.approx(1.94, abs=0.01)
    large = replace(SHIP, particulars={**SHIP.particulars, "L": 300.0, "D_P": 8.4})
    ratio = parse_maneuver("berthing", large, n=1.0, speed=1.0).duration / parse_maneuver("berthing", SHIP).duration
    assert ratio == pytest.approx(10.0)
    maneuver = parse_maneuver("random:5", SHIP)
    trial = simulate(SHIP, maneuver)
    assert np.abs(np.diff(trial["delta"])).max() <= maneuver.limits.rudder_rate * 0.1 + 1e-12
    assert np.abs(np.diff(trial["n"])).max() <= maneuver.limits.propeller_rate * 0.1 + 1e-12
    slow = simulate(SHIP, parse_maneuver("turning:35", SHIP, rudder_rate=math.radians(2), duration=30))
    assert np.abs(np.diff(slow["delta"])).max() == pytest.approx(math.radians(0.2))


@pytest.mark.parametrize(("text", "side", "heading"), [("zigzag:20/20", 1, 20), ("zigzag:-10/5", -1, 5)])
def test_zigzag_reverses_within_the_step_that_crosses_the_switch_heading(text: str, side: int, heading: int) -> None:
    trial = simulate(SHIP, parse_maneuver(text, SHIP))
    psi, delta = np.degrees(trial.psi_unwrapped), np.degrees(trial["delta"])
    moves = np.flatnonzero(np.diff(delta) * np.append(0, np.diff(delta)[:-1]) <= 0)
    starts = [k + 1 for k in moves if abs(delta[k + 1] - delta[k]) > 1e-9 and abs(delta[k]) > 1]
    assert len(starts) >= 4
    for number, k in enumerate(starts):
        s = side * (-1) ** number
        assert s * psi[k] < heading <= s * psi[k + 1] + 1e-9
        assert np.sign(delta[k] - delta[k - 1]) == -s


def yawing(rate: float, dt: float, delay: float) -> tuple[list[float], Controller]:
    """Rudder per step of a zigzag:10/5 whose heading just turns at ``rate`` [rad/s] whatever is asked."""
    limits = Limits(math.radians(20.0), 20.0, delay)
    controller = Controller(Zigzag(10.0, 0.33, math.radians(10), math.radians(5)), limits, 10.0)
    state, rudder = np.zeros(6), []
    for k in range(round(4.0 / dt)):
        after = state + np.array([0, 0, rate * dt, 0, 0, 0])
        rudder.append(controller.held(k * dt, dt, state, lambda inputs, after=after: after)[1])
        state = after
    return rudder, controller


@pytest.mark.parametrize("dt", [0.05, 0.1, 0.4])
@pytest.mark.parametrize("delay", [0.0, 0.02, 0.27, 0.5])
def test_rudder_moves_from_the_moment_of_order_and_crossing_or_so_much_later(dt: float, delay: float) -> None:
    """Order at 0.33 s: 20 deg/s to 10 deg; 5 deg on are passed at 2.33 s (2.5 deg/s): to -10 deg by 3.33 s.

    The sum of the held means is the integral of that ramp, for every step.
    """
    rudder, controller = yawing(math.radians(2.5), dt, delay)
    exact = 10 * (2.33 - 0.33 - 0.25) - 10 * (4.0 - 3.33 - delay)
    assert math.degrees(sum(rudder) * dt) == pytest.approx(exact, abs=1e-6)
    assert math.degrees(controller.delta) == pytest.approx(-10.0)


@pytest.mark.parametrize(
    ("text", "seconds"), [("turning:0.5", 60.0), ("zigzag:1/60", 60.0), ("crash-stop", 20.0), ("pull-out:20", 25.0)]
)
def test_a_manoeuvre_that_misses_its_event_says_so(text: str, seconds: float) -> None:
    """Without --duration an error; the same sentence is a notice where a duration was asked for."""
    maneuver = replace(parse_maneuver(text, SHIP), duration=seconds)
    trial = simulate(SHIP, maneuver, 0.2)
    with pytest.raises(UserError, match=text) as caught:
        check_completeness(trial, maneuver)
    assert "\n" not in str(caught.value)
    partial = parse_maneuver(text, SHIP, duration=maneuver.duration)
    assert partial.partial
    assert check_completeness(trial, partial) == (str(caught.value),)


def test_complete_manoeuvres_miss_nothing_and_a_quarter_turn_says_what_is_absent() -> None:
    for text in ("turning:35", "zigzag:10/10", "crash-stop", "straight"):
        maneuver = parse_maneuver(text, SHIP)
        assert check_completeness(simulate(SHIP, maneuver), maneuver) == ()
    maneuver = parse_maneuver("turning:35", SHIP, duration=60)
    notices = check_completeness(simulate(SHIP, maneuver), maneuver)
    assert len(notices) == 1 and "180" in notices[0]
    maneuver = parse_maneuver("spiral:15/5", SHIP, speed=0.38, duration=30.0)
    assert len(check_completeness(simulate(SHIP, maneuver), maneuver)) == 1


def test_zigzag_counts_from_the_heading_at_the_execute() -> None:
    maneuver = parse_maneuver("zigzag:10/10", SHIP)
    turned = maneuver.start
    turned[2] = 3.0
    a, b = simulate(SHIP, maneuver), simulate(SHIP, maneuver, start=turned)
    np.testing.assert_allclose(b.psi_unwrapped - 3.0, a.psi_unwrapped, atol=1e-9)
    assert np.abs(b["psi"]).max() <= math.pi


def test_turning_ends_after_540_degrees_or_at_the_time_limit() -> None:
    whole = simulate(SHIP, parse_maneuver("turning:-35", SHIP), dt=0.5)
    assert -3 * math.pi - 0.1 < whole.psi_unwrapped[-1] <= -3 * math.pi
    assert simulate(SHIP, parse_maneuver("turning:-35", SHIP, duration=50)).duration == pytest.approx(50)


def test_crash_stop_ends_when_headway_is_lost() -> None:
    maneuver = parse_maneuver("crash-stop", SHIP)
    trial = simulate(SHIP, maneuver)
    assert trial["u"][-1] <= 0 < trial["u"][-2]
    assert trial["n"][-1] == pytest.approx(-maneuver.n)
    figures = read.stopping_figures(read.since(trial, maneuver.parameters["order_time"]))
    assert figures["track_reach"] >= figures["head_reach"] > 0


def test_acceleration_starts_from_rest() -> None:
    trial = simulate(SHIP, parse_maneuver("acceleration", SHIP, n=8.0, duration=60), dt=0.5)
    assert trial["u"][0] == 0 and trial["n"][0] < trial["n"][1] == trial["n"][-1] == 8.0
    assert (np.diff(trial["u"])[1:] > 0).all()


def test_random_orders_reverse_and_are_reproducible() -> None:
    state, times = np.zeros(6), np.arange(0.0, 150.0)
    for seed in range(10):
        first, again = (random_telegraph(10.0, 150.0, 1.0, seed) for _ in range(2))
        orders = [first(t, state) or (0.0, 9.9) for t in times]
        assert orders == [again(t, state) for t in times]
        assert min(n for n, _ in orders) < 0 < orders[0][0]
        assert max(abs(delta) for _, delta in orders) <= math.radians(35)
    assert random_telegraph(10.0, 150.0, 1.0, 1)(80.0, state) != random_telegraph(10.0, 150.0, 1.0, 2)(80.0, state)


def moved(t: np.ndarray, **columns: np.ndarray) -> Trial:
    """A run at the times ``t`` in which the columns are zero but for those given."""
    return Trial("run", {"t": t, **dict.fromkeys(("psi", "u", "v", "r", "n", "delta"), np.zeros(len(t))), **columns})


def test_figures_of_a_perfect_circle_are_its_radius_and_diameter() -> None:
    psi = np.linspace(0, 4, 401)
    circle = moved(np.arange(401.0), x=7 * np.sin(psi), y=7 * (1 - np.cos(psi)), psi=psi)
    figures = read.turning_figures(read.since(circle, 0.0), 0.6)
    assert figures["advance"] == pytest.approx(7, rel=1e-4) == figures["transfer"]
    assert figures["tactical_diameter"] == pytest.approx(14, rel=1e-4)
    assert figures["time_180"] == pytest.approx(100 * math.pi, rel=1e-6)


def test_overshoots_of_a_sine_are_its_amplitude_beyond_the_switch_heading() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    figures = read.zigzag_figures(read.since(moved(t, psi=-0.5 * np.sin(0.2 * t)), 0.0), -0.3, 0.35)
    assert len(figures) == 6
    np.testing.assert_allclose(list(figures.values()), 0.15, atol=1e-4)


def test_measured_overshoots_of_a_sine_count_from_the_heading_at_each_reversal() -> None:
    """Rudder reversed at 0.35 rad, then late at 0.4 rad: 0.15 and 0.1 rad; the last has not come back."""
    t = np.arange(0.0, 40.0, 0.01)
    psi = 0.5 * np.sin(0.2 * t)
    trial = Trial("sine", {"t": t, "psi": psi + 3.0})
    first, second = math.asin(0.7) / 0.2, (math.pi + math.asin(0.8)) / 0.2
    figures = read.overshoot_figures(trial, 0.3, (first, second, 38.0), 39.0)
    assert figures == pytest.approx({"overshoot_1": 0.15, "overshoot_2": 0.1}, abs=1e-5)
    # where orders were logged they count from these: at 0.3 rad, and at 0.35 rad
    orders = [math.asin(0.6) / 0.2, (math.pi + math.asin(0.7)) / 0.2]
    ordered = trial.with_columns(delta_order=np.where(t < orders[0], 0.3, np.where(t < orders[1], -0.3, 0.3)))
    figures = read.overshoot_figures(ordered, 0.3, (first, second, 38.0), 39.0)
    assert figures == pytest.approx({"overshoot_1": 0.2, "overshoot_2": 0.15}, abs=1e-3)
    # at rows of a second the rudder moves before the row that shows its order: no order is that of the next move
    t, moves = np.arange(0.0, 40.0), (first, second, 38.0)
    coarse = Trial("sine", {"t": t, "psi": 0.5 * np.sin(0.2 * t)})
    over = coarse.with_columns(delta_order=np.where(t < first, 0.3, np.where(t < second, -0.3, 0.3)))
    assert read.overshoot_figures(over, 0.3, moves, 39.0) == read.overshoot_figures(coarse, 0.3, moves, 39.0) != {}


def test_initial_turning_is_the_way_along_the_track_to_10_degrees() -> None:
    """A circle of radius 7: 7 times 10 deg in radians, order between two samples."""
    t = np.arange(0.0, 60.0, 0.3)
    circle = moved(t, psi=np.maximum(t - 4.8, 0.0) * 0.01, u=np.full(len(t), 0.07))
    figures = read.initial_turning_figures(read.since(circle, 5.0), 0.2)
    assert figures["initial_turning_track"] == pytest.approx(7 * math.radians(10), rel=2e-3)
    assert figures["time_10"] == pytest.approx(100 * math.radians(10), rel=2e-3)


def test_every_figure_has_its_unit() -> None:
    units = {"advance": "m", "track_reach": "m", "steady_diameter": "m", "time_90": "s", "stopping_time": "s",
             "overshoot_3": "rad", "loop_width": "rad", "steady_drift": "rad", "residual_rate": "rad/s",
             "rate_at_midships": "rad/s", "loop_height": "rad/s",
             "steady_speed": "m/s", "residual_share": ""}  # fmt: skip
    assert {name: read.figure_unit(name) for name in units} == units


def test_spiral_goes_to_the_other_side_and_back() -> None:
    degrees = np.degrees(spiral_angles(math.radians(-6), math.radians(6)))
    np.testing.assert_allclose(degrees, [-6, 0, 6, 0, -6], atol=1e-9)


@pytest.fixture(scope="module")
def esso() -> Trial:
    return simulate(SHIP, parse_maneuver("spiral:15/5", SHIP, speed=0.38), 0.25)


def test_every_angle_of_the_spiral_is_held_until_steady(esso: Trial) -> None:
    maneuver = parse_maneuver("spiral:15/5", SHIP, speed=0.38)
    run = read.since(esso, maneuver.parameters["order_time"])
    expected = [15, 10, 5, 0, -5, -10, -15, -10, -5, 0, 5, 10, 15]
    np.testing.assert_allclose(np.degrees(read.steady_rates(run)[0]), expected, atol=0.01)
    assert check_completeness(esso, maneuver) == ()
    for hold in held_stretches(run.t, run.delta):
        rows = (run.t > hold.end - 0.9 * maneuver.parameters["window"]) & (run.t <= hold.end)
        assert np.ptp(run.r[rows]) <= STEADY_CHANGE * 0.38 / 3.0 * 1.01


def test_spiral_of_a_ship_stable_on_course_has_no_loop_and_rises_with_the_rudder(esso: Trial) -> None:
    maneuver = parse_maneuver("spiral:15/5", SHIP, speed=0.38)
    order_time = maneuver.parameters["order_time"]
    figures = read.spiral_figures(read.since(esso, order_time))
    assert figures["loop_height"] * 3.0 / 0.38 < 0.01
    assert math.degrees(figures["loop_width"]) < 0.5
    branches = read.spiral_branches(read.since(esso, order_time))
    assert [len(rudder) for rudder, _ in branches] == [7, 7]
    for rudder, rate in branches:
        assert (np.diff(rudder) > 0).all() and (np.diff(rate) > 0).all()
    assert read.spiral_figures(read.since(simulated_run(SHIP, "turning:35", 0.38).trial, order_time)) == {}


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
    return moved(0.1 * np.arange(len(r)), u=np.ones(len(r)), r=r, delta=delta)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_loop_of_an_unstable_ship_has_the_height_and_width_it_was_made_with(side: float) -> None:
    """Branches 0.1 apart; each jumps between 4 and 5 deg on the other side, where it crosses zero."""
    figures = read.spiral_figures(read.since(hysteresis(1.0, 4.5, 0.05, side), 0.0))
    assert figures["loop_height"] == pytest.approx(0.1)
    assert 8.0 <= math.degrees(figures["loop_width"]) <= 10.0
    assert figures["rate_at_midships"] == pytest.approx(0.0, abs=1e-12)
    narrow = read.spiral_figures(read.since(hysteresis(1.0, 1.5, 0.05), 0.0))
    assert 2.0 <= math.degrees(narrow["loop_width"]) <= 4.0


def test_a_heading_is_reached_and_its_figures_are_means_over_the_run() -> None:
    run = simulated_trial(SHIP, "heading:20/2/6")
    assert math.degrees(run["psi"][-1]) == pytest.approx(20.0, abs=0.1)
    t = np.arange(0.0, 100.05, 0.1)
    turning = moved(t, u=np.ones(len(t)), psi=0.002 * t, delta=np.full(len(t), 0.1))
    # of 0.002 t - 0.2 over 100 s: 0.2 / sqrt(3)
    wanted = {"rms_heading_error": 0.2 / math.sqrt(3), "rms_rudder": 0.1}
    assert read.heading_figures(read.since(turning, 0.0), 0.2) == pytest.approx(wanted, rel=1e-4)


def test_a_heading_is_held_by_pods_too_which_have_no_rudder() -> None:
    sizes = {"L": 33.9, "B": 9.6, "d": 2.7, "C_b": 0.604, "U_0": 5.4, "D_az": 1.9, "x_az": -14.6, "y_az": 0.0}
    pods = new_ship("pods", sizes)
    plan = parse_maneuver("heading:20/1.5/6", pods)
    figures = figures_of(simulated_trial(pods, plan), plan)
    assert set(figures) == {"rms_heading_error"} and 0.5 < math.degrees(figures["rms_heading_error"]) < 5


def test_a_heading_in_a_wind_stands_off_by_the_rudder_that_holds_it_over_the_gain() -> None:
    """Without an integral part; the wind needs the same rudder at twice the gain."""
    off = [simulated_trial(SHIP, f"heading:0/{gain}/6", wind="2:90")["psi"][-1] for gain in (2, 4)]
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.1) and off[1] > 0.01


def test_a_spiral_without_a_way_back_has_no_loop_to_measure() -> None:
    there = hysteresis(2.0, 2.5, 0.05)[: 0.1 * 11 * 100 - 0.05]
    assert len(read.spiral_branches(read.since(there, 0.0))) == 2
    assert read.spiral_figures(read.since(there, 0.0)) == {}


def test_pull_out_figures_are_the_ends_of_both_holds() -> None:
    """0.05 rad/s under rudder, decaying to 0.01 rad/s."""
    t = np.arange(0.0, 200.0, 0.1)
    r = np.where(t < 100, 0.05, 0.01 + 0.04 * np.exp(-(t - 100) / 5))
    run = moved(t, u=np.ones(len(t)), r=r, delta=np.where(t < 100, 0.3, 0.0))
    figures = read.pull_out_figures(read.since(run, 0.0))
    assert figures == pytest.approx({"steady_rate": 0.05, "residual_rate": 0.01, "residual_share": 0.2}, rel=1e-6)
    assert read.pull_out_figures(read.since(run.with_columns(delta=np.full(len(t), 0.3)), 0.0)) == {}


# Engines
def kvlcc2(**particulars: float) -> Ship:
    ship = load_ship("kvlcc2_full")
    return replace(ship, particulars={**ship.particulars, **particulars})


def engine(**particulars: float) -> self_propulsion.Engine:
    ship = kvlcc2(**particulars)
    found = self_propulsion.engine_of(ship, *self_propulsion.approach(ship, None, None))
    assert found is not None
    return found


def test_the_torque_is_that_of_the_propeller_law_at_the_approach_and_of_the_series_elsewhere() -> None:
    e = engine()
    share = e.n / e.n_mcr
    assert share == pytest.approx(0.965) and share**3 == pytest.approx(0.9, abs=2e-3)
    for times in (1.0, 0.5):
        found = e.torque(np.array([times * share]), np.array([times * e.speed]))
        assert found == pytest.approx([(times * share) ** 2], rel=1e-6)
    beta = math.atan(e.advance)

    def series(angle: float) -> float:
        return sum(
            a * math.cos(k * angle) + b * math.sin(k * angle) for k, (a, b) in enumerate(zip(A_Q, B_Q, strict=True))
        )

    bollard = e.torque(np.array([-0.5]), np.array([0.0]))[0]
    known = 0.25 * series(math.pi) / (series(beta) * (1 + e.advance**2))
    assert bollard == pytest.approx(known, rel=1e-3) and bollard < 0
    assert pytest.approx(1.025, abs=2e-3) == self_propulsion.ZERO_THRUST  # B4-70 with P/D = 1


def test_the_fuel_is_cut_after_the_delay_and_the_propeller_turns_on_in_the_wake() -> None:
    e = replace(engine(), restart=0.05)
    shaft, u = e.shaft(), np.array([e.speed])
    held, n = shaft.moved(e.n, u, 60.0)
    assert held is shaft and n == pytest.approx([e.n])
    shaft, n = shaft.moved(-e.n, u, 10.0)
    assert n == pytest.approx([e.n], rel=1e-9)
    for _ in range(60):
        shaft, _ = shaft.moved(-e.n, u, 1.0)
    assert (shaft.ran < 0).all() and 0.2 < shaft.share[0] < 0.6
    balance = e.torque(shaft.share, u)
    assert balance == pytest.approx([-0.05], abs=2e-3)  # it drives the shaft against its friction
    slow = shaft
    for _ in range(60):
        slow, _ = slow.moved(-e.n, 0.05 * u, 1.0)
    assert slow.share[0] < 0 < slow.ran[0]


def test_astern_the_engine_reaches_its_limits_of_revolutions_and_torque() -> None:
    e = engine()
    weak = replace(e, astern_torque=0.1)
    for one, share, least, most in ((e, 0.0, -0.7001, -0.699), (e, 0.9, -0.7, -0.2), (weak, 0.0, -0.7, -0.1)):
        shaft = one.shaft()
        for _ in range(400):
            shaft, mean = shaft.moved(-e.n, np.array([share * e.speed if shaft.ran.max() >= 0 else 0.0]), 1.0)
        assert least <= shaft.share[0] <= most and mean[0] == pytest.approx(shaft.n[0], rel=1e-3)
    assert -weak.torque(shaft.share, np.array([0.0]))[0] == pytest.approx(0.1 - 0.05, abs=0.02)


@pytest.mark.slow
def test_a_laden_tanker_stops_in_ten_lengths_or_more_and_alike_in_every_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ship = load_ship("kvlcc2_full")
    run = simulated_run(ship, "crash-stop", 7.9739)
    assert 10 < run.figures["track_reach"] / 320 < 15
    monkeypatch.setattr("cases.criteria.imo.STANDARD", ("crash-stop",))
    row = next(r for r in imo_figures(ship).rows if r.figure == "track_reach")
    assert row.value is not None and row.value == pytest.approx(run.figures["track_reach"] / 320)
    plan = parse_maneuver("crash-stop", ship)
    fine = figures_of(simulate(ship, plan, 1.0), plan)
    assert fine["track_reach"] == pytest.approx(run.figures["track_reach"], rel=2e-3)
    (batch,) = figures_of_each(simulate_batch(ship, plan, dt=1.0), plan)
    pushed = simulate_batch(
        Simulator(ship), plan, {"R_0": ship.values[[ship.symbols.index("R_0")]]}, 1.0, lambda k, states: np.zeros(())
    )
    for figure, value in fine.items():
        if figure != "lateral_deviation":
            assert batch[figure] == pytest.approx(value, rel=1e-3)
            assert figures_of_each(pushed, plan)[0][figure] == pytest.approx(value, rel=1e-3)
    words = [m.code for m in simulate(ship, plan, 5.0).notices]
    assert words == ["assumed_engine", "stopping_resistance"] == [m.code for m in stopping_notices(plan)]


@pytest.mark.slow
def test_a_slower_engine_a_weaker_one_and_a_lighter_resistance_need_more_way() -> None:
    def reach(**particulars: float) -> float:
        ship = kvlcc2(**particulars)
        plan = parse_maneuver("crash-stop", ship, duration=4000.0)
        return figures_of_each(simulate_batch(ship, plan, dt=4.0), plan)[0]["track_reach"] / 320

    usual = reach()
    assert reach(engine_delay=60.0) - usual == pytest.approx(50 * 7.97 / 320, rel=0.2)
    assert reach(astern_torque=0.3) > usual + 1 and reach(astern_revolutions=0.4) > usual + 1
    assert reach(restart=0.15) > usual + 1
    assert reach(stopping_resistance=1.0) < usual - 3


def test_coasting_ends_at_its_share_of_the_speed_by_the_resistance_alone() -> None:
    ship = load_ship("kvlcc2_full")
    plan = parse_maneuver("coasting:0.5", ship)
    trial = simulate(ship, plan, 5.0)
    assert trial["u"][-1] == pytest.approx(0.5 * plan.speed, rel=0.01)
    (batch,) = figures_of_each(simulate_batch(ship, plan, dt=5.0), plan)
    found = figures_of(trial, plan)
    assert batch["track_reach"] == pytest.approx(found["track_reach"], rel=1e-3)
    # m u' = -R u^2 gives ln 2 m / R; the propeller that turns in the wake brakes besides
    p, c = ship.particulars, {s: one.value for s, one in plan.ship_of(ship).coefficients.items()}
    mass = p["m"] + c["m_x"] * 0.5 * p["rho"] * p["L"] ** 2 * p["d"]
    free = math.log(2) * mass / (0.5 * p["rho"] * p["L"] * p["d"] * c["R_0"])
    assert 0.7 * free < found["track_reach"] < free
    assert 0 <= trial["n"][-1] < 0.6 * plan.n


def test_what_is_assumed_is_drawn_and_what_is_given_is_not() -> None:
    e = engine(restart=0.25, engine_delay=5.0)
    drawn = e.drawn(2000, 3)
    assert (np.asarray(drawn.restart) == 0.25).all() and (np.asarray(drawn.engine_delay) == 5.0).all()
    assert np.std(drawn.astern_torque) == pytest.approx(self_propulsion.USUAL["astern_torque"][1], rel=0.1)
    assert "restart" not in self_propulsion.engine_words(e) and "astern_torque" in self_propulsion.engine_words(e)
    assert np.asarray(drawn.repeated(2).engine_rise).shape == (4000,)


def test_models_have_a_motor_and_nonsense_is_one_line() -> None:
    assert parse_maneuver("crash-stop", load_ship("esso_osaka_3m")).engine is None
    assert parse_maneuver("turning:35", load_ship("kvlcc2_full")).engine is None
    for wrong in ({"restart": 3.0}, {"astern_revolutions": 0.0}, {"n_MCR": 100.0}, {"stopping_resistance": -1.0}):
        with pytest.raises(UserError, match=next(iter(wrong))):
            parse_maneuver("crash-stop", kvlcc2(**wrong))
    for text in ("coasting:0", "coasting:2", "coasting:x"):
        with pytest.raises(UserError, match="coasting"):
            parse_maneuver(text, load_ship("kvlcc2_full"))

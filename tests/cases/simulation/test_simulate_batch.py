"""Manoeuvres in batches: the motion of one ship simulated by herself, accuracy of long steps, the figures of each run;
and their scatter over the standard errors of the coefficients."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cases.criteria.scatter import ManeuverScatter, draw_coefficients, scatter
from cases.criteria.standard_runs import figures_of, figures_of_each, simulated_run, simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import SimulatedRuns, simulate_batch, simulate_pushed
from cases.trial import Trial
from mmg.errors import Missing, Unsupported, UserError
from mmg.messages import has_code
from mmg.rollout import Simulator

ESSO = load_ship("esso_osaka_3m")
SIMULATORS = {name: Simulator(load_ship(name)) for name in ("esso_osaka_3m", "vectwin_3m")}
SIMULATOR = SIMULATORS["esso_osaka_3m"]
SIMULATORS["with memory"] = Simulator(ESSO.with_effect("rudder_lag", {"T": 0.5}))
KNOWN = ("turning:35", "turning:-20", "crash-stop", "random:3", "berthing", "straight", "acceleration")


def assert_same_motion(batch: SimulatedRuns, m: int, trial: Trial, tolerance: float = 1e-9) -> None:
    """Run m of the batch is the trial, which ends with its last row."""
    rows = batch.last[m] + 1
    assert len(trial) == rows
    np.testing.assert_allclose(batch.states[:rows, :, m], trial.states, atol=tolerance)
    for i, name in enumerate(("n", "delta" if "delta" in trial else "delta_port")):
        np.testing.assert_allclose(batch.inputs[: rows - 1, i, m], trial[name][:-1], atol=tolerance)


@pytest.mark.parametrize("name", SIMULATORS)
@pytest.mark.parametrize("text", [*KNOWN, "zigzag:-10/10"])
def test_held_inputs_give_the_motion_of_one_ship_by_herself(name: str, text: str) -> None:
    simulator = SIMULATORS[name]
    plan = parse_maneuver(text, simulator.ship, duration=None if text.startswith(("turning", "zigzag")) else 100)
    batch = simulate_batch(simulator, plan, dt=0.7)
    assert_same_motion(batch, 0, simulate(simulator.ship, plan, 0.7))


@pytest.mark.parametrize("text", ["turning:35", "zigzag:10/10", "random:3"])
def test_a_rudder_that_waits_does_so_in_every_simulation_alike(text: str) -> None:
    late = replace(ESSO, particulars={**ESSO.particulars, "rudder_delay": 0.33})
    alone, prompt = (simulate(ship, parse_maneuver(text, ship), 0.7) for ship in (late, ESSO))
    plan = parse_maneuver(text, late)
    assert_same_motion(simulate_batch(late, plan, dt=0.7), 0, alone)
    rows = min(len(alone), len(prompt))
    assert np.abs(alone["delta"][:rows] - prompt["delta"][:rows]).max() > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("text", ["turning:35", "zigzag:10/10", "crash-stop"])
def test_each_set_of_coefficients_is_a_ship_of_her_own(text: str) -> None:
    rng, symbols = np.random.default_rng(0), ("N_r", "Y_v", "C_D", "X_0F")
    given = {s: ESSO.coefficients[s].value * (1 + 0.1 * rng.standard_normal(11)) for s in symbols}
    plan = parse_maneuver(text, ESSO)
    batch = simulate_batch(SIMULATOR, plan, given, 0.5)
    assert len(np.unique(batch.last)) > 1
    for m in (0, 7, 10):
        ship = ESSO.with_values({s: float(values[m]) for s, values in given.items()})
        assert_same_motion(batch, m, simulate(ship, plan, 0.5))


def test_samples_as_long_as_those_of_a_scatter_come_to_the_turning_of_short_ones() -> None:
    """Inputs held at their means over 0.38 s, which a rudder takes six of to 35 deg, against 0.038 s."""
    ship = load_ship("kvlcc2_l7")
    plan = parse_maneuver("turning:35", ship, speed=1.179, duration=300, rudder_rate=math.radians(15.82))
    theta = ship.values[:, None] * (1 + 0.05 * np.random.default_rng(0).standard_normal((len(ship.values), 20)))
    coarse, fine = (simulate_batch(ship, plan, theta, dt).states for dt in (0.38, 0.038))
    off = coarse - fine[::10][: len(coarse)]
    assert np.hypot(off[:, 0], off[:, 1]).max() < 1e-3 * ship.particulars["L"]


def test_what_a_batch_cannot_do_is_said() -> None:
    with pytest.raises(Unsupported):
        simulate_batch(ESSO, parse_maneuver("spiral:15/5", ESSO))
    for dt in (0.0, -1.0, math.nan, 1e4):
        with pytest.raises(UserError, match="dt"):
            simulate_batch(ESSO, parse_maneuver("turning:35", ESSO), dt=dt)


def test_a_zigzag_that_has_been_read_is_not_pushed_any_more() -> None:
    plan, two = parse_maneuver("zigzag:20/20", ESSO, speed=0.5), {"N_r": np.full(2, ESSO.coefficients["N_r"].value)}
    push = np.zeros((3, 2))
    push[2, 1] = 2e-3  # one of two is pushed, and ends at another time
    found = simulate_pushed(SIMULATOR, plan, two, 0.5, lambda k, states: push)
    first, second = found.last
    assert first != second
    early, last = (0, int(first)) if first < second else (1, int(second))
    assert (found.states[last + 1 :, :, early] == found.states[last + 1, :, early]).all()


# Scatter over the standard errors of the coefficients, and figures of runs that are pushed
@pytest.fixture(scope="module")
def turning() -> ManeuverScatter:
    return scatter(ESSO, "turning:35", 60, seed=3)


def test_draws_have_the_standard_errors_and_correlation_of_the_ship() -> None:
    pair = np.array([[1.0, 0.8], [0.8, 1.0]])
    drawn = draw_coefficients(ESSO, 4000, 1, (("Y_v", "N_v"), pair))
    for symbol in ("Y_v", "N_v", "C_D"):
        assert np.std(drawn[symbol]) == pytest.approx(ESSO.coefficients[symbol].std, rel=0.1)
    assert np.corrcoef(drawn["Y_v"], drawn["N_v"])[0, 1] == pytest.approx(0.8, abs=0.05)
    assert abs(np.corrcoef(drawn["Y_v"], drawn["C_D"])[0, 1]) < 0.05


def test_draws_stay_within_the_bounds_and_fixed_coefficients_stay() -> None:
    drawn = draw_coefficients(ESSO.fixing(["N_r"]), 500)
    assert "N_r" not in drawn
    for symbol, values in drawn.items():
        c = ESSO.coefficients[symbol]
        assert (values >= c.lower).all() and (values <= c.upper).all()


def test_the_ship_as_it_is_has_the_figures_of_one_simulation(turning: ManeuverScatter) -> None:
    alone = simulated_run(ESSO, "turning:35", turning.maneuver.speed)
    for row in turning.rows:
        assert row.value == pytest.approx(alone.figures[row.figure], rel=2e-3)


def test_medians_lie_in_their_intervals_and_figures_and_draws_have_rows(turning: ManeuverScatter) -> None:
    assert {"advance", "tactical_diameter", "steady_rate"} <= {row.figure for row in turning.rows}
    for row in turning.rows:
        assert row.interval_90[0] < row.median < row.interval_90[1] and 0 < row.share <= 1
    assert list(turning.to_pandas().index) == [row.figure for row in turning.rows]
    assert has_code(turning.notices, "independent_draws")
    tracks = turning.tracks()
    assert sorted(tracks["run"].unique()) == list(range(61))
    assert np.isfinite(tracks.to_numpy()).all()


def test_the_same_seed_gives_the_same_scatter_and_small_errors_small_intervals(turning: ManeuverScatter) -> None:
    assert scatter(ESSO, "turning:35", 60, seed=3).rows == turning.rows
    sure = ESSO.with_coefficients({s: c.with_(std=1e-6 * abs(c.value)) for s, c in ESSO.coefficients.items()})
    for row in scatter(sure, "turning:35", 10).rows:
        assert row.interval_90[1] - row.interval_90[0] < 1e-3 * abs(row.median)


def test_what_cannot_be_scattered_is_refused() -> None:
    for text, count in (("turning:35", 1), ("turning:35", 10**6), ("spiral:15/5", 5)):
        with pytest.raises(UserError):
            scatter(ESSO, text, count)
    with pytest.raises(Missing):
        draw_coefficients(ESSO.fixing(ESSO.symbols), 5)
    with pytest.raises(UserError, match="either"):
        simulated_trial(ESSO)


FIRST = ESSO.coefficients[ESSO.free[0]]
ALIKE = {FIRST.symbol: np.full(2, FIRST.value)}  # two ships as she is


def calm(k: int, states: np.ndarray) -> np.ndarray:
    """No push."""
    return np.zeros((3, states.shape[1]))


@pytest.mark.parametrize("text", ["turning:35", "zigzag:-10/10", "zigzag:20/20", "crash-stop"])
def test_figures_of_a_batch_are_those_of_each_run(text: str) -> None:
    plan, scattered = parse_maneuver(text, ESSO, speed=0.5), {FIRST.symbol: FIRST.value * np.array([1.0, 0.9, 1.1])}
    whole = simulate_batch(SIMULATOR, plan, scattered, 0.5)
    pushed = simulate_pushed(SIMULATOR, plan, scattered, 0.5, calm)
    assert len(pushed.t) <= len(whole.t)
    for m, last in enumerate(pushed.last):
        rows = slice(0, last + 1)
        np.testing.assert_allclose(pushed.states[rows, :, m], whole.states[rows, :, m], rtol=1e-9, atol=1e-12)
    for m, (alone, short) in enumerate(zip(figures_of_each(whole, plan), figures_of_each(pushed, plan), strict=True)):
        own = figures_of(whole.trial(m), plan)
        assert alone and all(own[name] == pytest.approx(value, rel=1e-9) for name, value in alone.items())
        read = [name for name in short if not name.startswith("overshoot") or int(name.split("_")[1]) <= 2]
        assert {"turning": 5, "zigzag": 2, "crash-stop": 4}[plan.kind] <= len(read)
        assert all(short[name] == pytest.approx(own[name], rel=1e-9) for name in read)


def test_a_constant_push_moves_a_ship_as_its_acceleration_says() -> None:
    plan, push = parse_maneuver("turning:20", ESSO, speed=0.5), np.array([[0.0, 1e-4], [0.0, 0.0], [0.0, 0.0]])
    runs = simulate_pushed(SIMULATOR, plan, ALIKE, 0.1, lambda k, states: push)
    gained = runs.states[:11, 3, 1] - runs.states[:11, 3, 0]  # before damping tells
    np.testing.assert_allclose(gained[1:], 1e-5 * np.arange(1, 11), rtol=0.05)


def test_a_diverging_run_has_no_figures_and_a_spiral_is_refused() -> None:
    plan = parse_maneuver("turning:35", ESSO, speed=0.5)

    def blown(k: int, states: np.ndarray) -> np.ndarray:
        return np.array([[0.0, np.nan if k == 20 else 0.0]] * 3)

    first, second = figures_of_each(simulate_pushed(SIMULATOR, plan, ALIKE, 0.5, blown), plan)
    assert "advance" in first and second == {}
    with pytest.raises(Unsupported):
        simulate_pushed(SIMULATOR, parse_maneuver("spiral:15/5", ESSO, speed=0.5), ALIKE, 0.5, calm)

"""Synthetic trials: limiting cases of the simulated motion, gusts, noise, files, the demo's trials."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.criteria.standard_runs import figures_of, figures_of_each, simulated_trial
from cases.io.read import read_trial, read_trials
from cases.maneuvers.definitions import Limits, parse_maneuver
from cases.shipfiles.ship_file import load_ship, parse_ship
from cases.simulation.demo_trials import OFFSETS, SHIP, demo_trials, hidden_ship
from cases.simulation.harbour_inputs import harbour_inputs, harbour_seed, ranges_of
from cases.simulation.simulate import (
    SensorNoise,
    Wind,
    add_noise,
    gust_filter,
    hino_spectrum,
    parse_wind,
    simulate,
    simulate_controls,
    wrap,
    write_trial,
)
from cases.simulation.simulate_batch import SimulatedRuns, draw_coefficients, simulate_batch
from cases.trial import Trial
from mmg.errors import BadValue, Missing, NoSolution, OutOfRange, Unsupported, UserError
from mmg.messages import has_code
from mmg.motion.flow import INPUTS, STATES
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.actuator_ships import FERRY as FOUR_PODS

ESSO = load_ship(SHIP)


@pytest.fixture(scope="module")
def windy() -> Trial:
    return simulate(ESSO, parse_maneuver("zigzag:20/20", ESSO, duration=60), wind=Wind(1.5, 1.0, gusty=True), seed=3)


def test_wind_pushes_a_ship_at_rest_away_from_where_it_comes() -> None:
    plan = parse_maneuver("straight", ESSO, n=0.0, speed=0.0, duration=50)
    trial = simulate(ESSO, plan, 0.5, Wind(2.0, math.radians(90)))
    assert trial["y"][-1] < -0.1
    np.testing.assert_allclose(trial["wind_speed"], 2.0)
    assert "wind_speed" not in simulate(ESSO, plan, 0.5)


def test_ship_without_wind_model_says_that_wind_has_no_force() -> None:
    still = replace(ESSO, components={role: name for role, name in ESSO.components.items() if role != "wind"})
    plan = parse_maneuver("straight", still, duration=10)
    trial = simulate(still, plan, 0.5, Wind(5.0, 1.0))
    np.testing.assert_allclose(trial["u"], trial["u"][0], rtol=1e-9)


def test_recorded_inputs_give_the_same_motion_back(windy: Trial) -> None:
    again = simulate_controls(ESSO, windy)
    np.testing.assert_allclose(again.states, windy.states, atol=1e-10)


def test_long_samples_are_divided() -> None:
    plan = parse_maneuver("turning:35", ESSO, duration=100)
    fine, coarse = simulate(ESSO, plan, 0.1), simulate(ESSO, plan, 5.0)
    assert len(coarse) == 21
    thin = Trial("thin", {name: values[::50] for name, values in fine.columns.items()})
    for run in (coarse, simulate_controls(ESSO, thin)):
        assert abs(run["r"][-1] - fine["r"][-1]) < 2e-4


def test_motion_that_diverges_is_an_error_that_says_when() -> None:
    wild = ESSO.with_values({"X_0F": 5.0, "N_r": 3.0})
    with pytest.raises(NoSolution):
        simulate(wild, parse_maneuver("turning:35", wild, n=10.0, speed=0.4, duration=200))
    for dt in (0.0, -1.0, math.nan, 1e4):
        with pytest.raises(OutOfRange):
            simulate(ESSO, parse_maneuver("turning:35", ESSO), dt)


def test_gust_filter_has_the_published_constants() -> None:
    """Published check values for mean winds of 10 and 5 m/s."""
    ten, five = gust_filter(10.0), gust_filter(5.0)
    assert hino_spectrum(0.0, 10.0) == pytest.approx(3.78804, rel=1e-5)
    assert ten.alpha_u == pytest.approx(0.36628, rel=2e-5) and ten.sigma_u == pytest.approx(0.71288, rel=2e-5)
    assert ten.sigma_u / math.sqrt(2 * ten.alpha_u) == pytest.approx(0.833, abs=5e-4)
    assert ten.alpha_direction == pytest.approx(0.08168, abs=5e-6)
    spread = math.degrees(ten.sigma_direction) / math.sqrt(2 * ten.alpha_direction)
    assert spread == pytest.approx(5.69, abs=5e-3)
    assert five.alpha_u == pytest.approx(0.20498, rel=3e-5) and five.sigma_u == pytest.approx(0.28210, rel=3e-5)


def test_gusts_have_the_stationary_spread_of_their_filter_at_any_step() -> None:
    for dt in (0.5, 10.0):
        speed, direction = Wind(10.0, 1.0, gusty=True).series(dt * np.arange(40_000), seed=1).T
        assert speed.mean() == pytest.approx(10.0, abs=0.06) and speed.std() == pytest.approx(0.833, rel=0.05)
        assert np.degrees(direction.std()) == pytest.approx(5.69, rel=0.08)
        assert direction.mean() == pytest.approx(1.0, abs=0.02)


def test_wind_is_reproducible_by_seed_and_never_blows_backwards() -> None:
    t = np.arange(0, 500, 0.1)
    a, again, b = (Wind(0.3, 0.0, gusty=True).series(t, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, again)
    assert (a != b).any() and (a[:, 0] >= 0).all() and (a[:, 1] >= 0).all() and (a[:, 1] < 2 * math.pi).all()
    np.testing.assert_array_equal(Wind(1.0, 2.0).series(t[:3]), [[1.0, 2.0]] * 3)
    assert (Wind(0.0, 1.0, gusty=True).series(t)[:, 0] == 0).all()


def test_wind_text_is_read_in_degrees_or_refused() -> None:
    assert parse_wind("1.5:-90:gusty") == Wind(1.5, math.radians(270), True)
    for text in ("", "3", "a:b", "-1:0", "1:2:3", "1:2:gusty:4", "nan:3", "1:inf"):
        with pytest.raises(BadValue):
            parse_wind(text)


def test_noise_has_the_stated_spread_and_leaves_inputs_alone(windy: Trial) -> None:
    long = Trial("long", {**{s: np.zeros(20_000) for s in STATES}, "t": np.arange(20_000.0), "n": np.ones(20_000)})
    noise = SensorNoise()
    noisy, again = add_noise(long, noise, 4), add_noise(long, noise, 4)
    for name in STATES:
        assert noisy[name].std() == pytest.approx(getattr(noise, name), rel=0.03)
        assert abs(noisy[name].mean()) < 4 * getattr(noise, name) / math.sqrt(20_000)
        np.testing.assert_array_equal(noisy[name], again[name])
    np.testing.assert_array_equal(noisy["n"], long["n"])
    assert abs(np.corrcoef(noisy["u"][1:], noisy["u"][:-1])[0, 1]) < 0.03
    large = SensorNoise.for_length(300.0)
    assert (large.x, large.u, large.r) == pytest.approx((1.0, 0.04, 6e-5))


def test_wrapped_heading_stays_in_its_half_open_interval() -> None:
    angles = np.array([math.pi, -math.pi, 3.0, 0.1, 4.0, -4.0, 3 * math.pi])
    wrapped = wrap(angles)
    assert (wrapped > -math.pi).all() and (wrapped <= math.pi).all()
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-12)
    assert wrapped[2] == 3.0 and wrapped[3] == 0.1


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_written_file_reads_back_equal(windy: Trial, tmp_path, suffix: str) -> None:
    path, noisy = tmp_path / f"run{suffix}", add_noise(windy, SensorNoise(), 1)
    write_trial(noisy, path)
    back = read_trial(path)
    assert set(back.columns) == set(noisy.columns)
    for name in noisy.columns:
        np.testing.assert_allclose(back[name], noisy[name], rtol=1e-14, atol=0)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_hidden_ship_lies_within_bounds_and_off_the_start() -> None:
    hidden = hidden_ship()
    assert len(OFFSETS) >= 20
    for symbol, c in hidden.coefficients.items():
        assert c.lower <= c.value <= c.upper
        assert (c.value != ESSO.coefficients[symbol].value) == (symbol in OFFSETS)


@pytest.mark.slow
def test_demo_trials_are_reproducible_and_rich() -> None:
    train, validate = demo_trials(1, dt=0.2)
    assert (len(train), len(validate)) == (7, 2)
    assert len({t.name for t in train + validate}) == 9
    again, other = demo_trials(1, dt=0.2)[0], demo_trials(2, dt=0.2)[0]
    np.testing.assert_array_equal(train[0]["u"], again[0]["u"])
    assert (train[0]["u"] != other[0]["u"]).any()
    for trial in train + validate:
        assert 100 <= trial.duration <= 150 and 0.3 < trial["wind_speed"].mean() < 2.4
        assert trial["u"].max() < 0.5 and trial["u"].min() > -0.3 and np.abs(trial["r"]).max() < 0.1
        assert trial.role in ("train", "validate")
    assert min(trial["n"].min() for trial in train) < -5


# Random use of every actuator: ranges, rates, independence, reproducibility; a craft without propeller and rudder
VECTWIN, FERRY = load_ship("vectwin_3m"), parse_ship(FOUR_PODS)


@pytest.mark.parametrize("ship", [VECTWIN, FERRY, load_ship("kvlcc2_full")], ids=lambda ship: ship.name)
def test_every_actuator_moves_within_its_range_and_rate_and_by_itself(ship: Ship) -> None:
    trial = harbour_inputs(ship, 20000.0, 3)
    positions = np.column_stack([trial[name] for name in ranges_of(ship)])
    for name, (low, high) in ranges_of(ship).items():
        values = trial[name]
        assert low <= values.min() < values.max() <= high
        assert values.max() - values.min() > 0.8 * (high - low)
        rate = Limits.for_ship(ship)
        most = rate.rudder_rate if INPUTS[name][1] == "rad" else rate.propeller_rate
        assert np.abs(np.diff(values)).max() <= most * (trial["t"][1] - trial["t"][0]) + 1e-9
    others = [i for i, name in enumerate(ranges_of(ship)) if not (ship is VECTWIN and name.startswith("delta"))]
    correlation = np.corrcoef(positions[:, others].T) - np.eye(len(others))
    assert np.abs(correlation).max() < 0.15
    assert set(ranges_of(ship)) == set(ship.actuators)


def test_the_vectwin_ship_goes_astern_for_a_part_of_the_time() -> None:
    run = simulated_trial(VECTWIN, None, harbour_inputs(VECTWIN, None, 4), noise=True)
    more = [simulate_controls(VECTWIN, harbour_inputs(VECTWIN, None, seed))["u"] for seed in range(6)]
    assert 0.03 < (np.concatenate(more) < 0).mean() < 0.6
    assert run.duration == 400.0 and run["u"][0] == pytest.approx(0.0, abs=0.05)


def test_the_same_seed_gives_the_same_inputs_and_another_one_others() -> None:
    one, same, other = (harbour_inputs(FERRY, 100.0, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one["azimuth_4"], same["azimuth_4"])
    assert np.abs(one["azimuth_4"] - other["azimuth_4"]).max() > 0.1


def test_wrong_seeds_and_durations_are_one_line() -> None:
    assert [harbour_seed(text, 3) for text in ("harbour:12", "harbour", "turning:35")] == [12, 3, None]
    with pytest.raises(UserError, match="seed"):
        harbour_seed("harbour:x", 0)
    with pytest.raises(OutOfRange):
        harbour_inputs(FERRY, 0.1, 0)


def test_a_trial_of_pods_alone_is_read_without_columns_of_propeller_and_rudder(tmp_path: Path) -> None:
    run = simulate_controls(FERRY, harbour_inputs(FERRY, None, 1))
    path = tmp_path / "run.csv"
    write_trial(run, path)
    frame = run.to_pandas().drop(columns=[name for name in run.to_pandas() if name.split()[0] in ("n", "delta")])
    frame.to_csv(path, index=False)
    (read,) = read_trials([path])
    assert not read["n"].any() and not read["delta"].any() and has_code(read.notices, "no_propeller")
    np.testing.assert_allclose(read["azimuth_3"], run["azimuth_3"], rtol=1e-12)


# Manoeuvres in batches: the motion of one ship simulated by herself, and figures over draws of her coefficients
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
    found = simulate_batch(SIMULATOR, plan, two, 0.5, lambda k, states: push)
    first, second = found.last
    assert first != second
    early, last = (0, int(first)) if first < second else (1, int(second))
    assert (found.states[last + 1 :, :, early] == found.states[last + 1, :, early]).all()


# Draws over the standard errors of the coefficients, and figures of runs that are pushed
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
    with pytest.raises(Missing):
        draw_coefficients(ESSO.fixing(ESSO.symbols), 5)


FIRST = ESSO.coefficients[ESSO.free[0]]
ALIKE = {FIRST.symbol: np.full(2, FIRST.value)}  # two ships as she is


def calm(k: int, states: np.ndarray) -> np.ndarray:
    """No push."""
    return np.zeros((3, states.shape[1]))


@pytest.mark.parametrize("text", ["turning:35", "zigzag:-10/10", "zigzag:20/20", "crash-stop"])
def test_figures_of_a_batch_are_those_of_each_run(text: str) -> None:
    plan, scattered = parse_maneuver(text, ESSO, speed=0.5), {FIRST.symbol: FIRST.value * np.array([1.0, 0.9, 1.1])}
    whole = simulate_batch(SIMULATOR, plan, scattered, 0.5)
    pushed = simulate_batch(SIMULATOR, plan, scattered, 0.5, calm)
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
    runs = simulate_batch(SIMULATOR, plan, ALIKE, 0.1, lambda k, states: push)
    gained = runs.states[:11, 3, 1] - runs.states[:11, 3, 0]  # before damping tells
    np.testing.assert_allclose(gained[1:], 1e-5 * np.arange(1, 11), rtol=0.05)


def test_a_diverging_run_has_no_figures() -> None:
    plan = parse_maneuver("turning:35", ESSO, speed=0.5)

    def blown(k: int, states: np.ndarray) -> np.ndarray:
        return np.array([[0.0, np.nan if k == 20 else 0.0]] * 3)

    first, second = figures_of_each(simulate_batch(SIMULATOR, plan, ALIKE, 0.5, blown), plan)
    assert "advance" in first and second == {}

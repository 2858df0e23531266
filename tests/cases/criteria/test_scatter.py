"""Scatter of a manoeuvre over the standard errors of the coefficients."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cases.criteria.scatter import ManeuverScatter, draw_coefficients, scatter
from cases.criteria.standard_runs import figures_of, figures_of_each, simulated_run, simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate_batch import simulate_batch, simulate_pushed
from mmg.errors import Missing, Unsupported, UserError
from mmg.messages import has_code
from mmg.rollout import Simulator

ESSO = load_ship("esso_osaka_3m")


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


def test_one_call_makes_a_trial_with_effects_wind_and_noise() -> None:
    quiet = simulated_trial(ESSO, "straight", wind="1:90", dt=0.5)
    noisy = simulated_trial(with_effects(ESSO, ["current:x=0.05"]), "straight", wind="1:90", noise=True, dt=0.5)
    assert quiet.has_wind and len(quiet) == len(noisy)
    assert noisy["x"][-1] - quiet["x"][-1] == pytest.approx(0.05 * quiet.duration, abs=1.0)
    again = simulated_trial(ESSO, controls=quiet)
    np.testing.assert_allclose(again.states, quiet.states, atol=1e-9)
    assert math.isfinite(float(again["u"][-1]))
    with pytest.raises(UserError, match="either"):
        simulated_trial(ESSO)


SIMULATOR, FIRST = Simulator(ESSO), ESSO.coefficients[ESSO.free[0]]
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

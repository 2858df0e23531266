"""A ship's own rates from her trials: the truth comes back, and where the trials do not show it nothing is claimed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.criteria.imo import helm_words, imo_figures
from cases.criteria.own_rates import (
    BOUND,
    MEASURED,
    Ramp,
    order_delay,
    ramps_of,
    slew_rate,
    with_own_rates,
    with_speed_through_water,
)
from cases.maneuvers.definitions import Limits, parse_maneuver
from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import dump_ship, dump_ship_json, load_ship, parse_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.ship import Ship

MANEUVERS = ("zigzag:20/20", "zigzag:10/10", "turning:35")


def bare(name: str) -> Ship:
    """A ship of the library whose file states no rate."""
    ship = load_ship(name)
    return replace(ship, particulars={k: v for k, v in ship.particulars.items() if k not in ("rudder_rate", "U_0")})


@cache
def trials(name: str, rate: float, dt: float, noise: float = 0.2) -> tuple[Trial, ...]:
    """Trials of the ``bare`` ship with a rudder of this ``rate`` [deg/s], logged every ``dt`` [s], ``noise`` [deg]."""
    ship, rng, found = bare(name), np.random.default_rng(3), []
    for text in MANEUVERS:
        plan = parse_maneuver(text, ship, speed=0.07 * math.sqrt(9.81 * ship.particulars["L"]),
                              rudder_rate=math.radians(rate))  # fmt: skip
        trial = simulate(ship, plan, dt)
        noisy = trial["delta"] + math.radians(noise) * rng.standard_normal(len(trial))
        found.append(replace(trial.with_columns(delta=noisy), name=text.replace(":", " ").replace("/", " ")))
    return tuple(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rate", "dt"),
    [("kvlcc2_full", 2.5, 0.5), ("kvlcc2_full", 2.5, 1.0), ("esso_osaka_3m", 20.0, 0.1), ("esso_osaka_3m", 12.0, 0.1),
     ("esso_osaka_3m", 12.0, 1.0)],
)  # fmt: skip
def test_the_rate_of_the_rudder_comes_back_and_simulations_use_it(name: str, rate: float, dt: float) -> None:
    ship = bare(name)
    found, said = with_own_rates(ship, trials(name, rate, dt))
    assert math.degrees(found.particulars["rudder_rate"]) == pytest.approx(rate, rel=0.05)
    assert found.particulars["approach_speed"] == pytest.approx(
        0.07 * math.sqrt(9.81 * ship.particulars["L"]), rel=0.05
    )
    assert found.sources["rudder_rate"].startswith(MEASURED) and not said
    assert Limits.for_ship(found).rudder_rate == found.particulars["rudder_rate"]
    again = parse_ship(dump_ship(found))
    assert again.sources == found.sources and again.particulars == found.particulars


@pytest.mark.slow
@pytest.mark.parametrize("by_run", [False, True])
def test_the_approach_speed_of_a_calibrated_ship_is_through_the_water(by_run: bool) -> None:
    """In a current of 0.05 m/s to the north, on heading north."""
    still = trials("esso_osaka_3m", 20.0, 0.1)
    over_ground = [trial.through_water(-0.05, 0.0) for trial in still]
    expected = with_own_rates(bare("esso_osaka_3m"), still)[0].particulars["approach_speed"]
    ship, _ = with_own_rates(bare("esso_osaka_3m"), over_ground)
    assert ship.particulars["approach_speed"] == pytest.approx(expected + 0.05, abs=1e-3)
    assert with_speed_through_water(ship, over_ground) is ship  # no current is known
    current = {"current.x": {"value": 0.05}, "current.y": {"value": 0.0}}
    rows = {trial.name: current for trial in over_ground} if by_run else None
    drifting = ship if by_run else ship.with_effect("current", {"x": 0.05, "y": 0.0})
    found = with_speed_through_water(drifting, over_ground, rows)
    assert found.particulars["approach_speed"] == pytest.approx(expected, abs=1e-3)
    assert found.sources == ship.sources
    stated = replace(drifting, sources={})
    assert with_speed_through_water(stated, over_ground, rows) is stated


def straight(name: str, t: np.ndarray, **columns: np.ndarray) -> Trial:
    """A run north at 1 m/s with 1 rps but for these columns."""
    still = dict.fromkeys(("x", "y", "psi", "v", "r", "delta"), np.zeros(len(t)))
    return Trial(name, {"t": t, **still, "u": np.ones(len(t)), "n": np.ones(len(t)), **columns})


def test_a_move_that_begins_in_another_has_no_size_that_others_are_judged_by() -> None:
    """An autopilot goes to and fro, then the rudder is put over at the same rate, without a stand before."""
    t, rate, swing, half = np.arange(120.0), 2.5, 4.5, 3.6
    begin = 9 * 2 * half + half - 3.5
    fro = rate * np.abs((t + 3.5) % (2 * half) - half) - swing
    over = np.where(t < begin, fro, np.minimum(rate * (t - begin) - swing, 35.0))
    turn = np.clip(rate * (t - 20), 0, 9) - np.clip(rate * (t - 70), 0, 18) + np.clip(rate * (t - 100), 0, 18)
    runs = [straight(str(k), t, delta=np.radians(x)) for k, x in enumerate((over, turn))]
    found = slew_rate([ramp for run in runs for ramp in ramps_of(run, run["delta"])])
    assert found is not None and found.limit and math.degrees(found.rate) == pytest.approx(rate, rel=0.01)


def test_large_moves_by_hand_in_another_run_deny_no_limit() -> None:
    """Two zigzags at 12 deg/s, and pods that somebody turns by 100 deg, slowly and along no straight line."""
    t, rate = np.arange(120.0), 12.0
    turn = np.clip(rate * (t - 20), 0, 20) - np.clip(rate * (t - 70), 0, 40) + np.clip(rate * (t - 100), 0, 40)
    hand = 50.0 * np.sin(2 * np.pi * t / 60)
    runs = [straight(str(k), t, delta=np.radians(x)) for k, x in enumerate((turn, -turn, hand))]
    found = slew_rate([ramp for run in runs for ramp in ramps_of(run, run["delta"])])
    assert found is not None and found.limit and math.degrees(found.rate) == pytest.approx(rate, rel=0.01)
    assert found.trials == ("0", "1")


def test_the_rate_of_an_engine_and_a_rudder_that_is_not_midships_come_back() -> None:
    ship = bare("esso_osaka_3m")
    runs = trials("esso_osaka_3m", 20.0, 0.1)
    ramp = np.clip(2.0 * (runs[0].t[None, :] - np.array([[40.0], [60.0]])), 0, 6)  # [1/s], two moves at 2 1/s^2
    still = [replace(r.with_columns(delta=r["delta"] + math.radians(1.5)), name=r.name) for r in runs]
    revolving = runs[0].with_columns(n=10.0 - ramp[0] + ramp[1])
    found, _ = with_own_rates(ship, [revolving, *still])
    assert found.particulars["propeller_rate"] == pytest.approx(2.0, rel=0.05)
    assert math.degrees(found.particulars["neutral_rudder"]) == pytest.approx(1.5, abs=0.2)


def ordered(dt: float, delay: float, noise: float, seed: int, lag: float = 0.0) -> Trial:
    """A run of 600 s with ten orders at times of no grid, a rudder of 2.5 deg/s that waits so long, and logged orders;
    lag: time constant [s] with which the orders themselves are approached, as by an autopilot."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 600.0, dt)
    times = 30.0 + 55.0 * np.arange(10) + rng.uniform(0, 5, 10)
    steps = np.array([10.0, *[-20.0, 20.0] * 4, -20.0])
    begins, angles = times + delay, np.cumsum(steps)
    corners, reached = np.stack([begins, begins + np.abs(steps) / 2.5], 1), np.stack([angles - steps, angles], 1)
    since = np.clip(t[:, None] - times, 0.0, None)
    order = np.where(since > 0, 1 - np.exp(-since / lag) if lag else 1.0, 0.0) @ steps
    delta = np.radians(np.interp(t, corners.ravel(), reached.ravel()) + noise * rng.standard_normal(len(t)))
    run = straight(f"run_{seed}", t, delta=delta, delta_order=np.radians(order))
    return replace(run, meta={"inputs": "sampled"})


def moves_of(run: Trial) -> tuple[Trial, list[Ramp], np.ndarray]:
    """What ``order_delay`` takes of a run."""
    return run, ramps_of(run, run["delta"]), run["delta_order"]


@pytest.mark.parametrize(("dt", "noise"), [(0.1, 0.1), (0.5, 0.1), (1.0, 0.05)])
@pytest.mark.parametrize("delay", [0.8, 2.0])
def test_a_rudder_waits_as_long_as_its_orders_say(dt: float, noise: float, delay: float) -> None:
    trials = [ordered(dt, delay, noise, seed) for seed in (1, 2)]
    found = order_delay([moves_of(run) for run in trials])
    assert found is not None and found[0] == pytest.approx(delay, abs=0.05 + 0.15 * dt)
    ship, _ = with_own_rates(bare("kvlcc2_full"), trials)
    assert ship.particulars["rudder_delay"] == found[0] and ship.sources["rudder_delay"].startswith(MEASURED)
    assert Limits.for_ship(ship).rudder_delay == found[0]
    assert "it waits" in helm_words(ship)


def test_orders_that_show_no_delay_claim_none() -> None:
    """A rudder that obeys at once, orders that are no steps, and those of the other sign."""
    assert order_delay([moves_of(ordered(0.5, 0.0, 0.1, 1))]) is None
    assert order_delay([moves_of(ordered(0.5, 1.0, 0.1, 1, lag=20.0))]) is None
    run = ordered(0.5, 1.0, 0.1, 1)
    assert order_delay([moves_of(run)]) is not None
    assert order_delay([moves_of(run.with_columns(delta_order=-run["delta_order"]))]) is None
    slow = 0.001 * np.random.default_rng(0).standard_normal(len(run))
    for k in range(3, len(run)):  # a rudder that creeps to its order: where it begins is not seen
        slow[k] += slow[k - 1] + 0.08 * (run["delta_order"][k - 3] - slow[k - 1])
    assert order_delay([moves_of(run.with_columns(delta=slow))]) is None
    found, _ = with_own_rates(bare("esso_osaka_3m"), [ordered(0.5, 5.0, 0.1, 1)])
    assert "rudder_delay" not in found.particulars  # no gear of a model waits so long


def test_an_engine_waits_as_long_as_its_orders_astern_say() -> None:
    """Only where there is an engine; orders ahead do not count."""
    run = ordered(0.5, 1.0, 0.1, 1)
    t = run.t
    moves = [(40.0, 0.5, 3.0), (140.0, -0.8, 8.0), (260.0, 1.0, 3.0), (400.0, -0.6, 8.0), (500.0, 1.0, 3.0)]
    n, order = np.full(len(t), 1.2), np.full(len(t), 1.2)
    for when, level, delay in moves:
        n += np.clip(0.1 * (t - when - delay), 0.0, abs(level - n[-1])) * np.sign(level - n[-1])
        order = np.where(t >= when, level, order)
    trial = run.with_columns(n=n, n_order=order)
    ship, _ = with_own_rates(bare("kvlcc2_full"), [trial])
    assert ship.particulars["engine_delay"] == pytest.approx(8.0, abs=0.4)
    assert "engine_delay" not in with_own_rates(bare("esso_osaka_3m"), [trial])[0].particulars


@pytest.mark.parametrize("kind", ["slow helm", "orders", "held"])
def test_trials_without_a_slew_at_the_limit_show_none(kind: str) -> None:
    ship, t, rng = bare("esso_osaka_3m"), np.arange(0.0, 600.0, 0.5), np.random.default_rng(1)
    delta = {
        "slow helm": np.radians(10.0) * np.sin(2 * np.pi * t / 60) + 0.002 * rng.standard_normal(len(t)),
        "orders": np.radians(20.0) * np.sign(np.sin(2 * np.pi * t / 60)),
        "held": np.full(len(t), 0.1),
    }[kind]
    zero = np.zeros(len(t))
    trial = Trial("run", {"t": t, "psi": zero, "u": zero + 1, "v": zero, "r": zero, "n": zero + 10, "delta": delta})
    slew = slew_rate(ramps_of(trial, delta))
    assert (slew is not None and not slew.limit) if kind == "slow helm" else slew is None
    found, said = with_own_rates(ship, [trial])
    assert "rudder_rate" not in found.particulars and [m.code for m in said] == ["rudder_rate_by_rule"]


def servo(t: np.ndarray, order: np.ndarray, rate: float, T: float) -> np.ndarray:
    """Angles (N,) [deg] at the times ``t`` (N,) [s] of a gear of first order, time constant ``T`` [s], with a limited
    ``rate`` [deg/s]."""
    angle = np.zeros(len(t))
    for k in range(1, len(t)):
        step = (t[k] - t[k - 1]) / 20
        angle[k] = angle[k - 1]
        for _ in range(20):
            angle[k] += step * np.clip((order[k - 1] - angle[k]) / T, -rate, rate)
    return angle


@pytest.mark.parametrize("rate", [45.0, 10.0])
def test_a_gear_is_not_simulated_slower_than_it_moved(rate: float) -> None:
    """Servos that slow down before they arrive, of a model for whom a rule says 20 deg/s: a bound that counts above
    it, and says no more below it."""
    t = np.arange(0.0, 120.0, 0.1)
    angle = servo(t, 20.0 * np.sign(np.sin(2 * np.pi * t / 30)), rate, 0.3 if rate > 20 else 2.0)
    angle += 0.1 * np.random.default_rng(5).standard_normal(len(t))
    ship = bare("esso_osaka_3m")
    found, said = with_own_rates(ship, [straight("run", t, delta=np.radians(angle))])
    if rate < 20:
        assert "rudder_rate" not in found.particulars and [m.code for m in said] == ["rudder_rate_by_rule"]
        return
    assert 0.8 * rate < math.degrees(found.particulars["rudder_rate"]) < rate
    assert [m.code for m in said] == [BOUND] and found.sources["rudder_rate"].endswith("a lower bound")
    stated = replace(ship, particulars={**ship.particulars, "rudder_rate": math.radians(60.0)})
    assert not with_own_rates(stated, [straight("run", t, delta=np.radians(angle))])[1]  # no contradiction of a bound


@pytest.mark.slow
def test_what_the_ship_file_states_stays_and_a_difference_is_said() -> None:
    ship = bare("esso_osaka_3m")
    stated = replace(ship, particulars={**ship.particulars, "rudder_rate": math.radians(20.0)})
    found, said = with_own_rates(stated, trials("esso_osaka_3m", 12.0, 0.1))
    assert found.particulars["rudder_rate"] == math.radians(20.0) and "rudder_rate" not in found.sources
    assert [m.code for m in said] == ["rudder_rate_differs"]
    before, _ = with_own_rates(ship, trials("esso_osaka_3m", 20.0, 0.1))
    again, _ = with_own_rates(before, trials("esso_osaka_3m", 12.0, 0.1))  # what was measured before is measured anew
    assert math.degrees(again.particulars["rudder_rate"]) == pytest.approx(12.0, rel=0.05)


@pytest.mark.slow
def test_what_is_a_rule_of_thumb_stands_beside_the_figures_that_hang_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cases.criteria.imo.STANDARD", ("turning:35", "zigzag:10/10", "crash-stop"))
    ship = new_ship("own", {"L": 120.0, "B": 20.0, "d": 7.0, "C_b": 0.75})
    assert ship.sources["U_0"].startswith("rule") and parse_ship(dump_ship(ship)).sources == ship.sources
    assert json.loads(dump_ship_json(ship))["sources"] == ship.sources
    steered = [row for row in imo_figures(ship).rows if row.run.startswith(("turning", "zigzag"))]
    assert steered and all("rudder rate" in row.why and "test speed" in row.why for row in steered)
    known = new_ship("own", {"L": 120.0, "B": 20.0, "d": 7.0, "C_b": 0.75, "U_0": 7.0, "rudder_rate": 0.0436})
    rows = imo_figures(known).rows
    assert not any("rudder rate" in row.why or "test speed" in row.why for row in rows)
    assert all("engine" in row.why for row in rows if row.run == "crash-stop")


@pytest.mark.slow
@pytest.mark.parametrize("gear", [1.0, 6.0])
def test_a_propeller_by_rule_becomes_the_one_that_keeps_the_approach(gear: float) -> None:
    """Revolutions of an engine before a gear tell no diameter, nor does a trial of a ship that states hers."""
    sizes = {"L": 120.0, "B": 20.0, "d": 7.0, "C_b": 0.75, "U_0": 7.0}
    true, start = new_ship("true", {**sizes, "D_P": 4.6}), new_ship("start", sizes)
    plan = parse_maneuver("zigzag:20/20", true, speed=7.0)
    trial = simulate(true, plan, 1.0)
    logged = replace(trial.with_columns(n=gear * trial["n"]), name="zigzag")
    found, _ = with_own_rates(start, [logged])
    if gear != 1.0:
        assert found.particulars["D_P"] == start.particulars["D_P"] and found.sources["D_P"].startswith("rule")
        return
    assert found.particulars["D_P"] == pytest.approx(4.6, rel=0.01) and found.sources["D_P"].startswith(MEASURED)
    assert revolutions_for(found, found.particulars["approach_speed"]) == pytest.approx(trial["n"][0], rel=2e-3)
    stated, _ = with_own_rates(new_ship("stated", {**sizes, "D_P": 3.9}), [logged])
    assert stated.particulars["D_P"] == 3.9 and "D_P" not in stated.sources

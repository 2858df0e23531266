"""Bands widen for motions that the trials did not hold, and only for those."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from cases.criteria.scatter import draw_coefficients
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import simulate_batch
from cases.trial import Trial
from fitting.nlp.windows import Record
from fitting.prediction.bands import Bands, Process, process_dict
from fitting.prediction.envelope import (
    MOST_NEW,
    HeldMotion,
    envelope_of,
    held_dict,
    held_motion,
    held_of,
    met_so_far,
    trial_envelope,
)
from fitting.prediction.figure_intervals import (
    RESISTANCE,
    UNTRIED,
    accelerations,
    drawn_figures,
    drawn_resistance,
    fading,
    greatest_accelerations,
    slow_speed,
)
from fitting.prediction.predict import predict, record_of
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.synthetic_runs import coarse_runs


@cache
def run(maneuver: str, ship: str = "", n: float = 10.0, duration: float = 100.0) -> Trial:
    return simulate(model(ship), parse_maneuver(maneuver, model(ship), n=n, duration=duration), dt=0.5)


def model(ship: str) -> Ship:
    return load_ship(ship) if ship else hidden_ship()


def records(*maneuvers: str, ship: str = "", n: float = 10.0) -> list[Record]:
    return [record_of(run(m, ship, n), model(ship).inputs) for m in maneuvers]


def held(*maneuvers: str, ship: str = "", n: float = 10.0) -> Any:
    return held_motion(records(*maneuvers, ship=ship, n=n), model(ship).inputs, model(ship).particulars["L"])


def novelty(known: HeldMotion, maneuver: str, ship: str = "", n: float = 10.0) -> np.ndarray:
    (record,) = records(maneuver, ship=ship, n=n)
    return known.novelty(record.states[:, :, None], record.controls[:, :, None], model(ship).particulars["L"])[:, 0]


def test_other_revolutions_are_new_and_novelty_has_an_end_and_counts_from_the_start() -> None:
    known = held("zigzag:10/10", "zigzag:20/20")
    (record,) = records("zigzag:20/20")
    controls = record.controls.copy()
    controls[:, 0] *= 2
    assert known.novelty(record.states[:, :, None], controls[:, :, None], 3.0).min() > 1
    assert (known.novelty(np.full((5, 6, 2), 1e3), np.zeros((5, 4, 2)), 3.0) == MOST_NEW).all()
    met = met_so_far(np.arange(5.0)[:, None], np.array([0.0, 0, 2, 2, 2])[:, None])
    np.testing.assert_allclose(met[:, 0], [0, 0, 2, 8 / 3, 3])


@pytest.mark.parametrize(("ship", "n"), [("", 10.0), ("kvlcc2_l7", 3.0)])
def test_a_circle_is_new_to_zigzags_and_another_zigzag_is_not(ship: str, n: float) -> None:
    known = held("zigzag:10/10", "zigzag:20/20", "zigzag:15/15", ship=ship, n=n)
    circle, zigzag = novelty(known, "turning:35", ship, n), novelty(known, "zigzag:18/18", ship, n)
    assert np.median(circle[len(circle) // 2 :]) > 0.5
    assert np.quantile(zigzag, 0.9) < 0.2


def test_the_band_of_a_circle_widens_and_that_of_a_zigzag_stays() -> None:
    wide, ratio = bands(0.002, ""), {}
    bare = replace(wide, held=None)
    for maneuver in ("turning:35", "zigzag:18/18"):
        pair = [predict(Simulator(hidden_ship()), run(maneuver), 60.0, 60.0, bands=b)[0][0].std for b in (bare, wide)]
        ratio[maneuver] = (pair[1][-1] / pair[0][-1]).mean()
    assert ratio["turning:35"] > 1.08 and ratio["zigzag:18/18"] < 1.02


def test_it_is_stored_as_plain_values_and_only_for_the_same_inputs() -> None:
    known, names = held("zigzag:10/10", "zigzag:20/20"), hidden_ship().inputs
    again = held_of(json.loads(json.dumps(held_dict(known))), names)
    assert again is not None and again.reach == known.reach
    assert held_of(held_dict(known), ("n", "delta_port", "delta_starboard")) is None
    assert held_of(None, names) is None and held_of({"points": [1]}, names) is None
    assert held_motion([], names, 3.0) is None


def test_a_single_trial_says_what_it_held_by_its_halves() -> None:
    """A turning circle is new to a ship that was tried in one zigzag, and that zigzag is not."""
    one = held("zigzag:20/20")
    assert np.mean(novelty(one, "zigzag:20/20") > 0) < 0.2 < 0.5 < np.mean(novelty(one, "turning:35") > 0)


# The envelope is the range of what the force models saw in the trials
def test_it_holds_the_extremes_of_the_trials_of_velocities_through_the_water() -> None:
    ship, trials = load_ship("esso_osaka_3m"), coarse_runs()[0][:2]
    columns = {name: np.concatenate([t[name] for t in trials]) for name in ("psi", "u", "v", "r", "n", "delta")}
    for current in (0.0, 5.0):
        found = trial_envelope(ship.with_effect("current", {"x": current, "y": 0.0}) if current else ship, trials)
        assert set(found) >= {*ship.features, "beta"}
        through = {"u": columns["u"] - current * np.cos(columns["psi"]),
                   "v": columns["v"] + current * np.sin(columns["psi"])}  # fmt: skip
        for name, values in (columns | through).items():
            assert name == "psi" or found[name] == pytest.approx([values.min(), values.max()])


def test_rows_with_gaps_count_nothing() -> None:
    ship, trial = load_ship("esso_osaka_3m"), coarse_runs()[0][0]
    u = trial["u"].copy()
    u[5], u[6] = 99.0, np.nan
    v = trial["v"].copy()
    v[5] = np.nan
    assert trial_envelope(ship, [trial.with_columns(u=u, v=v)])["u"][1] < 10.0
    assert trial_envelope(ship, [trial.with_columns(u=np.full_like(u, np.nan))]) == {}


def test_a_drift_angle_near_rest_counts_nothing() -> None:
    features = np.array([[1.0, 1.0, 0.001], [0.0, -0.1, -0.01], [0.0, 0.0, 0.0]])
    assert envelope_of(("u", "v", "r"), features)["beta"] == pytest.approx([0.0, np.arctan(0.1)])


# What no model explains lasts for a ship, passes in a trial, fades at rest, and never keeps a ship from stopping
SPEED, STEP, COUNT = 0.4, 0.5, 400


def bands(size: float, ship: str = "esso_osaka_3m") -> Any:
    """Of a ship tried in zigzags at about 0.4 m/s, with a process of that ``size`` [m/s^2]."""
    sizes, one = np.zeros((3, 3)), np.ones((1, 6))
    sizes[:, 0] = size, size, size / 3
    process = Process(np.full(3, 2.0), np.full(3, 20.0), sizes, np.zeros(6), one, one, np.array([30.0]))
    return Bands(process, np.zeros((len(model(ship).symbols), 0)), held("zigzag:10/10", "zigzag:20/20", ship=ship))


def nominal_run(kind: str = "crash-stop", speed: float = SPEED) -> tuple[Any, Any, Any]:
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver(kind, ship, speed=speed)
    return ship, plan, simulate_batch(Simulator(ship), plan, dt=STEP)


def test_a_stop_never_tried_has_a_share_of_its_deceleration_as_error() -> None:
    """Each ship's own: what she loses in a step without it, also while it is added to that."""
    ship, plan, nominal = nominal_run()
    k = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED))
    here = np.tile(nominal.states[k, :, 0][:, None], (1, 2 * COUNT))
    for known, copies in ((bands(1e-6), 2), (None, 1)):  # of a ship without trials too
        push = accelerations(known, ship, plan, nominal, COUNT, STEP, 1)
        states, loss = here[:, : copies * COUNT].copy(), 0.004
        for step in range(3):
            value = push(k + step, states)
            expected = UNTRIED * loss if step else 0.0
            assert value[0, :COUNT].std() == pytest.approx(expected, rel=0.1, abs=1e-6)
            states[3] += STEP * (value[0] - loss)


def test_no_lasting_part_exceeds_a_share_of_what_turns_the_ship() -> None:
    """However large the errors of the trials grow outside them."""
    ship, plan, nominal = nominal_run("turning:35", 1.2)
    most = greatest_accelerations(nominal)
    t, u, r = nominal.t, nominal.states[:, 3, 0], nominal.states[:, 5, 0]
    k = int(np.argmax(np.abs(u * r)))
    assert most[0] == most[1] >= 0.9 * abs(u[k] * r[k]) and 0 < most[2] < 1.0
    assert most[2] == pytest.approx(np.abs(np.diff(r) / np.diff(t)).max(), rel=0.2)
    states = np.tile(nominal.states[k, :, 0][:, None], (1, 2 * COUNT))
    stds = [accelerations(bands(size), ship, plan, nominal, COUNT, STEP, 1)(k, states)[:, :COUNT].std(axis=1)
            for size in (1e-5, 0.1, 10.0)]  # fmt: skip
    assert stds[1] == pytest.approx(UNTRIED * most, rel=0.1) and stds[2] == pytest.approx(stds[1])
    assert (stds[0] < 0.05 * stds[1]).all()


def test_the_lasting_part_fades_with_the_square_of_the_speed() -> None:
    known = bands(0.01)
    slow = slow_speed(known.held)
    assert 0.2 < slow < SPEED + 0.1
    states = np.zeros((6, 4))
    states[3] = 0.0, 0.5 * slow, -slow, 2 * slow
    assert fading(states, slow) == pytest.approx([0.0, 0.25, 1.0, 1.0])
    assert fading(states, 0.0) == pytest.approx(np.ones(4))
    ship, plan, nominal = nominal_run()
    push = accelerations(known, ship, plan, nominal, COUNT, STEP, 1)
    k = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED))
    at_rest = push(k, np.zeros((6, 2 * COUNT)))
    assert not at_rest[1:, :COUNT].any()
    assert (at_rest[:, COUNT:].std(axis=1) > 0).all()  # gusts do not ask for speed


@pytest.mark.slow
def test_a_stop_never_tried_ends_however_little_the_model_explains() -> None:
    """The interval of a stop that no trial held is wide, and has an upper end."""
    ship, plan, _ = nominal_run()
    few = ship.fixing([s for s in ship.free if s != "t_P"])
    reach = {}
    for size in (1e-4, 0.02):
        b = bands(size)
        content = {"bands": process_dict(b.process) | {"held": held_dict(b.held)}}
        found, _ = drawn_figures(Simulator(few), plan, draw_coefficients(few, 120, 3), content, 3)
        reach[size] = found.ship["track_reach"]
        assert np.isfinite(reach[size]).mean() > 0.97
    for values in reach.values():
        low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95))
        assert low < 0.8 * middle < 1.4 * middle < high < 4 * middle


def test_the_resistance_of_a_stop_is_drawn_where_it_is_an_estimate() -> None:
    full = load_ship("kvlcc2_full")
    plan = parse_maneuver("crash-stop", full)
    drawn = drawn_resistance(full, plan, {}, 2000, 0)
    (symbol,) = plan.factors
    assert set(drawn) == {symbol}
    shares = np.log(drawn[symbol] / full.coefficients[symbol].value)
    assert shares.std() == pytest.approx(RESISTANCE, rel=0.1) and abs(shares.mean()) < 0.01
    assert drawn_resistance(full, parse_maneuver("turning:35", full), {}, 10, 0) == {}

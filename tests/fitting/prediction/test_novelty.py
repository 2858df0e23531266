"""Bands widen for motions that the trials did not hold, and only for those."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial
from fitting.nlp.windows import Record
from fitting.prediction.bands import Bands, Process
from fitting.prediction.envelope import (
    MOST_NEW,
    HeldMotion,
    covering,
    envelope_of,
    held_dict,
    held_motion,
    held_of,
    met_so_far,
    nearest,
    trial_envelope,
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


@pytest.mark.parametrize(("ship", "n"), [("", 10.0), ("kvlcc2_l7", 3.0)])
def test_a_circle_is_new_to_zigzags_and_another_zigzag_is_not(ship: str, n: float) -> None:
    known = held("zigzag:10/10", "zigzag:20/20", "zigzag:15/15", ship=ship, n=n)
    circle, zigzag = novelty(known, "turning:35", ship, n), novelty(known, "zigzag:18/18", ship, n)
    assert np.median(circle[len(circle) // 2 :]) > 0.5
    assert np.quantile(zigzag, 0.9) < 0.2


def test_other_revolutions_are_new() -> None:
    known = held("zigzag:10/10", "zigzag:20/20")
    (record,) = records("zigzag:20/20")
    controls = record.controls.copy()
    controls[:, 0] *= 2
    assert known.novelty(record.states[:, :, None], controls[:, :, None], 3.0).min() > 1


def test_novelty_has_an_end_and_counts_from_the_start() -> None:
    known = held("zigzag:10/10", "zigzag:20/20")
    far = np.full((5, 6, 2), 1e3)
    assert (known.novelty(far, np.zeros((5, 4, 2)), 3.0) == MOST_NEW).all()
    times = np.arange(5.0)[:, None]
    met = met_so_far(times, np.array([0.0, 0, 2, 2, 2])[:, None])
    np.testing.assert_allclose(met[:, 0], [0, 0, 2, 8 / 3, 3])


def test_the_band_of_a_circle_widens_and_that_of_a_zigzag_stays() -> None:
    one = np.ones((1, 6))
    process = Process(np.full(3, 3.0), np.full(3, 15.0), np.full((3, 3), 0.002), np.zeros(6), one, one, np.ones(1))
    none = np.zeros((len(hidden_ship().symbols), 0))
    bare, wide = Bands(process, none), Bands(process, none, held("zigzag:10/10", "zigzag:20/20", "zigzag:15/15"))
    ratio = {}
    for maneuver in ("turning:35", "zigzag:18/18"):
        pair = [predict(Simulator(hidden_ship()), run(maneuver), 60.0, 60.0, bands=b)[0][0].std for b in (bare, wide)]
        ratio[maneuver] = (pair[1][-1] / pair[0][-1]).mean()
    assert ratio["turning:35"] > 1.2 and ratio["zigzag:18/18"] < 1.05


def test_points_cover_the_rows() -> None:
    rows = np.random.default_rng(0).normal(size=(500, 3))
    points = covering(rows, 60)
    assert nearest(rows, points).max() < nearest(rows, rows[:60]).max()
    assert len(covering(np.ones((5, 2)), 3)) == 1


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

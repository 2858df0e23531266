"""Manoeuvres of any step, several in a record, with hardly an approach: of a foreign ship and of one of the library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.file_faults.plant import SETS, Plant, Weather, run
from cases.criteria.imo import imo_figures_of_trials
from cases.criteria.measured_maneuvers import find_maneuvers
from cases.criteria.standard_runs import measured_runs
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.errors import Missing
from tests.support.measured_maneuvers import foreign, logged, program, title

MODEL, SHIP = "3 m tanker, hard, 10 Hz", "320 m tanker, mild and hard, 1 Hz"
SEED = 77


def titles(trial: Trial, length: float) -> list[str]:
    return [execute.title for execute in find_maneuvers(trial, length)]


@pytest.mark.parametrize("steps", [(5, 1), (20, 10)])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("name", [MODEL, SHIP])
def test_zigzags_of_any_step_of_a_foreign_ship_are_read_as_ordered(
    name: str, side: int, steps: tuple[int, int]
) -> None:
    case = foreign(name, "zigzag", side, steps, np.random.default_rng([SEED, *steps]))
    assert titles(case.trial, case.length) == [title("zigzag", side, steps)]


def test_a_5_1_with_many_reversals_is_one_zigzag_with_all_its_reversals() -> None:
    ship = load_ship("esso_osaka_3m")
    clean = simulate(ship, parse_maneuver("zigzag:5/1", ship, speed=0.5, duration=260.0), 0.2)
    trial = logged(dict(clean.columns), 3.0, np.random.default_rng(SEED))
    (found,) = find_maneuvers(trial, 3.0)
    assert found.title == "zigzag 5/1" and len(found.reversals) >= 8
    (measured,) = measured_runs(trial, 3.0)
    assert 0 < math.degrees(measured.figures["overshoot_1"]) < 5


def test_several_manoeuvres_in_one_record_are_cut_judged_and_listed() -> None:
    some = SETS[SHIP]
    unit, rng = some.hull.length / some.hull.speed, np.random.default_rng(SEED)
    plan = [("zigzag", 10.0, 10.0), ("turning", 35.0, 560.0), ("zigzag", -20.0, 20.0)]
    columns = run(Plant(some.hull, Weather(), rng), program(plan, 2.0, 15 * unit), 130 * unit, 1.0, 2.0)
    trial = logged(columns | {"n": np.full(len(columns["t"]), 1.5)}, some.hull.length, rng)
    found = imo_figures_of_trials([trial], length=some.hull.length)
    assert [r.title for r in found.runs] == ["zigzag 10/10", "turning 35", "zigzag -20/20"]
    assert [r.name for r in found.runs] == [f"run {k} ({r.title})" for k, r in enumerate(found.runs, 1)]
    assert "1 of 1 runs, 3 manoeuvres" in found.heading
    rows = {(row.run, row.figure): row for row in found.rows}
    assert rows["run 2 (turning 35)", "advance"].verdict == "pass"
    assert rows["run 1 (zigzag 10/10)", "overshoot_1"].verdict == "pass"
    assert found.runs[0].end < found.runs[1].order_time < found.runs[1].end < found.runs[2].order_time


@pytest.mark.parametrize("begins", [-25.0, 3.0])
def test_a_short_or_unrecorded_approach_is_judged_and_told(begins: float) -> None:
    """begins: first sample after the order [s] of a 320 m ship."""
    case = foreign(SHIP, "turning", 1, (35, 0), np.random.default_rng(SEED))
    whole = measured_runs(case.trial, case.length)[0]
    t = case.trial.t - case.trial.t[0]
    cut = Trial("cut", {n: v[t >= whole.order_time + begins] for n, v in case.trial.columns.items()})
    found = imo_figures_of_trials([cut], length=case.length)
    row = next(row for row in found.rows if row.figure == "advance")
    assert row.verdict == "pass" and row.why
    assert row.value == pytest.approx(whole.figures["advance"] / case.length, abs=0.15)


def test_a_record_that_begins_within_the_turn_is_not_judged() -> None:
    case = foreign(SHIP, "turning", 1, (35, 0), np.random.default_rng(SEED))
    whole = measured_runs(case.trial, case.length)[0]
    t = case.trial.t - case.trial.t[0]
    cut = Trial("cut", {n: v[t >= whole.order_time + 100.0] for n, v in case.trial.columns.items()})
    rows = imo_figures_of_trials([cut], length=case.length).rows
    assert {row.verdict for row in rows if row.limit} == {"not judged"}


def test_a_turn_that_never_comes_round_says_what_it_does_not_reach() -> None:
    case = foreign(SHIP, "turning", 1, (35, 0), np.random.default_rng(SEED))
    whole = measured_runs(case.trial, case.length)[0]
    t, turned = case.trial.t - case.trial.t[0], np.abs(case.trial.psi_unwrapped - case.trial.psi_unwrapped[0])
    rows = (turned < math.radians(60)) | (t < whole.order_time)
    cut = Trial("cut", {n: v[rows] for n, v in case.trial.columns.items()})
    found = imo_figures_of_trials([cut], length=case.length)
    assert {row.why for row in found.rows if row.figure == "advance"} == {"the run does not reach it"}
    wander = cut.with_columns(delta=0.02 * np.sin(cut.t / 30))
    with pytest.raises(Missing):
        imo_figures_of_trials([wander], length=case.length)


def test_a_rudder_that_is_logged_off_its_zero_is_told() -> None:
    case = foreign(MODEL, "zigzag", -1, (10, 10), np.random.default_rng(SEED))
    (found,) = find_maneuvers(case.trial.with_columns(delta=case.trial["delta"] + math.radians(2.5)), case.length)
    assert found.title == "zigzag -10/10"


def test_a_zigzag_with_the_rudder_logged_the_wrong_way_round_is_named_and_not_judged() -> None:
    case = foreign(MODEL, "zigzag", 1, (10, 10), np.random.default_rng(SEED))
    found = imo_figures_of_trials([case.trial.with_columns(delta=-case.trial["delta"])], length=3.0, scale=108.0)
    assert found.runs[0].title == "zigzag 10/10"
    assert {row.verdict for row in found.rows if row.limit} == {"not judged"}

"""WaterVelocity from circles and wind by the model: what was added to a run is taken off again."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.file_faults.plant import SETS, Plant, Weather, circle, run, zigzag
from cases.criteria.imo import imo_figures_of_trials
from cases.criteria.standard_runs import measured_runs, simulated_trial
from cases.criteria.trial_correction import current_of
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import UserError
from mmg_ident.commands.main import app
from tests.support.measured_maneuvers import logged

HULL = SETS["161 m cargo, hard, 2 Hz"].hull
UNIT = HULL.length / HULL.speed


def pair(current: tuple[float, float]) -> list[Trial]:
    """A circle and a zigzag of the foreign ship in a current [m/s]."""
    rng, trials = np.random.default_rng(5), []
    plant = Plant(HULL, Weather(current=current), rng)
    for name, order in (("circle", circle(35, 1.0, 5 * UNIT)), ("zigzag", zigzag(10, 1.0, 5 * UNIT))):
        columns = run(plant, order, 40 * UNIT, 1.0, 1.0)
        trials.append(replace(logged(columns | {"n": np.full(len(columns["t"]), 2.0)}, HULL.length, rng), name=name))
    return trials


@pytest.fixture(scope="module")
def drifting() -> list[Trial]:
    return pair((0.5, -0.6))


def test_the_current_of_a_circle_and_the_figures_without_it_are_those_of_still_water(drifting: list[Trial]) -> None:
    found = current_of(measured_runs(drifting[0], HULL.length)[0])
    assert found is not None and (found.north, found.east) == pytest.approx((0.5, -0.6), abs=0.01)
    corrected = imo_figures_of_trials(drifting, length=HULL.length, correct=True)
    for still, row in zip(
        imo_figures_of_trials(pair((0.0, 0.0)), length=HULL.length).rows, corrected.rows, strict=True
    ):
        tolerance = 0.2 if row.unit == "deg" else 0.02
        assert row.value == pytest.approx(still.value, abs=tolerance), row.figure
    advance, diameter = (next(r for r in corrected.rows if r.figure == f) for f in ("advance", "tactical_diameter"))
    assert abs(advance.measured - advance.value) > 0.05 and abs(diameter.measured - diameter.value) > 0.5
    assert "0.78" in " ".join(corrected.notices)


def test_a_circle_that_is_too_short_gives_no_current_and_that_is_said(drifting: list[Trial]) -> None:
    psi = drifting[0].psi_unwrapped
    rows = np.abs(psi - psi[0]) < math.radians(400)
    short = Trial("short", {n: v[rows] for n, v in drifting[0].columns.items()})
    assert current_of(measured_runs(short, HULL.length)[0]) is None
    found = imo_figures_of_trials([short], length=HULL.length, correct=True)
    assert all(row.measured == row.value for row in found.rows)


def test_wind_is_taken_off_by_the_model_and_its_drift_is_not_taken_for_current() -> None:
    ship = load_ship("esso_osaka_3m")

    def turn(wind: str | None) -> Trial:
        plan = parse_maneuver("turning:35", ship, speed=0.4)
        return replace(simulated_trial(ship, replace(plan, duration=1.6 * plan.duration), wind=wind), name="turn")

    still = imo_figures_of_trials([turn(None)], ship).rows
    corrected = imo_figures_of_trials([turn("1.2:40")], ship, correct=True)
    for a, b in zip(still, corrected.rows, strict=True):
        assert b.value == pytest.approx(a.value, abs=0.03) and abs(b.measured - a.value) > 0.1, a.figure


def test_verb_takes_a_current_and_refuses_one_that_is_none(drifting: list[Trial], tmp_path: Path) -> None:
    path = tmp_path / "zigzag.csv"
    write_trial(drifting[1], path)
    towards = math.degrees(math.atan2(-0.6, 0.5)) % 360
    words = ["imo", str(path), "--length", "161", "--current", f"{math.hypot(0.5, 0.6)}:{towards}", "--json"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.exception
    row = json.loads(result.stdout)["rows"][0]
    assert row["figure"] == "initial_turning_track" and abs(row["measured"] - row["value"]) > 0.01
    for text in ("fast", "1", "-1:20", "nan:3"):
        error = CliRunner().invoke(app, ["imo", str(path), "--length", "161", "--current", text]).exception
        assert isinstance(error, UserError) and "SPEED:TOWARDS" in str(error)

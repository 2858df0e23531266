"""Errors in units: by hand over windows, of figures, of large ships, and by run in reports and on the console."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cases.criteria.standard_runs import simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import wrap, write_trial
from cases.trial import Trial
from fitting.prediction.predict import predict
from fitting.prediction.score import (
    Score,
    ScorePair,
    UnitErrors,
    errors_in_units,
    pooled_sigma,
    score,
    ship_time,
    window_for,
)
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.commands.main import app


def recorded(ship: Ship, text: str, speed: float, dt: float) -> Trial:
    plan = parse_maneuver(text, ship, speed=speed)
    return replace(simulated_trial(ship, plan, dt=dt), name=text.replace(":", "_").replace("/", "_"))


@pytest.fixture(scope="module")
def ship() -> Ship:
    return load_ship("esso_osaka_3m")


@pytest.fixture(scope="module")
def trials(ship: Ship) -> list[Trial]:
    return [recorded(ship, text, 0.4, 0.2) for text in ("turning:35", "zigzag:-20/10")]


@pytest.fixture(scope="module")
def other(ship: Ship) -> Simulator:
    """A ship whose rudder is weaker."""
    c = ship.coefficients["a_H"]
    return Simulator(ship.with_values({"a_H": 0.5 * c.value}))


def test_errors_are_those_of_the_windows_by_hand(trials: list[Trial], other: Simulator) -> None:
    found = errors_in_units(other, trials, window=20.0)
    assert found.window_s == 20.0 and found.stride_s == 10.0
    for trial, run in zip(trials, found.runs, strict=True):
        windows, _ = predict(other, trial, 20.0, 10.0, False)
        errors = np.vstack([w.error(trial.states)[1:] for w in windows])
        assert run.windows == len(windows)
        assert run.position_m == pytest.approx(math.sqrt((errors[:, :2] ** 2).sum(axis=1).mean()))
        assert run.heading_deg == pytest.approx(math.degrees(math.sqrt((errors[:, 2] ** 2).mean())))
        assert run.u_m_s == pytest.approx(math.sqrt((errors[:, 3] ** 2).mean()))
        assert run.r_deg_s == pytest.approx(math.degrees(math.sqrt((errors[:, 5] ** 2).mean())))
        last = np.array([w.error(trial.states)[-1] for w in windows])
        assert run.heading_end_deg == pytest.approx(math.degrees(math.sqrt((last[:, 2] ** 2).mean())))
        assert run.share_of_change > 0


def test_the_true_ship_has_no_error_of_figures_and_a_wrong_one_has(
    ship: Ship, trials: list[Trial], other: Simulator
) -> None:
    truth, wrong = errors_in_units(Simulator(ship), trials), errors_in_units(other, trials)
    assert [[m.title for m in run.maneuvers] for run in truth.runs] == [["turning 35"], ["zigzag -20/10"]]
    names = {f.figure for run in truth.runs for m in run.maneuvers for f in m.figures}
    assert {"advance", "tactical_diameter", "overshoot_1", "overshoot_2"} <= names
    for a, b in zip(truth.runs, wrong.runs, strict=True):
        for good, bad in zip(a.maneuvers[0].figures, b.maneuvers[0].figures, strict=True):
            assert abs(good.error) < 0.02 * abs(good.measured) + 0.05, good
            assert good.measured == bad.measured and abs(bad.error) > abs(good.error), bad


def test_windows_of_a_large_ship_are_four_ship_times_and_those_of_a_model_are_of_the_paper(
    trials: list[Trial],
) -> None:
    large = load_ship("kvlcc2_full")
    run = recorded(large, "zigzag:10/10", 7.0, 1.0)
    unit = ship_time([run], 320.0)
    assert 40 < unit < 60 and window_for(trials, 3.0) == 30.0 and window_for([run], None) == 30.0
    assert window_for([run], 320.0) == pytest.approx(4 * unit, abs=5.0)
    found = errors_in_units(Simulator(large), [run])
    assert found.window_s == window_for([run], 320.0) and found.ship_times == pytest.approx(4.0, abs=0.2)


def test_a_heading_that_goes_round_does_not_hide_its_error(ship: Ship) -> None:
    """sigma of a heading stored unwrapped over a turn of 540 deg is several times the change over a window."""
    turn = recorded(ship, "turning:35", 0.4, 0.2)
    unwrapped = turn.with_columns(psi=turn.psi_unwrapped)
    found = errors_in_units(Simulator(ship), [unwrapped])
    assert pooled_sigma([unwrapped])[2] > 1.5 * found.change["psi"]
    wrapped = errors_in_units(Simulator(ship), [turn.with_columns(psi=wrap(turn["psi"]))])
    assert wrapped.change == pytest.approx(found.change)


def test_runs_that_became_worse_are_listed_with_their_errors(ship: Ship, trials: list[Trial], other: Simulator) -> None:
    sigma = pooled_sigma(trials)
    good, bad = (score(model, trials, sigma, units=0.0) for model in (Simulator(ship), other))
    pair = ScorePair(good, bad)
    assert len(pair.worse_runs) == 2 and "position" in pair.worse_runs[0] and " deg" in pair.worse_runs[0]
    (message,) = pair.worse_by_run("validation")
    assert "turning_35" in message
    assert ScorePair(bad, good).worse_by_run("validation") == []


def test_scores_with_and_without_units_are_read_back(ship: Ship, trials: list[Trial]) -> None:
    found = score(Simulator(ship), trials, units=20.0)
    again = Score.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.to_dict() == found.to_dict() and isinstance(again.units, UnitErrors)
    old = {key: value for key, value in found.to_dict().items() if key != "units"}
    assert Score.from_dict(old).units is None


def test_verb_tells_errors_by_run_and_which_model_is_worse(trials: list[Trial], tmp_path: Path) -> None:
    for trial in trials:
        write_trial(trial, tmp_path / f"{trial.name}.csv")
    models = ["esso_osaka_3m", "kvlcc2_l7"]
    told = CliRunner().invoke(app, ["score", *models, str(tmp_path), "--window", "40"])
    assert told.exit_code == 0, told.exception
    assert "40" in told.stdout
    assert "esso_osaka_3m" in told.stdout
    data = json.loads(CliRunner().invoke(app, ["score", *models, str(tmp_path), "--json"]).stdout)
    units = data["models"]["esso_osaka_3m"]["units"]
    assert units["window_s"] == 30.0 and units["runs"][0]["position_m"] < 0.05
    assert units["runs"][0]["maneuvers"][0]["figures"][0]["figure"] == "advance"
    assert len(data["worse"]) == 1

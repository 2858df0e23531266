"""A ship and trials that do not belong together by their actuators: refused by every verb that reads both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mmg_ident as mi
from cases.inputs import assumed, model_inputs
from cases.shipfiles.ship_file import load_ship, parse_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import UserError
from mmg.ship import Ship
from mmg_ident.commands.main import main
from tests.cases.shipfiles.test_new_ship import AZIMUTH

PODS = AZIMUTH.replace("y_az = 0.0", "y_az = 0.1\nx_az_2 = -1.4\ny_az_2 = -0.1")


def screw_trial() -> Trial:
    """A zigzag of the ESSO OSAKA, steered by her rudder."""
    return demo_trials(3, dt=0.5)[0][0]


@pytest.mark.parametrize("verb", ["score", "predict", "fit", "train", "diagnose", "simulate", "imo"])
def test_a_ship_none_of_whose_propulsors_is_in_the_file_is_refused(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ship, file, out = tmp_path / "pods.toml", tmp_path / "run.csv", tmp_path / "out"
    ship.write_text(PODS, encoding="utf-8")
    write_trial(screw_trial(), file)
    judge = tmp_path / "judge.csv"
    write_trial(demo_trials(3, dt=0.5)[1][0], judge)
    words = [str(ship), str(file), "--out", str(out)]
    own = {
        "score": words[:2],
        "simulate": [str(ship), "--controls", str(file), "--out", str(tmp_path / "out.csv")],
        "imo": [str(file), "--ship", str(ship)],
        "select": [*words, "--validate", str(judge)],
    }
    assert main([verb, *own.get(verb, words)]) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert "n_azimuth" in line and "n, delta" in line and not out.exists()


def test_a_run_without_a_window_has_nothing_to_score_and_tables_are_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = screw_trial()
    gaps = np.where(np.arange(len(trial)) % 20 == 7, np.nan, trial["u"])
    write_trial(trial, tmp_path / "whole.csv")
    write_trial(trial.with_columns(u=gaps), tmp_path / "gaps.csv")
    assert main(["score", "esso_osaka_3m", "esso_osaka_3m", *map(str, sorted(tmp_path.glob("*.csv")))]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.split() == ["gaps", "nothing", "to", "score", "0"] for line in lines) == 1
    assert sum(line.split() == ["gaps", "nothing", "to", "score"] for line in lines) == 1
    assert not any("diverges" in line for line in lines)
    tables = [line for line in lines if line and not line.startswith(("note:", "sigma from"))]
    assert max(map(len, tables)) <= 80


PYTHON: dict[str, Callable[[Ship, Trial], object]] = {
    "score": lambda ship, trial: mi.score(ship, [trial]),
    "predict": lambda ship, trial: mi.predict(ship, [trial]),
    "calibrate": lambda ship, trial: mi.calibrate(ship, [trial]),
    "train": lambda ship, trial: mi.train(ship, [trial]),
    "diagnose": lambda ship, trial: mi.diagnose(ship, [trial]),
    "simulate": lambda ship, trial: mi.simulate(ship, trial),
}


@pytest.mark.parametrize("name", list(PYTHON))
def test_a_script_is_refused_too(name: str) -> None:
    with pytest.raises(UserError, match="n_azimuth"):
        PYTHON[name](parse_ship(PODS), screw_trial())


@pytest.mark.parametrize("idle", ["n", "delta"])
def test_a_propeller_or_rudder_that_moves_and_that_nobody_uses_is_refused(idle: str) -> None:
    trial = screw_trial()
    still = {name: np.zeros(len(trial)) for name in ("n", "delta") if name != idle}
    pods = {"n_azimuth": np.full(len(trial), 5.0), "azimuth": np.zeros(len(trial))}
    with pytest.raises(UserError, match=f"{idle} reaches"):
        mi.score(parse_ship(PODS), [trial.with_columns(**still, **pods)])


def test_rudders_that_another_column_stands_for_are_used() -> None:
    twin = ("n", "delta_port", "delta_starboard", "wind_north", "wind_east")
    trial = screw_trial()
    assert {note.code for note in model_inputs(trial, twin).notices} == {"stand_in"}
    own = trial.with_columns(delta_port=trial["delta"], delta_starboard=trial["delta"])
    model_inputs(own, twin)
    assert {note.code for note in model_inputs(own).notices} == {"input_ignored"}


def test_every_function_says_what_a_fit_says_of_the_inputs() -> None:
    ship = load_ship("esso_osaka_3m")
    trial = screw_trial()
    calm = {name: values for name, values in trial.columns.items() if not name.startswith("wind")}
    trial = replace(trial, columns={**calm, "pitch": np.full(len(trial), 0.3)})
    wanted = {note.code for note in assumed([trial], ship.inputs)}
    assert wanted == {"input_ignored", "no_wind"}
    assert wanted <= {getattr(note, "code", "") for note in mi.score(ship, [trial]).notes}
    assert wanted <= {note.code for note in mi.predict(ship, [trial])[0].notes}

"""What goes on from a run folder: ``mmg plan``, ``mmg scale``, and the name by which every command calls a run."""

from __future__ import annotations

import html
import json
import re
import shutil
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import mmg_ident
from cases.shipfiles.ship_file import dump_ship, dump_ship_json, load_ship, parse_ship
from fitting.result import read_fit
from mmg.errors import BadValue
from mmg.ship import CalibrationMark
from mmg_ident.commands.main import app, main
from tests.support.calibrated import FREE, small_result
from tests.support.commands import refusal, shown
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials


# ``mmg plan``: the file that simulate follows, what the plan says, and bad input in one line
@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(small_result().save(tmp_path_factory.mktemp("plan") / "run").folder or "")


@pytest.mark.slow
def test_a_plan_stays_inside_and_simulate_follows_it(run: Path, tmp_path: Path) -> None:
    out, again = tmp_path / "next.csv", tmp_path / "again.csv"
    plan = shown("plan", run, "--area", "60x25", "--time", "60", "--effort", "0.05", "--out", out)
    assert plan["calibration"]["name"] == "run"
    assert plan["mean_log_variance"] < 0 and (tmp_path / "next.png").stat().st_size > 10_000
    assert all(row["std_after"] <= row["std_before"] for row in plan["wanted"].values())
    assert not any("wind" in row["name"] for row in plan["library"])
    table = pd.read_csv(out).rename(columns=lambda name: name.partition(" [")[0])
    assert table["x"].between(0, 60).all() and table["y"].between(0, 25).all()
    assert main(["report", str(run), "--no-imo", "--out", str(tmp_path / "page.html")]) == 0
    assert main(["simulate", str(run), "--controls", str(out), "--out", str(again)]) == 0
    followed = pd.read_csv(again).rename(columns=lambda name: name.partition(" [")[0])
    assert np.abs(followed[["x", "y"]].to_numpy() - table[["x", "y"]].to_numpy()).max() < 1e-6


def test_a_run_without_covariance_is_refused(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    path = tmp_path / "run" / "result.json"
    content = json.loads(path.read_text())
    content["correlation"]["matrix"][0][0] = None
    path.write_text(json.dumps(content))
    refusal("plan", tmp_path / "run", "--area", "60x25", "--time", "60", "--out", tmp_path / "a.csv")


# ``mmg scale``: a run folder that the other verbs take, scaled once or twice, and bad input in one line
@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of a model and of the ship scaled from it."""
    root = tmp_path_factory.mktemp("scale")
    small_result().save(root / "model")
    assert main(["scale", str(root / "model"), "--length", "325", "--out", str(root / "ship")]) == 0
    return root


@pytest.mark.slow
def test_the_folder_says_what_changed_and_what_is_assumed(folder: Path) -> None:
    found = json.loads((folder / "ship" / "result.json").read_text())["scaling"]
    assert found["model"]["ship"] == "esso_osaka_3m" and found["scale"] == pytest.approx(325 / 3)
    rows = {row["symbol"]: row for row in found["coefficients"]}
    assert rows["X_0F"]["changed"] and rows["X_0F"]["model"] < rows["X_0F"]["ship"] < 0
    assert rows["X_0F"]["ship_std"] >= rows["X_0F"]["added_std"] > 0
    assert not rows["Y_v"]["changed"] and rows["Y_v"]["ship_std"] > rows["Y_v"]["model_std"]
    assert found["self_propulsion"]["ship"]["C_Th"] < 0.6 * found["self_propulsion"]["model"]["C_Th"]
    page = html.unescape((folder / "ship" / "report.html").read_text())
    assert all(words in page for words in found["assumptions"])


@pytest.mark.slow
def test_the_folder_is_read_back_and_its_model_with_it_and_exported(folder: Path, tmp_path: Path) -> None:
    assert main(["export", str(folder / "ship"), "--format", "toml", "--out", str(tmp_path / "ship.toml")]) == 0
    ship, model = read_fit(folder / "ship"), read_fit(folder / "model")
    assert ship.model.ship.values == pytest.approx(model.ship.values)
    assert ship.ship.particulars["L"] == pytest.approx(325.0)
    assert {c.value for c in ship.estimates.values()} == {ship.ship.coefficients[s].value for s in ship.estimates}
    assert ship.envelope and model.envelope
    assert ship.envelope["u"] == pytest.approx([v * np.sqrt(325 / 3) for v in model.envelope["u"]])


@pytest.mark.slow
def test_scaling_twice_is_scaling_once(folder: Path, tmp_path: Path) -> None:
    mmg_ident.scale(folder / "model", 30.0).save(tmp_path / "between")
    once, twice = read_fit(folder / "ship"), mmg_ident.scale(tmp_path / "between", 325.0)
    assert twice.ship.values == pytest.approx(once.ship.values, rel=1e-12)
    assert [c.std for c in twice.ship.coefficients.values()] == pytest.approx(
        [c.std for c in once.ship.coefficients.values()]
    )
    assert twice.ship.name == once.ship.name and twice.correlation == once.correlation
    again = mmg_ident.scale(mmg_ident.scale(folder / "model", 30.0), 325.0)
    assert again.ship.values == pytest.approx(once.ship.values, rel=1e-12)


@pytest.mark.slow
def test_the_ship_is_predicted_with_bands(folder: Path) -> None:
    trial = mmg_ident.simulate(folder / "ship", "turning:20", dt=2.0, duration=600.0)
    (found,) = mmg_ident.predict(folder / "ship", trial, window=300.0)
    assert "x_std [m]" in found.to_pandas()


@pytest.mark.slow
def test_a_ship_of_the_library_is_scaled_with_its_priors(tmp_path: Path) -> None:
    found = shown("scale", "kvlcc2_l7", "--length", "320", "--name", "KVLCC2", "--out", tmp_path / "run")
    assert found["ship"] == "KVLCC2" and found["scaling"]["model"]["trials"] == []
    assert found["scaling"]["model"]["status"] == "not calibrated"
    assert set(found["correlation"]["symbols"]) == set(found["coefficients"])


# A ship with a name: every command on a calibration says which one it is, and old files without one are read
FEW = ["--only", ",".join(FREE), "--no-next-trial", "--window", "20"]


def mmg(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, (words, result.exception, result.output)
    return result.output


@pytest.fixture(scope="module")
def named_runs(blank_figures: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trial, a run with a name of its own, and the same without one, which is called after its folder."""
    home = tmp_path_factory.mktemp("named")
    write_trials(home / "trials", coarse_runs()[0][:1])
    mmg("fit", "esso_osaka_3m", home / "trials", *FEW, "--name", "MT Aurora", "--out", home / "a")
    first = read_fit(home / "a")
    assert first.ship.mark is not None
    nameless = replace(first.ship, name="esso_osaka_3m", mark=replace(first.ship.mark, name=""))
    replace(first, ship=nameless).save(home / "second")
    return home


@pytest.mark.slow
def test_a_run_is_called_by_its_name_date_data_and_start(named_runs: Path) -> None:
    named, second = load_ship(named_runs / "a"), load_ship(named_runs / "second")
    assert named.name == "MT Aurora" and second.name == "esso_osaka_3m"
    mark = named.mark
    assert mark is not None and mark.name == "MT Aurora" and mark.start == "esso_osaka_3m"
    assert mark.date in datetime.now(timezone.utc).isoformat() and re.fullmatch("[0-9a-f]{64}", mark.data)
    assert named.title == f"MT Aurora, calibrated {mark.date}, data {mark.data[:8]}, from esso_osaka_3m"
    assert second.mark is not None and (second.mark.name, second.mark.start) == ("second", "esso_osaka_3m")
    assert second.mark.data == mark.data
    result = json.loads((named_runs / "second" / "result.json").read_text())
    assert result["calibration"] == vars(second.mark)
    assert read_fit(named_runs / "second").ship == second


@pytest.mark.slow
def test_every_command_says_which_calibration_it_is(named_runs: Path, tmp_path: Path) -> None:
    run, title, trials = named_runs / "a", load_ship(named_runs / "a").title, named_runs / "trials"
    assert title in mmg("predict", run, trials, "--out", tmp_path / "p")
    assert title in mmg("score", run, trials)
    assert title in json.loads(mmg("score", run, trials, "--json"))["titles"].values()
    assert title in mmg("simulate", run, "--maneuver", "turning:35", "--duration", "60")
    assert title in mmg("simulate", run, "--maneuver", "turning:35", "--scatter", "3")
    page = (run / "report.html").read_text()
    assert "report</h1>" in page and title in page


def test_files_without_a_mark_are_read_and_marks_come_back_whole() -> None:
    ship = load_ship("esso_osaka_3m")
    assert ship.mark is None and ship.title == "esso_osaka_3m" and "[calibration]" not in dump_ship(ship)
    marked = replace(ship, mark=CalibrationMark("first", "2026-11-23", "1a2b" * 16, "esso_osaka_3m"))
    assert parse_ship(dump_ship(marked)) == marked
    assert json.loads(dump_ship_json(marked))["calibration"]["name"] == "first"
    with pytest.raises(BadValue):
        CalibrationMark("a/b")

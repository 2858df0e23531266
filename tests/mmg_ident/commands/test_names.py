"""A ship with a name: every command on a calibration says which one it is, and old files without one are read."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.shipfiles.ship_json import dump_ship_json
from fitting.result import read_fit
from mmg.errors import BadValue
from mmg.ship import CalibrationMark
from mmg_ident.commands.main import app
from tests.support.calibrated import FREE
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials

pytestmark = pytest.mark.usefixtures("blank_figures")

FEW = ["--only", ",".join(FREE), "--no-next-trial", "--window", "20"]


def mmg(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, (words, result.exception, result.output)
    return result.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
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
def test_a_run_is_called_by_its_name_date_data_and_start(folder: Path) -> None:
    named, second = load_ship(folder / "a"), load_ship(folder / "second")
    assert named.name == "MT Aurora" and second.name == "esso_osaka_3m"
    mark = named.mark
    assert mark is not None and mark.name == "MT Aurora" and mark.start == "esso_osaka_3m"
    assert mark.date in datetime.now(timezone.utc).isoformat() and re.fullmatch("[0-9a-f]{64}", mark.data)
    assert named.title == f"MT Aurora, calibrated {mark.date}, data {mark.data[:8]}, from esso_osaka_3m"
    assert second.mark is not None and (second.mark.name, second.mark.start) == ("second", "esso_osaka_3m")
    assert second.mark.data == mark.data
    result = json.loads((folder / "second" / "result.json").read_text())
    assert result["calibration"] == vars(second.mark)
    assert read_fit(folder / "second").ship == second


@pytest.mark.slow
def test_every_command_says_which_calibration_it_is(folder: Path, tmp_path: Path) -> None:
    run, title, trials = folder / "a", load_ship(folder / "a").title, folder / "trials"
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

"""Whether the past of a window is used: by default where that paid on trials held out, which is said."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate, write_trial
from cases.trial import Trial
from fitting.prediction.score import adaptation_worth, past_to_use
from mmg.rollout import Simulator
from mmg_ident.commands.main import main
from tests.support.calibrated import small_result
from tests.support.figures import unrendered

PAID = {
    "past_s": 30.0, "trials": "left out", "files": 4, "worthwhile": True,
    "without": {"window": 1.0, "paper": 1.0}, "with": {"window": 0.8, "paper": 0.9},
}  # fmt: skip
POOR = {**PAID, "worthwhile": False}


@cache
def runs(current: bool) -> tuple[Trial, ...]:
    """Runs of the hidden ship, each in a current of its own or in still water."""
    found = []
    for number, (north, east) in enumerate(((0.04, 0.0), (0.0, -0.05), (-0.03, 0.03))):
        ship = hidden_ship().with_effect("current", {"x": north, "y": east}) if current else hidden_ship()
        trial = simulate(ship, parse_maneuver(f"random:{number}", ship, n=10.0, duration=120.0), dt=0.5)
        found.append(add_noise(trial, SensorNoise.for_length(3.0), number))
    return tuple(found)


def test_it_pays_where_runs_differ_and_not_where_they_do_not() -> None:
    simulator = Simulator(hidden_ship())
    pays, not_needed = (adaptation_worth(simulator, runs(current)) for current in (True, False))
    assert pays and not_needed
    assert pays["worthwhile"] and pays["with"]["window"] < 0.9 * pays["without"]["window"]
    assert not not_needed["worthwhile"]
    assert pays["trials"] == "validation" and pays["past_s"] == 30


def test_trials_that_were_left_out_are_predicted_by_their_own_coefficients() -> None:
    simulator, trials = Simulator(hidden_ship()), runs(True)
    own = np.tile(np.asarray(hidden_ship().values), (len(trials), 1))
    same = adaptation_worth(simulator, trials, np.where(np.arange(len(trials))[:, None] == 1, np.nan, own))
    plain = adaptation_worth(simulator, trials)
    assert same and plain and same["trials"] == "left out"
    assert same["without"]["window"] == pytest.approx(plain["without"]["window"], rel=1e-9)
    own[:, hidden_ship().symbols.index("N_r")] *= 0.5
    worse = adaptation_worth(simulator, trials, own)
    assert worse and worse["without"]["window"] > 1.1 * plain["without"]["window"]


@pytest.mark.parametrize(
    ("result", "wanted", "seconds", "code"),
    [
        ({"adaptation": PAID}, None, 30, "adaptation_on"),
        ({"adaptation": POOR}, None, 0, "adaptation_off"),
        ({"bands": {}}, None, 0, "adaptation_untested"),
        ({"adaptation": None}, None, 0, "adaptation_untested"),
        ({"adaptation": {"worthwhile": True}}, None, 0, "adaptation_untested"),
        ({"adaptation": 3}, None, 0, "adaptation_untested"),
        ({}, None, 0, ""),
        ({"model": "fnn"}, None, 0, ""),
        ({"adaptation": PAID}, 0.0, 0, ""),
        ({"adaptation": PAID}, 12.0, 12, ""),
        ({"adaptation": POOR}, 12.0, 12, "adaptation_does_not_pay"),
        ({}, 12.0, 12, "adaptation_untested"),
    ],
)
def test_by_default_a_run_does_what_it_knows_and_else_what_the_user_wants(
    result: dict, wanted: float | None, seconds: float, code: str
) -> None:
    used, notes = past_to_use(result, wanted)
    assert used == seconds and [note.code for note in notes] == [code] * bool(code)
    assert ("--adapt 0" in "".join(notes)) == (code == "adaptation_on")


@pytest.mark.slow
def test_predict_and_score_follow_the_run_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, file = tmp_path / "run", tmp_path / "trial.csv"
    with unrendered():
        small_result(3).save(folder)
    (folder / "ship.toml").write_text(dump_ship(hidden_ship(), ""), encoding="utf-8")
    write_trial(runs(True)[0], file)
    content = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    tables, said = {}, {}
    for name, known, more in (("on", PAID, []), ("off", PAID, ["--adapt", "0"]), ("old", None, [])):
        (folder / "result.json").write_text(json.dumps(content | {"adaptation": known}), encoding="utf-8")
        out = tmp_path / f"{name}.csv"
        common = ["--window", "30", "--stride", "15", "--out", str(out), *more]
        assert main(["predict", str(folder), str(file), *common, "--json"]) == 0
        tables[name], said[name] = out.read_text(), json.loads(capsys.readouterr().out)["notes"]
    assert tables["on"] != tables["off"] == tables["old"]
    assert any("--adapt 0" in note for note in said["on"]) and not any("past" in note for note in said["off"])
    (folder / "result.json").write_text(json.dumps(content | {"adaptation": PAID}), encoding="utf-8")
    assert main(["score", str(folder), str(file), "--json"]) == 0
    both = json.loads(capsys.readouterr().out)["models"]
    assert list(both) == [str(folder), f"{folder} --adapt 30"]
    assert both[f"{folder} --adapt 30"]["window"] < both[str(folder)]["window"]
    assert main(["score", str(folder), str(file), "--json", "--adapt", "0"]) == 0
    assert len(json.loads(capsys.readouterr().out)["models"]) == 1

"""The verbs ``simulate`` and ``ships``: what they print and write, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from cases.io.read import read_trial
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from mmg.errors import UserError
from mmg_ident.commands.ships import ships
from mmg_ident.commands.simulate import simulate

APP = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)
APP.command("simulate")(simulate)
APP.command("ships")(ships)
ESSO = ["simulate", "esso_osaka_3m"]


def mmg(*arguments: str | Path) -> Result:
    return CliRunner().invoke(APP, [str(a) for a in arguments])


def test_turning_prints_advance_and_tactical_diameter_in_ship_lengths() -> None:
    result = mmg(*ESSO, "--maneuver", "turning:35")
    assert result.exit_code == 0
    for words in ("advance", "transfer", "tactical diameter", " L\n"):
        assert words in result.stdout
    figures = json.loads(mmg(*ESSO, "--maneuver", "turning:35", "--json").stdout)["figures"]
    assert 3.0 < figures["advance_L"] < 4.0 and 3.5 < figures["tactical_diameter_L"] < 4.5
    assert figures["advance_L"] == pytest.approx(figures["advance_m"] / 3.0)


def test_zigzag_prints_overshoots_and_other_runs_no_figures() -> None:
    figures = json.loads(mmg(*ESSO, "--maneuver", "zigzag:20/20", "--json").stdout)["figures"]
    assert [name for name in figures if "overshoot" in name] == [f"overshoot_{k}_rad" for k in range(1, 5)]
    assert 0.05 < figures["overshoot_1_rad"] < 0.2
    assert json.loads(mmg(*ESSO, "--maneuver", "straight", "--json").stdout)["figures"] == {}


def test_written_trial_is_read_back_and_followed_by_controls(tmp_path: Path) -> None:
    path, again = tmp_path / "zigzag.csv", tmp_path / "again.parquet"
    made = mmg(*ESSO, "--maneuver", "zigzag:10/10", "--wind", "1:45:gusty", "--duration", "60", "--out", path)
    assert made.exit_code == 0 and made.stdout == ""
    trial = read_trial(path)
    assert trial.duration == pytest.approx(60) and trial.has_wind
    assert mmg(*ESSO, "--controls", path, "--out", again).exit_code == 0
    np.testing.assert_allclose(read_trial(again).states, trial.states, atol=1e-9)


def test_noise_is_added_to_the_file_and_follows_the_seed(tmp_path: Path) -> None:
    runs = []
    for name, options in (
        ("a", ["--noise"]),
        ("b", ["--noise"]),
        ("c", []),
        ("d", ["--noise", "--seed", "5"]),
    ):
        assert mmg(*ESSO, "--maneuver", "straight", *options, "--out", tmp_path / f"{name}.csv").exit_code == 0
        runs.append(read_trial(tmp_path / f"{name}.csv"))
    np.testing.assert_array_equal(runs[0]["u"], runs[1]["u"])
    assert (runs[0]["u"] != runs[3]["u"]).all()
    assert np.std(runs[0]["u"] - runs[2]["u"]) == pytest.approx(0.004, rel=0.1)


def test_controls_with_time_propeller_and_rudder_alone_start_from_rest(tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text("t [s],n [rpm],delta [deg]\n0,600,0\n20,600,\n40,600,10\n60,600,10\n")
    result = mmg(*ESSO, "--controls", path, "--json")
    assert result.exit_code == 0, result.exception
    data = json.loads(result.stdout)
    assert data["start"]["u_m_s"] == 0 and data["start"]["n_rps"] == 10 and data["final"]["u_m_s"] > 0.1
    assert data["final"]["psi_rad"] > 0
    assert any("rest" in notice for notice in data["notices"]) and any("hold" in n for n in data["notices"])


def test_inputs_that_the_model_does_not_have_are_said_to_be_ignored(tmp_path: Path) -> None:
    file = tmp_path / "inputs.csv"
    file.write_text("t [s],n [rps],delta [rad]\n0,1.2,0.1\n1,1.2,0.1\n")
    for ship, count in (("mariner", 1), ("vectwin_3m", 0), ("esso_osaka_3m", 0)):
        told = json.loads(mmg("simulate", ship, "--controls", str(file), "--json").stdout)["notices"]
        assert sum(notice.startswith("inputs: n: ") for notice in told) == count


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "either"),
        (["--maneuver", "straight", "--controls", "a.csv"], "either"),
        (["--maneuver", "pirouette"], "unknown manoeuvre"),
        (["--maneuver", "zigzag:20"], "rudder/heading"),
        (["--maneuver", "straight", "--wind", "gale"], "speed:direction"),
        (["--maneuver", "straight", "--wind", "500:10"], "500 m/s"),
        (["--maneuver", "turning:35", "--rudder-rate", "-1"], "= -1 deg/s"),
        (["--maneuver", "straight", "--effect", "current:x=0.01,x=0.02"], "x"),
        (["--maneuver", "straight", "--dt", "0"], "dt"),
        (["--maneuver", "straight", "--duration", "-5"], "duration"),
        (["--maneuver", "straight", "--seed", "-1"], "seed"),
        (["--maneuver", "straight", "--out", "run.xlsx"], ".csv"),
        (["--maneuver", "straight", "--out", "missing_folder/run.csv"], "folder"),
        (["--controls", "missing.csv"], "missing.csv"),
        (["--controls", "words.csv"], "not a number"),
        (["--controls", "nothing.csv"], "missing column"),
        (["--controls", "backwards.csv"], "row 2"),
        (["--controls", "inputs.csv", "--speed", "1"], "--speed"),
        (["--maneuver", "straight", "--out", "inputs.csv"], "exists"),
    ],
)
def test_bad_input_is_one_clear_line(
    options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("inputs.csv").write_text("t [s],n [rps],delta [rad]\n0,10,0\n1,10,0\n")
    Path("words.csv").write_text("t [s],n [rps],delta [rad]\n0,10,0\n1,full ahead,0\n")
    Path("nothing.csv").write_text("t [s],speed [kn]\n0,10\n1,10\n")
    Path("backwards.csv").write_text("t [s],n [rps],delta [rad]\n1,10,0\n0,10,0\n")
    before = sorted(Path().iterdir())
    result = mmg(*ESSO, *options)
    assert isinstance(result.exception, UserError), result.exception
    assert words in str(result.exception) and "\n" not in str(result.exception)
    assert sorted(Path().iterdir()) == before


def test_force_replaces_an_existing_file(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("old")
    assert mmg(*ESSO, "--maneuver", "straight", "--duration", "5", "--out", path, "--force").exit_code == 0
    assert len(read_trial(path)) == 51


def test_ships_lists_the_library_and_prints_a_ship_that_parses_to_itself() -> None:
    assert "esso_osaka_3m" in mmg("ships").stdout
    assert json.loads(mmg("ships", "--json").stdout)["ships"][0]["L"] > 0
    text = mmg("ships", "esso_osaka_3m").stdout
    assert text == dump_ship(load_ship("esso_osaka_3m"))
    assert dict(parse_ship(text).coefficients) == dict(load_ship("esso_osaka_3m").coefficients)
    assert "C_D" in json.loads(mmg("ships", "esso_osaka_3m", "--json").stdout)["coefficients"]
    assert isinstance(mmg("ships", "titanic").exception, UserError)


def test_scatter_prints_median_and_interval_of_each_figure_and_writes_the_motions(tmp_path: Path) -> None:
    out = tmp_path / "tracks.csv"
    options = [*ESSO, "--maneuver", "zigzag:20/20", "--scatter", "8", "--seed", "2"]
    shown = mmg(*options, "--out", out)
    assert shown.exit_code == 0 and "overshoot 1 [deg]" in shown.stdout and "90 % interval" in shown.stdout
    assert out.read_text().splitlines()[0].startswith("run,t [s],x [m],y [m],psi [rad]")
    data = json.loads(mmg(*options, "--json").stdout)
    assert data["scatter"] == 8
    assert {"figure", "unit", "value", "median", "interval_90", "share"} <= set(data["figures"][0])
    assert isinstance(mmg(*options, "--noise").exception, UserError)


def test_a_run_is_logged_by_the_instruments_of_its_campaign(tmp_path: Path) -> None:
    """The turn rate is as late against the heading as that campaign's gyro is; without a name, as the mean of all."""
    ship = with_effects(load_ship("esso_osaka_3m"), ["gyro:T=0.4"])
    ship = parse_ship(
        dump_ship(ship) + '\n[campaigns."spring"]\n"gyro.T" = 0.0\n[campaigns."autumn"]\n"gyro.T" = 0.9\n'
    )
    (tmp_path / "ship.toml").write_text(dump_ship(ship), encoding="utf-8")
    for name, lag in (("spring", 0.0), ("autumn", 0.9), ("", 0.4)):
        path = tmp_path / f"{name or 'mean'}.csv"
        chosen = ["--campaign", name] if name else []
        words = ["simulate", tmp_path / "ship.toml", "--maneuver", "zigzag:20/20", "--duration", "60", *chosen]
        assert mmg(*words, "--out", path).exit_code == 0
        trial = read_trial(path)
        rate = np.gradient(np.unwrap(trial["psi"]), trial.t)
        tried = np.arange(0.0, 1.5, 0.05)
        off = [np.std((trial["r"] - np.interp(trial.t - T, trial.t, rate))[20:]) for T in tried]
        assert tried[int(np.argmin(off))] == pytest.approx(lag, abs=0.06)
    with pytest.raises(UserError, match=r"--campaign summer.*spring, autumn"):
        CliRunner().invoke(APP, [*map(str, words[:4]), "--campaign", "summer"], catch_exceptions=False)

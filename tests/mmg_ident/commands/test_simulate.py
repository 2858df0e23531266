"""The verbs ``simulate`` and ``ships``: what they print and write, and what they refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.io.read import read_trial
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from mmg_ident.commands.main import main
from tests.support.commands import refusal, shown

ESSO = ["simulate", "esso_osaka_3m"]


def mmg(*arguments: str | Path) -> None:
    assert main([str(a) for a in arguments]) == 0


def test_turning_prints_advance_and_tactical_diameter_in_ship_lengths(capsys: pytest.CaptureFixture[str]) -> None:
    mmg(*ESSO, "--maneuver", "turning:35")
    out = capsys.readouterr().out
    for words in ("advance", "transfer", "tactical diameter", " L\n"):
        assert words in out
    figures = shown(*ESSO, "--maneuver", "turning:35")["figures"]
    assert 3.0 < figures["advance_L"] < 4.0 and 3.5 < figures["tactical_diameter_L"] < 4.5
    assert figures["advance_L"] == pytest.approx(figures["advance_m"] / 3.0)


def test_zigzag_prints_overshoots_and_other_runs_no_figures() -> None:
    figures = shown(*ESSO, "--maneuver", "zigzag:20/20")["figures"]
    assert [name for name in figures if "overshoot" in name] == [f"overshoot_{k}_rad" for k in range(1, 5)]
    assert 0.05 < figures["overshoot_1_rad"] < 0.2
    assert shown(*ESSO, "--maneuver", "straight")["figures"] == {}


def test_written_trial_is_read_back_and_followed_by_controls_into_a_file_that_is_replaced(tmp_path: Path) -> None:
    path, again = tmp_path / "zigzag.csv", tmp_path / "again.parquet"
    mmg(*ESSO, "--maneuver", "zigzag:10/10", "--wind", "1:45:gusty", "--duration", "60", "--out", path)
    trial = read_trial(path)
    assert trial.duration == pytest.approx(60) and trial.has_wind
    again.write_text("old")
    mmg(*ESSO, "--controls", path, "--out", again, "--force")
    np.testing.assert_allclose(read_trial(again).states, trial.states, atol=1e-9)


def test_noise_is_added_to_the_file_and_follows_the_seed(tmp_path: Path) -> None:
    runs = []
    for name, options in enumerate((["--noise"], ["--noise"], [], ["--noise", "--seed", "5"])):
        mmg(*ESSO, "--maneuver", "straight", *options, "--out", tmp_path / f"{name}.csv")
        runs.append(read_trial(tmp_path / f"{name}.csv"))
    np.testing.assert_array_equal(runs[0]["u"], runs[1]["u"])
    assert (runs[0]["u"] != runs[3]["u"]).all()
    assert np.std(runs[0]["u"] - runs[2]["u"]) == pytest.approx(0.004, rel=0.1)


def test_controls_with_time_propeller_and_rudder_alone_start_from_rest(tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text("t [s],n [rpm],delta [deg]\n0,600,0\n20,600,\n40,600,10\n60,600,10\n")
    data = shown(*ESSO, "--controls", path)
    assert data["start"]["u_m_s"] == 0 and data["start"]["n_rps"] == 10 and data["final"]["u_m_s"] > 0.1
    assert data["final"]["psi_rad"] > 0
    assert any("rest" in notice for notice in data["notices"]) and any("hold" in n for n in data["notices"])


def test_inputs_that_the_model_does_not_have_are_said_to_be_ignored(tmp_path: Path) -> None:
    file = tmp_path / "inputs.csv"
    file.write_text("t [s],n [rps],delta [rad]\n0,1.2,0.1\n1,1.2,0.1\n")
    for ship, count in (("mariner", 1), ("vectwin_3m", 0), ("esso_osaka_3m", 0)):
        told = shown("simulate", ship, "--controls", str(file))["notices"]
        assert sum(notice.startswith("inputs: n: ") for notice in told) == count


def test_ships_lists_the_library_and_prints_a_ship_that_parses_to_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert shown("ships")["ships"][0]["L"] > 0
    mmg("ships", "esso_osaka_3m")
    text = capsys.readouterr().out
    assert text == dump_ship(load_ship("esso_osaka_3m"))
    assert dict(parse_ship(text).coefficients) == dict(load_ship("esso_osaka_3m").coefficients)
    assert "C_D" in shown("ships", "esso_osaka_3m")["coefficients"]


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
        mmg(*words, "--out", path)
        trial = read_trial(path)
        rate = np.gradient(np.unwrap(trial["psi"]), trial.t)
        tried = np.arange(0.0, 1.5, 0.05)
        off = [np.std((trial["r"] - np.interp(trial.t - T, trial.t, rate))[20:]) for T in tried]
        assert tried[int(np.argmin(off))] == pytest.approx(lag, abs=0.06)
    line = refusal(*words[:4], "--campaign", "summer")
    assert all(name in line for name in ("--campaign summer", "spring", "autumn"))


# ``mmg select``: lists, terms and ship files of generated models; bad input in one line
def test_the_list_has_the_counts_of_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    rows = {row["name"]: row for row in shown("select", "vectwin_3m", "--list")["candidates"]}
    counts = {name: rows[name]["unknowns"] for name in rows if name.startswith(("sm2", "sm3", "sm4"))}
    wanted = {"sm2-order2": 133, "sm3-order2": 193, "sm4-order2": 253, "sm2-order3": 413, "sm3-order3": 613}
    assert wanted.items() <= counts.items()
    assert rows["mmg"]["unknowns"] == len(load_ship("vectwin_3m").free)
    mmg("select", "vectwin_3m", "--list", "--order", "2")
    text = capsys.readouterr().out
    assert "sm2-order2" in text and "order3" not in text


def test_terms_are_printed_with_their_monomials(capsys: pytest.CaptureFixture[str]) -> None:
    mmg("select", "esso_osaka_3m", "--terms", "quadrants-order1")
    assert "X: 12 terms" in capsys.readouterr().out
    found = shown("select", "esso_osaka_3m", "--terms", "quadrants-order1")
    assert len(found["terms"]) == 36 and found["unknowns"] == 49


def test_a_candidate_is_written_as_a_ship_file_that_is_read(tmp_path: Path) -> None:
    out = tmp_path / "hybrid.toml"
    words = ["select", "kvlcc2_full", "--write", "sm2-order2", "--out", str(out)]
    mmg(*words)
    ship = load_ship(out)
    assert ship.components == {"expansion": "smooth_submodels"} and len(ship.monomials) == 74
    assert main(words) == 2
    mmg(*words, "--hard", "--force")
    assert load_ship(out).components == {"expansion": "hard_submodels"}

"""The verbs ``simulate`` and ``ships``: what they print and write, and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.io.read import read_trial
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from mmg_ident.commands.main import main
from tests.support.commands import printed, refusal, shown

ESSO = ["simulate", "esso_osaka_3m"]


def mmg(*arguments: str | Path) -> None:
    assert main([str(a) for a in arguments]) == 0


def test_figures_are_those_of_the_manoeuvre_and_printed_in_ship_lengths() -> None:
    out = printed(*ESSO, "--maneuver", "turning:35")
    assert all(words in out for words in ("advance", "transfer", "tactical diameter", " L\n"))
    figures = shown(*ESSO, "--maneuver", "turning:35")["figures"]
    assert 3.0 < figures["advance_L"] < 4.0 and 3.5 < figures["tactical_diameter_L"] < 4.5
    assert figures["advance_L"] == pytest.approx(figures["advance_m"] / 3.0)
    figures = shown(*ESSO, "--maneuver", "zigzag:20/20")["figures"]
    assert [name for name in figures if "overshoot" in name] == [f"overshoot_{k}_rad" for k in range(1, 5)]
    assert 0.05 < figures["overshoot_1_rad"] < 0.2 and shown(*ESSO, "--maneuver", "straight")["figures"] == {}


def test_written_trial_is_read_back_and_followed_by_controls_into_a_file_that_is_replaced(tmp_path: Path) -> None:
    path, again = tmp_path / "zigzag.csv", tmp_path / "again.parquet"
    mmg(*ESSO, "--maneuver", "zigzag:10/10", "--wind", "1:45:gusty", "--duration", "60", "--out", path)
    trial = read_trial(path)
    assert trial.duration == pytest.approx(60) and trial.has_wind
    again.write_text("old")
    mmg(*ESSO, "--controls", path, "--out", again, "--force")
    np.testing.assert_allclose(read_trial(again).states, trial.states, atol=1e-9)


def test_controls_with_time_propeller_and_rudder_alone_start_from_rest(tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text("t [s],n [rpm],delta [deg]\n0,600,0\n20,600,\n40,600,10\n60,600,10\n")
    data = shown(*ESSO, "--controls", path)
    assert data["start"]["u_m_s"] == 0 and data["start"]["n_rps"] == 10 and data["final"]["u_m_s"] > 0.1
    assert data["final"]["psi_rad"] > 0
    assert any("rest" in notice for notice in data["notices"]) and any("hold" in n for n in data["notices"])


def test_ships_lists_the_library_and_prints_a_ship_that_parses_to_itself() -> None:
    assert shown("ships")["ships"][0]["L"] > 0
    text = printed("ships", "esso_osaka_3m")
    assert text == dump_ship(load_ship("esso_osaka_3m"))
    assert dict(parse_ship(text).coefficients) == dict(load_ship("esso_osaka_3m").coefficients)
    assert "C_D" in shown("ships", "esso_osaka_3m")["coefficients"]


def test_a_run_is_logged_by_the_instruments_of_its_campaign(tmp_path: Path) -> None:
    """The turn rate is as late against the heading as that campaign's gyro is; without a name, as the mean of all."""
    ship = replace(load_ship("esso_osaka_3m").with_effect("gyro", {"T": 0.4}), campaigns={"spring": {"gyro.T": 0.0}})
    (tmp_path / "ship.toml").write_text(dump_ship(ship), encoding="utf-8")
    words: list[str | Path] = ["simulate", tmp_path / "ship.toml", "--maneuver", "zigzag:20/20", "--duration", "60"]
    for lag, chosen in ((0.0, ["--campaign", "spring"]), (0.4, [])):
        mmg(*words, *chosen, "--out", tmp_path / f"{lag}.csv")
        trial = read_trial(tmp_path / f"{lag}.csv")
        rate, tried = np.gradient(np.unwrap(trial["psi"]), trial.t), np.arange(0.0, 1.5, 0.05)
        off = [np.std((trial["r"] - np.interp(trial.t - T, trial.t, rate))[20:]) for T in tried]
        assert tried[int(np.argmin(off))] == pytest.approx(lag, abs=0.06)
    line = refusal(*words, "--campaign", "summer")
    assert all(name in line for name in ("--campaign summer", "spring"))


# ``mmg select``: lists, terms and ship files of generated models; bad input in one line
def test_the_list_has_the_counts_of_the_paper_and_terms_their_monomials() -> None:
    rows = {row["name"]: row for row in shown("select", "vectwin_3m", "--list")["candidates"]}
    counts = {name: rows[name]["unknowns"] for name in rows if name.startswith(("sm2", "sm3", "sm4"))}
    wanted = {"sm2-order2": 133, "sm3-order2": 193, "sm4-order2": 253, "sm2-order3": 413, "sm3-order3": 613}
    assert wanted.items() <= counts.items()
    assert rows["mmg"]["unknowns"] == len(load_ship("vectwin_3m").free)
    text = printed("select", "vectwin_3m", "--list", "--order", "2")
    assert "sm2-order2" in text and "order3" not in text
    terms = ("select", "esso_osaka_3m", "--terms", "quadrants-order1")
    assert "X: 12 terms" in printed(*terms)
    found = shown(*terms)
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

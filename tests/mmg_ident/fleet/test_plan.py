"""Plans of fleets: all that is wrong is said at once, and what they list is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from mmg.errors import BadValue, UserError
from mmg_ident.commands.main import main
from mmg_ident.fleet.plan import read_plan
from tests.support.small_fleets import write_plan

ROWS = "t [s],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n0,0,1,0,0,1,{0}\n1,0,1,0,0,1,{0}\n"


def file(path: Path, number: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(ROWS.format(number), encoding="utf-8")


def test_ships_and_files_that_do_not_exist_are_named_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file(tmp_path / "a.csv", 0)
    ships = {
        "anna": 'ship = "no_such_ship"\ntrials = ["a.csv", "gone.csv"]',
        "berta": 'ship = "esso_osaka_3m"\ntrials = ["none/*.csv"]\nheld_out = ["away"]',
        "clara": 'trials = ["a.csv"]\ntrails = ["b.csv"]',
    }
    plan = write_plan(tmp_path, ships, tail='[sisters]\nsome = ["anna", "dora"]')
    assert main(["fleet", str(plan), "--out", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line and not (tmp_path / "out").exists()
    for words in ("no_such_ship", "gone.csv", "none/*.csv", "away", "dora", "trails", "ships.clara] give ship"):
        assert words in line
    assert "7 problems" in line


def test_a_file_of_two_ships_or_two_lists_is_refused(tmp_path: Path) -> None:
    for number, name in enumerate(("a", "b", "c")):
        file(tmp_path / f"{name}.csv", number)
    (tmp_path / "copy.csv").write_bytes((tmp_path / "b.csv").read_bytes())
    ships = {
        "anna": 'ship = "esso_osaka_3m"\ntrials = ["a.csv", "c.csv"]\nheld_out = ["c.csv"]',
        "berta": 'ship = "esso_osaka_3m"\ntrials = ["a.csv", "b.csv"]',
        "clara": 'ship = "esso_osaka_3m"\ntrials = ["copy.csv"]',
    }
    with pytest.raises(BadValue) as error:
        read_plan(write_plan(tmp_path, ships))
    for words in ("c.csv", "a.csv of berta", "copy.csv of clara", "b.csv of berta"):
        assert words in str(error.value)


def test_names_that_would_be_one_folder_and_sisters_of_other_models_are_refused(tmp_path: Path) -> None:
    for number in range(3):
        file(tmp_path / f"{number}.csv", number)
    ships = {
        "anna": 'ship = "esso_osaka_3m"\ntrials = ["0.csv"]',
        "Anna": 'ship = "esso_osaka_3m"\ntrials = ["1.csv"]',
        "berta": 'ship = "kvlcc2_l7"\ntrials = ["2.csv"]',
    }
    with pytest.raises(BadValue):
        read_plan(write_plan(tmp_path, ships, tail='[sisters]\nsome = ["anna", "berta"]'))


def test_a_plan_lists_campaigns_patterns_and_particulars(tmp_path: Path) -> None:
    for number, name in enumerate(("x/1", "x/2", "y/3", "z/4")):
        file(tmp_path / f"{name}.csv", number)
    ships = {
        "anna": 'ship = "esso_osaka_3m"\nheld_out = ["z"]\n[ships.anna.campaigns]\nold = ["x"]\nnew = ["y/*.csv"]',
        "berta": "particulars = { L = 161, B = 23.2, d = 7.5, C_b = 0.59 }\ntrials = []\n"
        '[ships.berta.campaigns]\none = ["../elsewhere/*.csv"]',
    }
    elsewhere = tmp_path.parent / "elsewhere"
    file(elsewhere / "5.csv", 5)
    plan = read_plan(write_plan(tmp_path, ships))
    anna, berta = plan.ships
    assert list(anna.trials.values()) == ["old", "old", "new"] and [p.name for p in anna.held_out] == ["4.csv"]
    assert berta.start.particulars["L"] == 161 and [p.name for p in berta.trials] == ["5.csv"]
    assert not plan.options.diagnose


def test_an_empty_plan_says_what_to_write(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text("", encoding="utf-8")
    with pytest.raises(UserError, match=r"\[ships\]"):
        read_plan(plan)

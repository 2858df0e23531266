"""mmg fleet from plan to page: sisters, a ship that fails, resumed runs, executors that give the same."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from diagnosis.findings import Between, GroupDifference, GroupParameter, GroupValue
from mmg.errors import BadValue, UserError
from mmg_ident import load_ship
from mmg_ident.commands.main import main
from mmg_ident.fleets import run as fleet_run
from mmg_ident.fleets.plan import read_plan
from mmg_ident.fleets.rows import one_of_several
from mmg_ident.fleets.run import fit_alone
from tests.support.commands import refusal, shown
from tests.support.small_fleets import sister_of, small_ship, write_plan, write_runs, write_start

pytestmark = pytest.mark.usefixtures("blank_figures")

SISTERS = {"anna": 0.0, "berta": 1.0}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sisters with a held-out run each, and a ship whose trials cannot be read."""
    folder = tmp_path_factory.mktemp("fleet")
    write_start(folder)
    for number, (name, size) in enumerate(SISTERS.items()):
        write_runs(sister_of(small_ship(), {"Y_v": size}), folder / name, seed=number)
    (folder / "bad.csv").write_text("t [s],u [m/s]\n0,x\n", encoding="utf-8")
    ships = {n: f'ship = "start.toml"\ntrials = ["{n}/[0-1]_*.csv"]\nheld_out = ["{n}/2_*.csv"]' for n in SISTERS}
    ships["dora"] = 'ship = "start.toml"\ntrials = ["bad.csv"]'
    return write_plan(folder, ships, tail='[sisters]\nbarges = ["anna", "berta"]')


def fleet(plan: Path, out: Path, *more: str) -> int:
    return main(["fleet", str(plan), "--out", str(out), *more])


@pytest.fixture(scope="module")
def out(plan: Path) -> Path:
    folder = plan.parent / "out"
    assert fleet(plan, folder) == 1  # one ship fails
    return folder


def same(one: Path, other: Path) -> None:
    """Tables and coefficients of the ships hold the same values, bit for bit."""
    tables = (pd.read_parquet(out / "fleet.parquet") for out in (one, other))
    pd.testing.assert_frame_equal(*tables, check_exact=True)
    for name in SISTERS:
        assert load_ship(one / "ships" / name).values.tolist() == load_ship(other / "ships" / name).values.tolist()


@pytest.mark.slow
def test_a_ship_that_fails_is_said_and_the_others_are_done(out: Path) -> None:
    table = pd.read_parquet(out / "fleet.parquet")
    assert list(table["status"]) == ["done", "done", "failed"]
    assert "bad.csv" in table.loc["dora", "reason"]
    page = (out / "fleet.html").read_text(encoding="utf-8")
    assert "bad.csv" in page and "http" not in page.replace("http-equiv", "")
    content = json.loads((out / "fleet.json").read_text())
    assert content["failed"] == ["dora"] and set(content["sisters"]["barges"]["coefficients"]) >= {"Y_v", "N_r"}


@pytest.mark.slow
def test_each_ship_is_a_run_folder_that_other_commands_read(out: Path, plan: Path) -> None:
    run = out / "ships" / "berta"
    scored = shown("score", run, plan.parent / "berta" / "2_zigzag_-10_10.csv")
    table = pd.read_parquet(out / "fleet.parquet")
    assert f"{table.loc['berta', 'held_out_window_after']:.6g}"[:6] in json.dumps(scored)
    result = json.loads((run / "result.json").read_text())
    assert result["calibration"]["name"] == "berta" and result["validation_data"]
    prior = result["coefficients"]["Y_v"]
    assert prior["prior_std"] < small_ship().coefficients["Y_v"].std


@pytest.mark.slow
def test_a_finished_run_is_not_done_again_and_a_lost_part_is(out: Path, plan: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(out, again)
    made = (again / "ships" / "anna" / "result.json").stat().st_mtime_ns
    (again / "parts" / "done" / "berta.json").unlink()
    assert fleet(plan, again, "--resume") == 1
    assert (again / "ships" / "anna" / "result.json").stat().st_mtime_ns == made
    same(out, again)


@pytest.mark.slow
def test_ctrl_c_leaves_a_folder_that_resume_continues_with_the_same_values(
    out: Path, plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def interrupted(task: object) -> object:
        if len(done) == 1:
            raise KeyboardInterrupt
        done.append("one")
        return fit_alone(task)  # type: ignore[arg-type]

    folder = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(fleet_run, "fit_alone", interrupted)
        assert fleet(plan, folder) == 130
    assert not (folder / "fleet.html").exists() and (folder / "parts" / "alone" / "anna.json").exists()
    assert fleet(plan, folder) == 2
    assert fleet(plan, folder, "--resume") == 1
    same(out, folder)


@pytest.mark.longest
@pytest.mark.slow
def test_processes_give_the_same_as_one(out: Path, plan: Path, tmp_path: Path) -> None:
    assert fleet(plan, tmp_path / "run", "--workers", "2") == 1
    same(out, tmp_path / "run")


@pytest.mark.slow
def test_a_folder_of_something_else_is_not_resumed(plan: Path, tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("mine")
    assert fleet(plan, tmp_path, "--resume") == 2


# Plans of fleets: all that is wrong is said at once, and what they list is found
ROWS = "t [s],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],delta [rad]\n0,0,1,0,0,1,{0}\n1,0,1,0,0,1,{0}\n"


def files(folder: Path, *names: str) -> None:
    """Trial files of other contents in the ``folder``."""
    for number, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(ROWS.format(number), encoding="utf-8")


def test_ships_and_files_that_do_not_exist_are_named_at_once(tmp_path: Path) -> None:
    files(tmp_path, "a.csv")
    ships = {
        "anna": 'ship = "no_such_ship"\ntrials = ["a.csv", "gone.csv"]',
        "berta": 'ship = "esso_osaka_3m"\ntrials = ["none/*.csv"]\nheld_out = ["away"]',
        "clara": 'trials = ["a.csv"]\ntrails = ["b.csv"]',
    }
    plan = write_plan(tmp_path, ships, tail='[sisters]\nsome = ["anna", "dora"]')
    line = refusal("fleet", plan, "--out", tmp_path / "out")
    named = ("no_such_ship", "gone.csv", "none/*.csv", "away", "dora", "trails", "ships.clara] give ship", "7 problems")
    assert [words for words in named if words not in line] == [] and not (tmp_path / "out").exists()


def test_a_file_of_two_ships_or_lists_one_folder_of_two_and_sisters_of_other_models_are_refused(tmp_path: Path) -> None:
    files(tmp_path, "a.csv", "b.csv", "c.csv", "d.csv", "e.csv")
    (tmp_path / "copy.csv").write_bytes((tmp_path / "b.csv").read_bytes())
    ships = {
        "anna": 'ship = "esso_osaka_3m"\ntrials = ["a.csv", "c.csv"]\nheld_out = ["c.csv"]',
        "berta": 'ship = "esso_osaka_3m"\ntrials = ["a.csv", "b.csv"]',
        "clara": 'ship = "esso_osaka_3m"\ntrials = ["copy.csv"]',
        "Anna": 'ship = "esso_osaka_3m"\ntrials = ["d.csv"]',
        "dora": 'ship = "kvlcc2_l7"\ntrials = ["e.csv"]',
    }
    with pytest.raises(BadValue) as error:
        read_plan(write_plan(tmp_path, ships, tail='[sisters]\nsome = ["berta", "dora"]'))
    for words in ("c.csv", "a.csv of berta", "copy.csv of clara", "b.csv of berta", "Anna", "some"):
        assert words in str(error.value)


def test_a_plan_lists_campaigns_patterns_and_particulars(tmp_path: Path) -> None:
    files(tmp_path, "x/1.csv", "x/2.csv", "y/3.csv", "z/4.csv", "../elsewhere/5.csv")
    ships = {
        "anna": 'ship = "esso_osaka_3m"\nheld_out = ["z"]\n[ships.anna.campaigns]\nold = ["x"]\nnew = ["y/*.csv"]',
        "berta": "particulars = { L = 161, B = 23.2, d = 7.5, C_b = 0.59 }\ntrials = []\n"
        '[ships.berta.campaigns]\none = ["../elsewhere/*.csv"]',
    }
    plan = read_plan(write_plan(tmp_path, ships))
    anna, berta = plan.ships
    assert list(anna.trials.values()) == ["old", "old", "new"] and [p.name for p in anna.held_out] == ["4.csv"]
    assert berta.start.particulars["L"] == 161 and [p.name for p in berta.trials] == ["5.csv"]
    assert not plan.options.diagnose


def test_an_empty_plan_says_what_to_write(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text("", encoding="utf-8")
    with pytest.raises(UserError, match=r"\[ships\]"):
        read_plan(tmp_path / "plan.toml")


# What a row says of differences between campaigns: those named, and those with several names
def candidate(name: str, nature: str, log_bayes: float, p_value: float = 1e-6) -> GroupDifference:
    values = {"old": GroupValue(0.0, 0.02, -0.3, 0.03), "new": GroupValue(0.3, 0.02, 0.3, 0.03)}
    parameters = {"share": GroupParameter("", "resistance larger by this share", values)}
    return GroupDifference(name, nature, "dynamics", "new", parameters, 30.0, 1, p_value, log_bayes)


def names(verdict: str, *candidates: GroupDifference) -> list[str]:
    found = Between("group", {"old": ("a",), "new": ("b",)}, verdict, "", (), candidates, False)
    return [row["name"] for row in one_of_several(found)]


def test_names_that_explain_a_difference_equally_well_are_said_but_not_chance_instruments_and_what_is_named() -> None:
    rows = (candidate("fouling", "ship", 20.0), candidate("tow", "surroundings", 19.0), candidate("X_vr", "ship", 0.8))
    (name,) = names("unknown", *rows)
    assert "fouling" in name and "tow" in name
    assert names("named", candidate("fouling", "ship", 20.0)) == []
    assert names("unknown", candidate("fouling", "ship", 20.0, 0.2)) == []
    assert names("unknown", candidate("gyro", "instrument", 20.0), candidate("fouling", "ship", 15.0)) == []
    assert names("unknown") == []

"""mmg fleet from plan to page: sisters, a ship that fails, resumed runs, executors that give the same."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from mmg_ident.commands.main import main
from mmg_ident.fleet import run as fleet_run
from mmg_ident.fleet.run import fit_alone
from tests.support.dask_processes import scheduler, worker
from tests.support.small_fleets import sister_of, small_ship, write_plan, write_runs, write_start

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


@pytest.fixture(scope="module")
def out(plan: Path) -> Path:
    folder = plan.parent / "out"
    assert main(["fleet", str(plan), "--out", str(folder)]) == 1  # one ship fails
    return folder


def same(one: Path, other: Path) -> None:
    """Both tables hold the same values, bit for bit."""
    for name in ("fleet.parquet", "coefficients.parquet"):
        pd.testing.assert_frame_equal(pd.read_parquet(one / name), pd.read_parquet(other / name), check_exact=True)


def test_a_ship_that_fails_is_said_and_the_others_are_done(out: Path) -> None:
    table = pd.read_parquet(out / "fleet.parquet")
    assert list(table["status"]) == ["done", "done", "failed"]
    assert "bad.csv" in table.loc["dora", "reason"]
    page = (out / "fleet.html").read_text(encoding="utf-8")
    assert "bad.csv" in page and "http" not in page.replace("http-equiv", "")
    content = json.loads((out / "fleet.json").read_text())
    assert content["failed"] == ["dora"] and set(content["sisters"]["barges"]["coefficients"]) >= {"Y_v", "N_r"}


def test_each_ship_is_a_run_folder_that_other_commands_read(
    out: Path, plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = out / "ships" / "berta"
    assert main(["score", str(run), str(plan.parent / "berta" / "2_zigzag_-10_10.csv"), "--json"]) == 0
    scored = json.loads(capsys.readouterr().out)
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
    assert main(["fleet", str(plan), "--out", str(again), "--resume"]) == 1
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
        assert main(["fleet", str(plan), "--out", str(folder)]) == 130
    assert not (folder / "fleet.html").exists() and (folder / "parts" / "alone" / "anna.json").exists()
    assert main(["fleet", str(plan), "--out", str(folder)]) == 2
    assert main(["fleet", str(plan), "--out", str(folder), "--resume"]) == 1
    same(out, folder)


@pytest.mark.slow
def test_processes_give_the_same_as_one(out: Path, plan: Path, tmp_path: Path) -> None:
    assert main(["fleet", str(plan), "--out", str(tmp_path / "run"), "--workers", "2"]) == 1
    same(out, tmp_path / "run")


def test_a_folder_of_something_else_is_not_resumed(plan: Path, tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("mine")
    assert main(["fleet", str(plan), "--out", str(tmp_path), "--resume"]) == 2


@pytest.mark.slow
def test_workers_of_a_cluster_give_the_same(out: Path, plan: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with scheduler(tmp_path) as (address, _), worker(address, tmp_path, "one"), worker(address, tmp_path, "two"):
        assert main(["fleet", str(plan), "--out", str(tmp_path / "run"), "--scheduler", address]) == 1
    same(out, tmp_path / "run")

"""``mmg plan``: the file that simulate follows, what the plan says, and bad input in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mmg_ident.commands.main import main
from tests.support.calibrated import small_result


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(small_result().save(tmp_path_factory.mktemp("plan") / "run").folder or "")


@pytest.mark.slow
def test_a_plan_stays_inside_and_simulate_follows_it(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, again = tmp_path / "next.csv", tmp_path / "again.csv"
    words = ["plan", str(run), "--area", "60x25", "--time", "60", "--effort", "0.05", "--out", str(out), "--json"]
    assert main(words) == 0
    plan = json.loads(capsys.readouterr().out)
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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--area", "2x1"], "--area 2x1"),
        (["--area", "sixty"], "length x width"),
        (["--coefficients", "Y_vvv"], "Y_vvv"),
        (["--coefficients", "A_1"], "A_1"),
        (["--figures", "beauty"], "beauty"),
        (["--coefficients", "Y_v", "--figures", "advance"], "--figures"),
        (["--time", "1"], "--time"),
        (["--speed-limit", "90"], "--speed-limit"),
        (["--start", "5:12"], "x:y:heading"),
        (["--start", "90:5:0"], "--start"),
        (["--rudder-limit", "90"], "--rudder-limit"),
        (["--time-limit", "0"], "--time-limit"),
        (["--effort", "0"], "--effort"),
    ],
)
def test_bad_input_is_one_line(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    given = ["plan", str(run), "--out", str(tmp_path / "a.csv"), "--area", "60x25", "--time", "60", *words]
    assert main(given) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1 and said in told[0]
    assert not list(tmp_path.iterdir())


def test_a_run_without_covariance_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import shutil

    shutil.copytree(run, tmp_path / "run")
    path = tmp_path / "run" / "result.json"
    content = json.loads(path.read_text())
    content["correlation"]["matrix"][0][0] = None
    path.write_text(json.dumps(content))
    words = ["plan", str(tmp_path / "run"), "--area", "60x25", "--time", "60", "--out", str(tmp_path / "a.csv")]
    assert main(words) == 2

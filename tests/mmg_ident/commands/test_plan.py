"""``mmg plan``: the file that simulate follows, what the plan says, and bad input in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mmg_ident.commands.main import main
from tests.support.calibrated import small_result
from tests.support.commands import refusal, shown


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

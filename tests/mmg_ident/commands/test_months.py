"""mmg months, from parts of a log to a page: on hours of a model, with a change, a damaged part, and bad input."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from mmg_ident.commands.main import main
from tests.support.commands import shown
from tests.support.operation_logs import sailed, write_log

HOURS, CHANGED = 6.0, 3.0
OPTIONS = ["--ship", "esso_osaka_3m", "--no-fit", "--out"]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six hours in which the resistance becomes larger by 40 % after three; the fifth of six parts is damaged."""
    folder = tmp_path_factory.mktemp("months") / "log"
    paths = write_log(folder, sailed(HOURS, 0.4, CHANGED), 6)
    paths[4].write_bytes(paths[4].read_bytes()[:5000])
    return folder


@pytest.mark.slow
def test_a_change_is_named_and_dated_in_a_folder_with_ship_windows_and_page(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shown("months", log, *OPTIONS, run)
    content = json.loads((run / "months.json").read_text())
    first = content["changes"][0]
    assert first["name"] == "fouling.share" and first["kind"] == "step"
    assert abs(24 * first["begin_day"] - CHANGED) < 0.3 and first["size"] == pytest.approx(0.4, rel=0.3)
    assert len(content["log"]["left_out"]) == 1 and "day=05" in content["log"]["left_out"][0]
    windows = pd.read_parquet(run / "windows.parquet")
    assert len(windows) == content["cut"]["windows"] > 200 and windows["u"].median() < 0.05
    page = (run / "months.html").read_text()
    assert "fouling.share" in page and "day=05" in page and page.count("data:image/png") == 1
    assert (run / "ship.toml").exists()


@pytest.mark.slow
def test_windows_that_tell_most_are_fitted(log: Path) -> None:
    out = log.parent / "fitted"
    words = ["months", str(log), "--ship", "esso_osaka_3m", "--out", str(out), "--windows", "6"]
    assert main(words) == 0
    content = json.loads((out / "months.json").read_text())
    assert len(content["subset"]["windows"]) <= 6 and content["subset"]["log_det"] < content["subset"]["log_det_all"]
    assert content["scores"]["after"]["u"] < 1.2 * content["scores"]["before"]["u"]
    assert {"ship.toml", "result.json", "report.html", "months.html"} <= {path.name for path in out.iterdir()}

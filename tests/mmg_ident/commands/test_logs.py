"""Commands that read logs: ``mmg import``, ``mmg cut`` and ``mmg months``."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cases.io.read import read_trials
from cases.simulation.simulate import write_trial
from mmg_ident.commands.main import main
from tests.support import raw_logs
from tests.support.commands import refusal, shown, talk
from tests.support.raw_logs import UNITS, plain
from tests.support.records import long_record, sailed, write_log

# mmg import as a person uses it: questions on a terminal, asked once, and a map that repeats the answers
HEADER = UNITS.replace("shaft_rps", "shaft_speed") + " wind_speed wind_dir_rad ws_kn"


def open_logs(folder: Path) -> Path:
    """Two logs that leave the same open: a unit of the shaft, and which winds they hold."""
    folder.mkdir()
    truth = raw_logs.run()
    n = len(truth)
    more = {"w": np.full(n, 5.0), "d": np.full(n, 1.0), "ws": np.full(n, 9.0)}
    for name, speed in (("a", 1.0), ("b", 1.0001)):
        plain(folder / f"{name}.txt", HEADER, u=speed * truth["u"], **more)
    return folder


def same_folders(one: Path, two: Path) -> bool:
    names = sorted(p.name for p in one.iterdir())
    return names == sorted(p.name for p in two.iterdir()) and all(
        (one / name).read_bytes() == (two / name).read_bytes() for name in names
    )


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="talks on a terminal")
def test_what_is_open_is_asked_once_and_the_map_repeats_it_to_the_bit(tmp_path: Path) -> None:
    open_logs(tmp_path / "logs")
    asked = ["wind_direction", "", "fathoms", "rps", "m/s"]
    code, shown, left = talk(["import", "logs", "--out", "one"], asked, tmp_path)
    assert code == 0 and left == [], shown
    assert shown.count("a.txt, b.txt: 'shaft_speed' (n)") == 1
    assert shown.count("'fathoms'") == 1 and shown.count(" [nothing]: ") == 5
    text = (tmp_path / "one" / "import.toml").read_text()
    assert text.count('ignore = ["ws_kn"]') == 2 or text.count('ignore = ["ws"]') == 2
    code, shown, left = talk(["import", "logs", "--map", "one/import.toml", "--out", "two"], ["kn"] * 3, tmp_path)
    assert code == 0 and left == ["kn"] * 3 and "[nothing]" not in shown
    assert same_folders(tmp_path / "one", tmp_path / "two")


@pytest.mark.slow
def test_logs_of_the_same_names_in_two_folders_stay_apart(tmp_path: Path) -> None:
    pytest.importorskip("pyproj", reason="needs the extra import")
    for number, maneuver in enumerate(("zigzag:20/20", "zigzag:10/10")):
        folder = tmp_path / "logs" / f"day{number}"
        folder.mkdir(parents=True)
        raw_logs.apart(folder, raw_logs.run(maneuver))
    one, two = tmp_path / "one", tmp_path / "two"
    assert main(["import", str(tmp_path / "logs"), "--out", str(one)]) == 0
    assert sorted(p.name for p in one.glob("*.csv")) == ["day0_run7.csv", "day1_run7.csv"]
    assert '[files."day1/run7_gyro.csv"]' in (one / "import.toml").read_text()
    assert main(["import", str(tmp_path / "logs"), "--map", str(one / "import.toml"), "--out", str(two)]) == 0
    assert same_folders(one, two)


def test_a_file_that_is_skipped_is_skipped_again(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in ("a", "b"):
        plain(logs / f"{name}.txt", UNITS)
    (tmp_path / "map.toml").write_text('[files."b"]\nskip = true\n')
    one, two = tmp_path / "one", tmp_path / "two"
    assert main(["import", str(logs), "--map", str(tmp_path / "map.toml"), "--out", str(one)]) == 0
    assert main(["import", str(logs), "--map", str(one / "import.toml"), "--out", str(two)]) == 0
    assert sorted(p.name for p in two.iterdir()) == ["a.csv", "import.toml", "trials.toml"] and same_folders(one, two)


# mmg cut, from a record to trial files that other commands read
@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cut") / "record.csv"
    write_trial(long_record("esso_osaka_3m", ["turning:35", "zigzag:-20/10"], 0.5)[0], path)
    return path


def test_files_and_rows_are_those_of_the_manoeuvres(record: Path) -> None:
    out = record.parent / "parts"
    rows = shown("cut", record, "--out", out, "--length", "3")["trials"]
    assert [(row["kind"], row["order"]) for row in rows] == [("turning", "35"), ("zigzag", "-20/10")]
    assert sorted(path.name for path in out.iterdir()) == [*(row["file"] for row in rows), "trials.toml"]
    for row, trial in zip(rows, read_trials(out), strict=True):
        said = tuple(row[key] for key in ("name", "kind", "begin_s", "end_s"))
        assert (trial.name, trial.kind, trial.t[0], trial.t[-1]) == said
    assert shown("imo", out, "--length", "3", "--scale", "100")["runs"][0]["figures"]["advance"] > 0


def test_a_folder_with_files_is_kept_unless_forced(record: Path, tmp_path: Path) -> None:
    kept = tmp_path / "kept.txt"
    kept.write_text("mine")
    words = ["cut", str(record), "--out", str(tmp_path), "--length", "3"]
    assert main(words) == 2 and [path.name for path in tmp_path.iterdir()] == ["kept.txt"]
    assert main([*words, "--force"]) == 0 and kept.read_text() == "mine" and len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize("name", ["raw.txt", "raw.csv", "none.csv"])
def test_a_raw_log_is_refused_with_the_command_that_reads_it(name: str, tmp_path: Path) -> None:
    log = tmp_path / name
    if name != "none.csv":
        log.write_text("tvec,N,E,heading\n0,1,2,3\n1,1,2,3\n")
    assert ("mmg import" in refusal("cut", log, "--out", tmp_path / "out")) == (name != "none.csv")
    assert not (tmp_path / "out").exists()


# mmg months, from parts of a log to a page: on hours of a model, with a change, a damaged part, and bad input
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

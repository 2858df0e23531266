"""mmg cut, from a record to trial files that other commands read."""

from __future__ import annotations

from pathlib import Path

import pytest

from cases.io.read import read_trials
from cases.simulation.simulate import write_trial
from mmg_ident.commands.main import main
from tests.support.commands import refusal, shown
from tests.support.long_records import long_record


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

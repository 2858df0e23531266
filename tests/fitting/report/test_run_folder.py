"""Run folders: whole or absent, one process at a time, nothing left beside them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fitting.report.run_folder import reserved, write_whole
from mmg.errors import Conflict, NotWritable

pytestmark = pytest.mark.skipif(os.name == "nt", reason="kills by SIGKILL")
KILLED = """
import os, sys
from pathlib import Path
from fitting.report.run_folder import reserved, write_whole

def fill(folder):
    (folder / "half").write_text("written")
    os.kill(os.getpid(), 9)

folder = Path(sys.argv[1])
with reserved(folder):
    write_whole(folder, fill, replace=True)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write(folder: Path) -> None:
    (folder / "whole").write_text("written")


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path) -> None:
    """SIGKILL while a run is written: no folder of that name, and the next run clears what is hidden beside it."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "run")], cwd=Path(__file__).parents[3])
    assert done.returncode == -9 and not (tmp_path / "run").exists() and len(names(tmp_path)) == 3
    (tmp_path / ".run.mine").mkdir()
    with reserved(tmp_path / "run"):
        write_whole(tmp_path / "run", write)
    assert names(tmp_path) == [".run.mine", "run"] and names(tmp_path / "run") == ["whole"]


def test_a_run_that_was_moved_aside_by_a_killed_process_is_put_back(tmp_path: Path) -> None:
    """Killed between the two renames that replace a run."""
    write_whole(tmp_path / "run", write)
    (tmp_path / ".run.0123abcd.old").mkdir()
    (tmp_path / "run").rename(tmp_path / ".run.0123abcd.old" / "run")
    with pytest.raises(KeyError):
        write_whole(tmp_path / "run", lambda folder: {}["nothing"], replace=True)
    assert names(tmp_path) == ["run"] and names(tmp_path / "run") == ["whole"]


def test_two_processes_do_not_work_on_one_folder(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "run"
    with reserved(folder):
        with pytest.raises(Conflict), reserved(folder):
            pass
        with reserved(tmp_path / "deep" / "other"):
            pass
    assert names(tmp_path) == []
    with reserved(folder):
        write_whole(folder, write)
    assert names(tmp_path / "deep") == ["run"]


def test_a_full_disk_leaves_nothing_and_is_one_line(tmp_path: Path) -> None:
    def full(folder: Path) -> None:
        write(folder)
        raise OSError(28, "No space left on device")

    write_whole(tmp_path / "run", write)
    with pytest.raises(NotWritable):
        write_whole(tmp_path / "run", full, replace=True)
    assert names(tmp_path) == ["run"] and names(tmp_path / "run") == ["whole"]

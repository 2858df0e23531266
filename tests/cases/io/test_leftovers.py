"""A file appears whole, and what a killed process left beside it is removed by the next one that writes it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cases.io.files import replace_text, replaced

LEFT = ".table.csv.0123abcd.part"


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path) -> None:
    (tmp_path / LEFT).write_text("half")
    (tmp_path / ".other.csv.0123abcd.part").write_text("of another file")
    replace_text(tmp_path / "table.csv", "whole")
    assert sorted(p.name for p in tmp_path.iterdir()) == [".other.csv.0123abcd.part", "table.csv"]


def test_what_another_process_is_writing_is_left_alone(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    handle = os.open(tmp_path / LEFT, os.O_CREAT | os.O_WRONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    replace_text(tmp_path / "table.csv", "whole")
    assert (tmp_path / LEFT).exists()
    os.close(handle)
    replace_text(tmp_path / "table.csv", "again")
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]


def test_a_writing_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("old")
    with pytest.raises(KeyboardInterrupt), replaced(tmp_path / "table.csv") as scratch:
        scratch.write_text("half")
        raise KeyboardInterrupt
    assert (tmp_path / "table.csv").read_text() == "old" and len(list(tmp_path.iterdir())) == 1

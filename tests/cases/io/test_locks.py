"""A lock lets one in, ends with its owner, and is never that of a file which is no longer there."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from cases.io.files import alone, replace_text, replaced

MARK = ".run.lock"


def test_one_is_alone_until_it_ends(tmp_path: Path) -> None:
    with alone(tmp_path / MARK) as first:
        with alone(tmp_path / MARK) as second, alone(tmp_path / ".other.lock") as other:
            assert (first, second, other) == (True, False, True)
        assert (tmp_path / MARK).exists(), "removed by one that did not have it"
    assert not list(tmp_path.iterdir())
    (tmp_path / MARK).touch()  # left by one that was killed
    with alone(tmp_path / MARK) as third:
        assert third
    assert not list(tmp_path.iterdir())


def test_a_file_that_its_last_owner_removed_is_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opened while another one had it, locked after that one removed it: a third would make a new file and enter."""
    fcntl = pytest.importorskip("fcntl")
    lock, calls = fcntl.flock, []

    def late(handle: int, how: int) -> None:
        calls.append(handle)
        if len(calls) == 1:
            (tmp_path / MARK).unlink()
        lock(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with alone(tmp_path / MARK) as first, alone(tmp_path / MARK) as second:
        assert (first, second) == (True, False) and len(calls) == 3


def test_a_file_system_without_locks_keeps_nobody_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fcntl = pytest.importorskip("fcntl")

    def no_locks(handle: int, how: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    with alone(tmp_path / MARK) as first:
        assert first


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

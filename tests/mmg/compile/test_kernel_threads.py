"""Threads that calculate intervals: as asked for, or one."""

from __future__ import annotations

import os
import time

import pytest

from mmg.compile.kernel_threads import even_shares, in_threads, kernel_threads
from mmg.errors import UserError


@pytest.mark.parametrize("asked", ["0", "-1", "two", "1.5"])
def test_threads_that_are_no_number_are_refused(asked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_THREADS", asked)
    with pytest.raises(UserError, match=f"MMG_THREADS={asked}"):
        kernel_threads()


def test_threads_are_no_more_than_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_THREADS", "256")
    assert kernel_threads() == (os.cpu_count() or 1)
    monkeypatch.delenv("MMG_THREADS")
    assert kernel_threads() == 1


def test_shares_are_even_and_done_once_each_and_the_largest_is_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    done: list[tuple[int, int]] = []

    def work(begin: int, end: int) -> int:
        done.append((begin, end))
        return end

    for threads, shares in (("1", [(0, 10)]), ("3", [(0, 3), (3, 6), (6, 10)])):
        monkeypatch.setenv("MMG_THREADS", threads)
        assert even_shares(10) == shares and even_shares(2)[-1][1] == 2
        done.clear()
        assert in_threads(work, even_shares(10)) == 10 and sorted(done) == shares


def test_ctrl_c_waits_for_the_other_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setenv("MMG_THREADS", "2")
    ended = []

    def work(begin: int, end: int) -> int:
        if begin == 0:
            raise KeyboardInterrupt
        time.sleep(0.2)
        ended.append(end)
        return 0

    with pytest.raises(KeyboardInterrupt):
        in_threads(work, [(0, 1), (1, 2)])
    assert ended == [2]

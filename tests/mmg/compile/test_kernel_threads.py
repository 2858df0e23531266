"""Threads that calculate intervals: as asked for, or one and those for processors that are idle."""

from __future__ import annotations

import os

import pytest

from mmg.compile.kernel_threads import idle_processors, kernel_threads
from mmg.errors import UserError


@pytest.mark.parametrize("asked", ["0", "-1", "two", "1.5"])
def test_threads_that_are_no_number_are_refused(asked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_THREADS", asked)
    with pytest.raises(UserError, match=f"MMG_THREADS={asked}: not a number of threads"):
        kernel_threads()


def test_threads_are_no_more_than_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_THREADS", "256")
    assert kernel_threads() == (os.cpu_count() or 1)
    monkeypatch.delenv("MMG_THREADS")
    assert kernel_threads() == 1


def test_an_idle_processor_gets_a_thread_unless_the_number_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    monkeypatch.delenv("MMG_THREADS", raising=False)
    idle = [0, 1, 1]
    with idle_processors(idle.pop):
        assert [kernel_threads() for _ in range(3)] == [2, 2, 1]
        monkeypatch.setenv("MMG_THREADS", "1")
        assert kernel_threads() == 1
    monkeypatch.delenv("MMG_THREADS")
    assert kernel_threads() == 1

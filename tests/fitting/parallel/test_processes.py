"""What the processes of this machine leave behind: nothing."""

from __future__ import annotations

import multiprocessing
import threading

import pytest

from fitting.parallel import helper
from fitting.parallel.processes import process_crew


def watching() -> set[object]:
    """Threads that watch the processes of a pool, and these processes: of tests before this one, too, which may end
    later than they do."""
    threads = {thread for thread in threading.enumerate() if "concurrent.futures.process" in type(thread).__module__}
    return threads | set(multiprocessing.active_children())


def test_no_thread_of_a_helper_is_left_that_the_end_of_the_interpreter_could_meet() -> None:
    before = watching()
    with helper(int) as executor:
        assert executor.submit(int).result() == 0
        assert len(watching() - before) == 2
    assert not watching() - before


def test_no_thread_of_a_crew_that_an_error_ends_is_left() -> None:
    before = watching()
    with pytest.raises(KeyboardInterrupt), process_crew(2) as crew:
        assert list(crew.outcomes(abs, [-1, -2])) == [1, 2]
        assert len(watching() - before) >= 2
        raise KeyboardInterrupt
    assert not watching() - before


def test_a_helper_that_ends_leaves_the_other_one_alone() -> None:
    with helper(int) as first:
        with helper(int) as second:
            assert second.submit(int).result() == 0
        assert first.submit(abs, -3).result() == 3

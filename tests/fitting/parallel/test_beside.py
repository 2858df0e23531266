"""Work beside this process: the same values with it, without it, and where it fails."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from functools import partial

import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from fitting.parallel import Awaited, ProcessBeside, begun_beside, helper, process_beside
from fitting.prediction.envelope import trial_envelope


def nothing() -> None:
    """What the process does first."""


def where() -> int:
    """Of the process that does this."""
    return os.getpid()


def ended() -> int:
    """What only ends the process that is beside another one."""
    if multiprocessing.parent_process() is not None:
        os._exit(1)
    return 3


def wrong() -> int:
    """What cannot be done."""
    raise ValueError("no such thing")


@pytest.fixture
def process() -> Iterator[ProcessBeside]:
    with helper(nothing) as executor:
        yield ProcessBeside(executor)


def test_what_is_begun_is_done_there_and_what_is_not_is_done_here(process: ProcessBeside) -> None:
    there, here = begun_beside(process, where), begun_beside(None, where)
    assert there.future is not None and here.future is None
    there.future.result()
    assert there.value != os.getpid() and here.value == os.getpid()


def test_a_value_is_made_once(process: ProcessBeside) -> None:
    made: list[int] = []
    one = Awaited(lambda: made.append(1) or len(made))  # type: ignore[func-returns-value]
    assert (one.value, one.value, made) == (1, 1, [1])


def test_what_the_process_cannot_do_is_done_here_and_raises_here(process: ProcessBeside) -> None:
    local = begun_beside(process, lambda: where())
    assert local.value == os.getpid()
    with pytest.raises(ValueError, match="no such thing"):
        _ = begun_beside(process, wrong).value
    first, after = begun_beside(process, ended), begun_beside(process, where)
    assert first.value == 3 and after.value == os.getpid()
    assert begun_beside(process, where).value == os.getpid()  # it has ended


def test_with_one_core_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.parallel.beside.cores", lambda: 1)
    with process_beside(nothing) as process:
        assert process is None


def test_arrays_come_back_bit_for_bit(process: ProcessBeside) -> None:
    work = partial(trial_envelope, load_ship("esso_osaka_3m"), demo_trials(3, dt=0.5)[0][:2])
    made = begun_beside(process, work)
    assert made.future is not None and made.future.result() == made.value == work()

"""Work beside this process: the same values with it, without it, and where it fails."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from cases.checks import check, ready
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from fitting.parallel import (
    Awaited,
    ProcessBeside,
    begun_beside,
    both_processes,
    evaluated_beside,
    helper,
    process_beside,
    run_all,
    spread_beside,
    width,
)
from fitting.pipeline import FitOptions, calibrate
from fitting.prediction.envelope import trial_envelope
from fitting.settings import Settings
from mmg.errors import UserError


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
    assert there.there.result() == there.value
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
    assert made.there.result() == made.value == work()


def test_what_has_not_begun_is_taken_back_and_the_rest_is_not_lost_with_the_process(process: ProcessBeside) -> None:
    slow = begun_beside(process, partial(time.sleep, 0.5))
    last, more = begun_beside(process, where), begun_beside(process, ended)
    assert last.value == os.getpid() and slow.value is None and more.value == 3


def test_tasks_are_shared_and_their_outcomes_stay_in_order(process: ProcessBeside) -> None:
    items = list(range(40))
    assert spread_beside(process, square, items) == spread_beside(None, square, items) == [i * i for i in items]
    with pytest.raises(ValueError, match="no square of 7"):
        spread_beside(process, no_seven, items)


def square(number: int) -> int:
    """Its square."""
    return number * number


def no_seven(number: int) -> int:
    """Its square, but of 7."""
    if number == 7:
        raise ValueError("no square of 7")
    return square(number)


def slow_where(seconds: float) -> int:
    """Of the process that does this, after some seconds."""
    time.sleep(seconds)
    return os.getpid()


def test_lists_of_tasks_are_shared_by_both_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.parallel.beside.cores", lambda: 2)
    finished: list[int] = []
    with both_processes(nothing) as process:
        assert process is not None and width(1) == 2
        assert begun_beside(process, where).there.result() != os.getpid()  # it is there
        assert run_all(square, range(20), each=finished.append) == [i * i for i in range(20)] == finished
        done_by = run_all(slow_where, [0.2] * 6)
        assert done_by[0] == os.getpid() != done_by[-1] and len(set(done_by)) == 2
        with pytest.raises(ValueError, match="no square of 7"):
            run_all(no_seven, range(9))
        assert run_all(square, [3]) == [9]
    assert width(1) == 1


@pytest.mark.parametrize("scarce", ["cores", "memory"])
def test_without_a_second_core_or_memory_this_process_does_all(scarce: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.parallel.beside.cores", lambda: 1 if scarce == "cores" else 2)
    monkeypatch.setattr("fitting.parallel.beside.room_for", lambda count: 1 if scarce == "memory" else count)
    with both_processes(nothing) as process:
        assert process is None and run_all(slow_where, [0.0] * 3) == [os.getpid()] * 3


def test_a_single_work_is_done_beside_only_where_both_do_the_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.parallel.beside.cores", lambda: 2)
    monkeypatch.setattr("fitting.parallel.beside.room_for", lambda count: count)
    assert evaluated_beside(where).value == os.getpid()
    with both_processes(nothing) as process:
        assert process is not None
        there = evaluated_beside(where)
        for _ in range(200):
            if there.there.done():
                break
            time.sleep(0.05)
        assert there.value != os.getpid()
        assert idle(process), "with nothing to do, its processor is another thread's"
    with process_beside(nothing):  # which is not given the tasks of others
        assert evaluated_beside(where).value == os.getpid()


def idle(process: ProcessBeside) -> bool:
    """Whether it becomes idle soon."""
    for _ in range(200):
        if process.idle:
            return True
        time.sleep(0.05)
    return False


def test_files_are_read_and_checked_alike(process: ProcessBeside, tmp_path: Path) -> None:
    files = [tmp_path / f"run_{k}.csv" for k in range(6)]
    for file, trial in zip(files, [*demo_trials(3, dt=0.5)[0]] * 2, strict=False):
        write_trial(trial, file)
    spread = partial(spread_beside, process)
    here, shared = read_trials(files), read_trials(files, spread=spread)
    assert [repr(t) for t in here] == [repr(t) for t in shared]
    for one, other in zip(here, shared, strict=True):
        assert one.notices == other.notices and one.columns.keys() == other.columns.keys()
        assert all(one[name].tobytes() == other[name].tobytes() for name in one.columns)
    assert repr(check(here)) == repr(check(shared, spread))
    assert [t.notices for t in ready(here)[0]] == [t.notices for t in ready(shared, spread=spread)[0]]
    for k in (1, 4):
        files[k].write_text("nothing\n1\n")
    said = []
    for way in (partial(spread_beside, None), spread):
        with pytest.raises(UserError) as error:
            read_trials(files, spread=way)
        said.append(str(error.value))
    assert said[0] == said[1] and "2 of 6 files" in said[0] and said[0].index("run_1") < said[0].index("run_4")


def test_a_calibration_is_the_same_with_the_process_beside_and_without() -> None:
    start, (train, held_out) = load_ship("esso_osaka_3m"), demo_trials(3, dt=0.5)
    start = start.fixing([s for s in start.symbols if s not in ("Y_v", "N_r", "k_0")])
    settings, options = Settings(passes=2, compiled=False), FitOptions(next_trial=False, instruments=())
    alone = calibrate(start, train[:2], held_out[-1:], settings, options)
    with helper(int) as executor:
        beside = replace(options, beside=ProcessBeside(executor))
        shared = calibrate(start, train[:2], held_out[-1:], settings, beside)
    left = {"created", "timings_s", "passes"}
    one, other = ({k: v for k, v in c.to_dict().items() if k not in left} for c in (alone, shared))
    assert one == other and one["adaptation"] is not None and one["envelope"]

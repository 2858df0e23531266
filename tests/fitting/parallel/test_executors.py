"""Lists of tasks: the same values on one process and on several, told as they finish, with a line where one is lost."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from diagnosis.diagnose import diagnose
from fitting.calibrate import calibrate
from fitting.calibration import estimate_coefficients
from fitting.parallel import Shared, executors, kept_workers, listening, run_all, width, with_one_thread
from fitting.parallel import dask_cluster as module
from fitting.parallel.dask_cluster import dask_cluster
from fitting.parallel.executors import AHEAD
from mmg.errors import UserError
from mmg.messages import Progress
from mmg_ident.commands.main import main
from tests.support.dask_processes import fails, noted, root_of, scheduler, worker

PROCESS = 1e12  # More than this process holds [bytes]


def late(job: tuple[int, str]) -> tuple[int, int]:
    """A task: the first of several waits, where a folder is named, until the last one has left its mark there."""
    number, folder = job
    if folder and number == 4:
        (Path(folder) / "last").touch()
    until = time.monotonic() + 60
    while folder and number == 0 and not (Path(folder) / "last").exists() and time.monotonic() < until:
        time.sleep(0.02)
    return number, os.getpid()


def ends_itself(number: int) -> int:
    """A task whose process is ended as the system does for want of memory."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@dataclass
class Opened:
    """A value that notes how often it was unpickled in a process."""

    marks: Path
    content: np.ndarray = field(default_factory=lambda: np.arange(5.0))

    def __setstate__(self, state: dict) -> None:
        self.__dict__ = state
        (self.marks / f"{os.getpid()}_{time.monotonic_ns()}").touch()


def seen(job: tuple[Shared[Opened], int]) -> float:
    """A task on a shared value."""
    return float(job[0].value.content[job[1]])


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_the_listener_hears_of_each_task_as_it_finishes(workers: int, tmp_path: Path) -> None:
    told: list[Progress] = []
    order: list[int] = []
    with listening(told.append):
        jobs = [(k, str(tmp_path) if workers > 1 else "") for k in range(5)]
        found = run_all(late, jobs, workers, lambda one: order.append(len(told)), "numbers")
        run_all(late, [(1, ""), (2, "")], 1)  # a list without a name is not told
    assert [number for number, _ in found] == list(range(5))
    assert [(p.task, p.step, p.of) for p in told] == [("numbers", k + 1, 5) for k in range(5)]
    assert order == [1, 2, 3, 4, 5] if workers == 1 else order[0] >= 4  # the first outcome came among the last


@pytest.mark.slow
def test_kept_workers_serve_one_list_after_the_other_and_open_what_is_shared_once(tmp_path: Path) -> None:
    shared = Shared(Opened(tmp_path))
    assert run_all(seen, [(shared, k) for k in range(5)]) == list(range(5)) and not list(tmp_path.iterdir())
    with kept_workers(2):
        assert width(1) == 2
        pids = {pid for _ in range(3) for _, pid in run_all(late, [(k, "") for k in (1, 2, 3)])}
        for _ in range(4):
            assert run_all(seen, [(shared, k) for k in range(5)]) == list(range(5))
    assert len(pids) <= 2 and os.getpid() not in pids
    opened = [path.name.split("_")[0] for path in tmp_path.iterdir()]
    assert 1 <= len(opened) <= 2 and len(set(opened)) == len(opened)
    assert width(1) == 1
    assert pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(shared)))).value.content[3] == 3.0


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="ends a process by SIGKILL")
def test_a_process_that_is_ended_from_outside_is_one_line() -> None:
    with pytest.raises(UserError, match="--workers"):
        run_all(ends_itself, list(range(4)), 2)


@pytest.mark.slow
def test_no_more_processes_than_there_is_memory_for(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(executors, "PROCESS", PROCESS)
    for free, expected in ((10.0, 4), (3.3, 3), (0.0, 1), (float("inf"), 4)):
        monkeypatch.setattr(executors, "free_memory", lambda free=free * PROCESS: free)
        caplog.clear()
        with caplog.at_level("WARNING", "mmg_ident"):
            assert executors.affordable(4) == expected
        assert bool(caplog.messages) == (expected < 4)
    monkeypatch.setattr(executors, "free_memory", lambda: 0.0)
    assert run_all(late, [(1, ""), (2, ""), (3, "")], 4)[0][0] == 1  # one process is always there


def test_free_memory_is_that_of_the_machine_or_the_control_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "meminfo").write_text("MemTotal: 9000 kB\nMemAvailable:    5000 kB\n")
    monkeypatch.setattr(executors, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(executors, "CGROUP", tmp_path)
    assert executors.free_memory() == 5000 * 1024
    for name, text in (("max", "3000000\n"), ("current", "2000000\n"), ("stat", "anon 5\ninactive_file 500000\n")):
        (tmp_path / f"memory.{name}").write_text(text)
    assert executors.free_memory() == 1.5e6
    (tmp_path / "memory.max").write_text("max\n")
    assert executors.free_memory() == 5000 * 1024
    monkeypatch.setattr(executors, "MEMINFO", tmp_path / "none")
    assert executors.free_memory() == float("inf")


def test_no_thread_and_no_process_is_left_that_the_end_of_the_interpreter_could_meet() -> None:
    def there() -> set[object]:
        return set(threading.enumerate()) | set(multiprocessing.active_children())

    before = there()
    assert run_all(abs, [-1, -2], 2) == [1, 2]
    assert not there() - before
    with pytest.raises(KeyboardInterrupt), kept_workers(2):
        assert run_all(abs, [-1, -2, -3]) == [1, 2, 3]
        raise KeyboardInterrupt
    assert not there() - before


def test_one_thread_while_it_runs_and_as_many_as_before_after(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in executors.THREADS:
        monkeypatch.delenv(name, raising=False)

    def threads(fails: bool = False) -> set[int]:
        assert np.ones(2).sum() == 2.0
        found = {row["num_threads"] for row in threadpool_info()}
        if fails:
            raise ValueError(str(found))
        return found

    with threadpool_limits(2):
        assert with_one_thread(threads)() == {1}
        with pytest.raises(ValueError, match=r"\{1\}"):
            with_one_thread(threads)(True)
        assert threads() == {2}
    entries: list[Callable[..., Any] | None] = [calibrate, estimate_coefficients, diagnose]
    if find_spec("torch") is not None:
        entries.append(import_module("residual.pipeline").train)
    for entry in entries:  # what takes long is entered by it
        while entry is not None and entry.__code__ is not with_one_thread(threads).__code__:
            entry = getattr(entry, "__wrapped__", None)
        assert entry is not None


# Large arrays that follow each other take the memory of the ones before
PROGRAM = """
import resource
import numpy as np
from fitting.parallel.executors import keep_freed_memory

able = keep_freed_memory()
for _ in range(3):
    one, two = np.ones(2_000_000), np.ones(2_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    del one, two
more = [np.ones(2_000_000) for _ in range(2)]
print(able, resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems keep it, or not, by themselves")
def test_pages_are_not_cleared_again() -> None:
    made = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    able, faults = made.stdout.split()
    assert able == "False" or int(faults) < 1000  # of 7,800 pages


# Processes of a pool end with the one that started them
ORPHANED = """
import os, time
from fitting.parallel import run_all
from tests.fitting.parallel.test_executors import waits
if __name__ == "__main__":
    run_all(waits, [1, 2], 2)
"""


def waits(_: int) -> None:
    """What a process of the pool does here."""
    os.write(1, f"{os.getpid()}\n".encode())  # at once: print may write the end of the line apart
    time.sleep(120)


def alive(pid: int) -> bool:
    """Whether a process lives; one that has ended and is not yet waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="looks for processes in /proc")
def test_a_pool_whose_parent_is_killed_ends() -> None:
    process = subprocess.Popen([sys.executable, "-c", ORPHANED], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    children = [int(process.stdout.readline()) for _ in range(2)]
    assert all(alive(pid) for pid in children)
    process.send_signal(signal.SIGKILL)
    process.wait()
    until = time.monotonic() + 60
    while any(alive(pid) for pid in children) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(alive(pid) for pid in children)


# Tasks on a Dask cluster: a real scheduler and real workers on loopback
LIST = ("select", "esso_osaka_3m", "--list", "--scheduler")
needs_dask = pytest.mark.skipif(find_spec("distributed") is None, reason="pip install 'mmg-ident[dask]'")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("dask")
    with ExitStack() as stack:
        found, _ = stack.enter_context(scheduler(folder))
        for name in ("first", "second"):
            stack.enter_context(worker(found, folder, name))
        yield found


@needs_dask
@pytest.mark.slow
def test_outcomes_are_those_of_this_process_in_the_order_of_the_tasks_and_an_exception_ends_its_list_alone(
    address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tasks, told = list(range(12)), []
    inline = [root for root, _ in run_all(root_of, tasks)]
    with dask_cluster(address) as cluster:
        cluster.client.wait_for_workers(2, timeout=60)
        assert width(1) == cluster.width == 2
        found = run_all(root_of, tasks, each=lambda outcome: told.append(outcome[0]))
        with pytest.raises(ZeroDivisionError, match="three"):
            run_all(fails, list(range(8)))
        assert run_all(fails, [1, 2]) == [1, 2]
    assert [root for root, _ in found] == told == inline  # bit for bit
    assert len({pid for _, pid in found} - {os.getpid()}) == 2  # the second worker did some, this process none
    assert width(3) == 3
    assert main([*LIST, address]) == 0 and f"of {address}" in capsys.readouterr().err


@needs_dask
@pytest.mark.slow
def test_a_killed_worker_changes_nothing_but_the_tasks_it_had_and_a_killed_scheduler_is_one_line(
    tmp_path: Path,
) -> None:
    marks, count = tmp_path / "marks", 12
    marks.mkdir()
    with ExitStack() as stack:
        at, process = stack.enter_context(scheduler(tmp_path))
        doomed = stack.enter_context(worker(at, tmp_path, "doomed"))
        stack.enter_context(worker(at, tmp_path, "other"))
        cluster = stack.enter_context(dask_cluster(at))
        cluster.client.wait_for_workers(2, timeout=60)

        def kill(outcome: int) -> None:
            if outcome == 4:  # the third: both are at work
                os.kill(doomed.pid, signal.SIGKILL)

        found = run_all(noted, [(i, str(marks)) for i in range(count)], each=kill)
        threading.Timer(1.0, process.kill).start()
        for work in (lambda: run_all(root_of, list(range(10**4))), lambda: width(1)):  # also before a list is begun
            with pytest.raises(UserError, match=at):
                work()
    begun = [int(path.name.split("_")[0]) for path in marks.iterdir()]
    assert found == [i * i for i in range(count)]
    assert set(begun) == set(range(count)) and len(begun) <= count + AHEAD + 1


@needs_dask
@pytest.mark.slow
def test_an_absent_scheduler_one_without_workers_and_something_else_that_listens_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "TIMEOUT", 1.0)
    for wrong in ("tcp://127.0.0.1:1", "nothing", "foo://x:1"):
        assert main([*LIST, wrong]) == 2
        assert wrong in capsys.readouterr().err.strip().splitlines()[-1]
    with scheduler(tmp_path) as (at, _), pytest.raises(UserError, match="1 s"):
        dask_cluster(at).__enter__()
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes the connection and says nothing
        at = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(UserError, match=f"--scheduler {at}"):
            dask_cluster(at).__enter__()


@needs_dask
@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"workers": {"tcp://w": ImportError("no")}}, "tcp://w"),
        ({"workers": {"tcp://w": "0.0.1"}}, "tcp://w"),
        ({"python": "3.7.1"}, "tcp://w"),
        ({"scheduler": "1.2"}, "1.2"),
    ],
)
def test_other_versions_are_one_line(changed: dict, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import distributed

    monkeypatch.setattr(module.importlib.metadata, "version", lambda _: "9.9")
    python = {"packages": {"python": "3.11.2.final.0"}}
    client = SimpleNamespace(
        wait_for_workers=lambda *_, **__: None,
        get_versions=lambda: {
            "scheduler": {"packages": {"distributed": changed.get("scheduler", distributed.__version__)}},
            "client": python,
            "workers": {"tcp://w": {"packages": {"python": changed.get("python", "3.11.9.final.0")}}},
        },
        run=lambda *_, **__: changed.get("workers", {"tcp://w": "9.9"}),
    )
    with pytest.raises(UserError, match=words):
        module.check_workers(client, "tcp://s")


@pytest.mark.slow
def test_without_dask_a_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main([*LIST, "tcp://127.0.0.1:1", "--json"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--scheduler" in line and "mmg-ident[dask]" in line and line.endswith("[not_installed]")

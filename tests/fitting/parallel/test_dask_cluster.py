"""Tasks on a Dask cluster: a real scheduler and real workers on loopback."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest

from fitting.parallel import dask_cluster as module
from fitting.parallel import run_all, width
from fitting.parallel.dask_cluster import dask_cluster
from fitting.parallel.executors import AHEAD
from mmg.errors import UserError
from mmg_ident.commands.main import main
from tests.support.dask_processes import fails, noted, root_of, scheduler, worker

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'mmg-ident[dask]'")
LIST = ("select", "esso_osaka_3m", "--list", "--scheduler")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("dask")
    with ExitStack() as stack:
        found, _ = stack.enter_context(scheduler(folder))
        for name in ("first", "second"):
            stack.enter_context(worker(found, folder, name))
        yield found


@pytest.mark.slow
def test_outcomes_are_those_of_this_process_in_the_order_of_the_tasks(address: str) -> None:
    tasks, told = list(range(12)), []
    inline = [root for root, _ in run_all(root_of, tasks)]
    with dask_cluster(address) as cluster:
        cluster.client.wait_for_workers(2, timeout=60)
        assert width(1) == cluster.width == 2
        found = run_all(root_of, tasks, each=lambda outcome: told.append(outcome[0]))
    assert [root for root, _ in found] == told == inline  # bit for bit
    assert len({pid for _, pid in found} - {os.getpid()}) == 2  # the second worker did some, this process none
    assert width(3) == 3


@pytest.mark.slow
def test_an_exception_of_a_task_is_raised_here_and_the_cluster_goes_on(address: str) -> None:
    with dask_cluster(address):
        with pytest.raises(ZeroDivisionError, match="three"):
            run_all(fails, list(range(8)))
        assert run_all(fails, [1, 2]) == [1, 2]


@pytest.mark.slow
def test_a_verb_hands_its_tasks_to_the_scheduler(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*LIST, address]) == 0 and f"of {address}" in capsys.readouterr().err


@pytest.mark.slow
def test_a_worker_that_is_killed_changes_nothing_but_the_tasks_it_had(tmp_path: Path) -> None:
    marks, count = tmp_path / "marks", 12
    marks.mkdir()
    with ExitStack() as stack:
        at, _ = stack.enter_context(scheduler(tmp_path))
        doomed = stack.enter_context(worker(at, tmp_path, "doomed"))
        stack.enter_context(worker(at, tmp_path, "other"))
        cluster = stack.enter_context(dask_cluster(at))
        cluster.client.wait_for_workers(2, timeout=60)

        def kill(outcome: int) -> None:
            if outcome == 4:  # the third: both are at work
                os.kill(doomed.pid, signal.SIGKILL)

        found = run_all(noted, [(i, str(marks)) for i in range(count)], each=kill)
    begun = [int(path.name.split("_")[0]) for path in marks.iterdir()]
    assert found == [i * i for i in range(count)]
    assert set(begun) == set(range(count)) and len(begun) <= count + AHEAD + 1


@pytest.mark.longest
@pytest.mark.slow
def test_a_scheduler_that_dies_is_one_line(tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    with ExitStack() as stack:
        at, process = stack.enter_context(scheduler(tmp_path))
        stack.enter_context(worker(at, tmp_path, "only"))
        stack.enter_context(dask_cluster(at))
        threading.Timer(1.0, process.kill).start()
        began = time.monotonic()
        with pytest.raises(UserError, match=at):
            run_all(noted, [(i, str(marks)) for i in range(100)])
        assert time.monotonic() - began < 60
        with pytest.raises(UserError, match=at):  # also before a list is begun
            width(1)


@pytest.mark.slow
def test_an_absent_scheduler_and_one_without_workers_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "TIMEOUT", 1.0)
    for wrong in ("tcp://127.0.0.1:1", "nothing", "foo://x:1"):
        assert main([*LIST, wrong]) == 2
        assert wrong in capsys.readouterr().err.strip().splitlines()[-1]
    with scheduler(tmp_path) as (at, _), pytest.raises(UserError, match="1 s"):
        dask_cluster(at).__enter__()


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


@pytest.mark.longest
@pytest.mark.slow
def test_something_else_that_listens_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TIMEOUT", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes the connection and says nothing
        at = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(UserError, match=f"--scheduler {at}"):
            dask_cluster(at).__enter__()

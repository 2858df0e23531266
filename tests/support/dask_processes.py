"""A Dask scheduler and its workers on loopback, each in a process of its own, and tasks for them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def process(*words: str, log: Path) -> Iterator[subprocess.Popen]:
    """A module of Dask with its options (``words``) as a process whose output goes to ``log``, killed at the end."""
    with log.open("w") as stream:
        started = subprocess.Popen(
            [sys.executable, "-m", *words], cwd=ROOT, stdout=stream, stderr=stream, start_new_session=True
        )
        try:
            yield started
        finally:
            started.kill()
            started.wait()


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[str, subprocess.Popen]]:
    """Address and process of a scheduler that listens on loopback only."""
    import json

    at = folder / "scheduler.json"
    words = ("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
    with process(*words, "--scheduler-file", str(at), log=folder / "scheduler.log") as started:
        until = time.monotonic() + 60
        while time.monotonic() < until:
            with suppress(OSError, ValueError):
                yield str(json.loads(at.read_text())["address"]), started
                return
            time.sleep(0.1)
        raise AssertionError((folder / "scheduler.log").read_text())


@contextmanager
def worker(address: str, folder: Path, name: str) -> Iterator[subprocess.Popen]:
    """A worker of the scheduler at ``address``, without a nanny, so that it stays dead when it is killed."""
    words = ("distributed.cli.dask_worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny")
    own = ("--no-dashboard", "--name", name, "--local-directory", str(folder / name))
    with process(*words, *own, log=folder / f"{name}.log") as started:
        yield started


def root_of(number: float) -> tuple[float, int]:
    """A task: the square root of a ``number``, later the smaller it is, and the process that took it."""
    time.sleep(0.3 / (1 + number))
    return float(number) ** 0.5, os.getpid()


def noted(job: tuple[int, str]) -> int:
    """A task that leaves a file in a folder each time it is begun: (number, folder) -> square of the number."""
    number, folder = job
    (Path(folder) / f"{number}_{os.getpid()}_{time.monotonic_ns()}").touch()
    time.sleep(0.25)
    return number * number


def fails(number: int) -> int:
    """A task that raises for the number 3."""
    if number == 3:
        raise ZeroDivisionError("three")
    return number

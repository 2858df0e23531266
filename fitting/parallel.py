"""Independent tasks handed to an executor: inline, or spread over processes. All use of processes is here.

Ctrl-C reaches all processes of a terminal. The children hold it back (``held_back``) except where they note it
(``fitting.solvers.interrupts``), so that none of them dies while it imports and none leaves a traceback.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""How many threads numerical libraries start, read by each when it is loaded."""


def run_all(
    function: Callable[[Task], Outcome],
    tasks: Sequence[Task],
    workers: int = 1,
    each: Callable[[Outcome], None] = lambda _: None,
) -> list[Outcome]:
    """Outcomes of ``function`` for each of ``tasks``, in order; with more than one of ``workers`` in processes.

    The function must be importable, and tasks and outcomes picklable. each: called with every outcome, in order, as
    soon as it is there. An exception of a task ends all of them and is raised.
    """
    if workers <= 1 or len(tasks) <= 1:
        return list(_reported(map(function, tasks), each))
    context, others = multiprocessing.get_context("spawn"), multiprocessing.active_children()
    most = min(workers, len(tasks))
    with _one_thread(), ProcessPoolExecutor(max_workers=most, mp_context=context, initializer=end_with_parent) as pool:
        try:
            with held_back():
                outcomes = pool.map(function, tasks)
            return list(_reported(outcomes, each))
        except BaseException:
            children = [child for child in multiprocessing.active_children() if child not in others]
            pool.shutdown(wait=False, cancel_futures=True)
            for child in children:  # what they would still do is of no use
                child.terminate()
            raise


def end_with_parent() -> None:
    """From now on this process ends when the one that started it has, in whatever way that was ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def held_back() -> Iterator[None]:
    """Ctrl-C waits until the end of this, and for good in processes started meanwhile (they inherit the mask)."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _reported(outcomes: Iterable[Outcome], each: Callable[[Outcome], None]) -> Iterator[Outcome]:
    for outcome in outcomes:
        each(outcome)
        yield outcome


@contextmanager
def _one_thread() -> Iterator[None]:
    """An environment in which processes begin with one thread each: several of them only get in each other's way."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

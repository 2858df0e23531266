"""Tasks in processes of this machine. All use of processes is here.

Ctrl-C reaches all processes of a terminal. The children hold it back (``held_back``) except where they note it
(``fitting.solvers.interrupts``), so that none of them dies while it imports and none leaves a traceback.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from fitting.parallel.threads import THREADS

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


@contextmanager
def in_processes(function: Callable[[Task], Outcome], tasks: Sequence[Task], count: int) -> Iterator[Iterator[Outcome]]:
    """Outcomes of ``function`` for each of ``tasks``, in order, from ``count`` processes that end with this context."""
    context, others = multiprocessing.get_context("spawn"), multiprocessing.active_children()
    with _one_thread(), ProcessPoolExecutor(max_workers=count, mp_context=context, initializer=end_with_parent) as pool:
        try:
            with held_back():
                outcomes = pool.map(function, tasks)
            yield outcomes
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

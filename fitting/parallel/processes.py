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
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from fitting.parallel.threads import one_thread_environment
from mmg.errors import UserError

LOST = (
    "a process that did a task was ended from outside, perhaps for want of memory; "
    "use fewer --workers or less data at once"
)

PATIENCE = 1.0
"""Seconds within which the threads of a pool see that its processes have ended."""


class ProcessCrew:
    """An executor on processes of this machine.

    pool: of them; width: how many.
    """

    def __init__(self, pool: ProcessPoolExecutor, width: int) -> None:
        self.pool, self.width = pool, width

    def outcomes(
        self, function: Callable[[Any], Any], tasks: Sequence[Any], finished: Callable[[], None] = lambda: None
    ) -> Iterator[Any]:
        """As of ``Executor``. Raises UserError where a process is ended from outside."""
        with held_back():
            futures = [self.pool.submit(function, task) for task in tasks]
        at = {future: number for number, future in enumerate(futures)}
        done: dict[int, Any] = {}
        following = as_completed(futures)
        del futures
        try:
            for number in range(len(tasks)):
                while number not in done:
                    future = next(following)
                    done[at.pop(future)] = future.result()
                    finished()
                yield done.pop(number)
        except BrokenProcessPool:
            raise UserError(LOST) from None
        finally:
            for future in at:
                future.cancel()


@contextmanager
def process_crew(count: int) -> Iterator[ProcessCrew]:
    """At most ``count`` processes, as many as there is memory for, that do tasks and end with this context."""
    from fitting.parallel.memory import affordable

    count = affordable(count)
    context, others, before = multiprocessing.get_context("spawn"), multiprocessing.active_children(), _managers()
    with (
        one_thread_environment(),
        ProcessPoolExecutor(max_workers=count, mp_context=context, initializer=end_with_parent) as pool,
    ):
        try:
            yield ProcessCrew(pool, count)
        except BaseException:
            children = [child for child in multiprocessing.active_children() if child not in others]
            pool.shutdown(wait=False, cancel_futures=True)
            _end(children, before)  # what they would still do is of no use
            raise


@contextmanager
def helper(prepare: Callable[[], object]) -> Iterator[Executor]:
    """A process beside this one that does what is submitted to it, in order, and ends with this context.

    prepare: done there first, at once.
    """
    context, others, before = multiprocessing.get_context("spawn"), multiprocessing.active_children(), _managers()
    with ProcessPoolExecutor(max_workers=1, mp_context=context, initializer=end_with_parent) as pool:
        with one_thread_environment(), held_back():
            pool.submit(prepare)
        own = [child for child in multiprocessing.active_children() if child not in others]
        try:
            yield pool
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            _end(own, before)  # all that was wanted of it is there


def _managers() -> set[threading.Thread]:
    """The threads that watch the processes of the pools of this process."""
    return {thread for thread in threading.enumerate() if type(thread).__module__ == ProcessPoolExecutor.__module__}


def _end(children: Sequence[multiprocessing.process.BaseProcess], before: set[threading.Thread]) -> None:
    """End the ``children`` of a pool that was shut down without waiting, and wait for the threads that watch them.

    before: threads of other pools. One that still closes its pipe while the interpreter ends makes that one complain
    (that of CPython 3.11 writes to the pipe then, without the pool's lock).
    """
    for child in children:
        child.terminate()
    for thread in _managers() - before:
        thread.join(PATIENCE)


def cores() -> int:
    """How many processors this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


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

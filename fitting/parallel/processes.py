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
    context, others = multiprocessing.get_context("spawn"), multiprocessing.active_children()
    with (
        one_thread_environment(),
        ProcessPoolExecutor(max_workers=count, mp_context=context, initializer=end_with_parent) as pool,
    ):
        try:
            yield ProcessCrew(pool, count)
        except BaseException:
            children = [child for child in multiprocessing.active_children() if child not in others]
            pool.shutdown(wait=False, cancel_futures=True)
            for child in children:  # what they would still do is of no use
                child.terminate()
            raise


@contextmanager
def helper(prepare: Callable[[], object]) -> Iterator[Executor]:
    """A process beside this one that does what is submitted to it, in order, and ends with this context.

    prepare: done there first, at once.
    """
    context, others = multiprocessing.get_context("spawn"), multiprocessing.active_children()
    with ProcessPoolExecutor(max_workers=1, mp_context=context, initializer=end_with_parent) as pool:
        with one_thread_environment(), held_back():
            pool.submit(prepare)
        own = [child for child in multiprocessing.active_children() if child not in others]
        try:
            yield pool
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in own:  # all that was wanted of it is there
                child.terminate()


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

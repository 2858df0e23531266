"""One process beside this one, which does work that nothing waits for yet, while this one goes on.

What it cannot do, for whatever reason, is done by this process when its value is asked for, which then also raises what
the work raises. The values are the same, bit for bit, wherever they come from.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import Any, Generic, TypeVar

from fitting.parallel.executors import executing, in_force
from fitting.parallel.memory import room_for
from fitting.parallel.processes import cores, helper

Value = TypeVar("Value")
Item = TypeVar("Item")


class Awaited(Generic[Value]):
    """The value of ``work``: begun by the ``process`` beside this one, or still to be done here (None)."""

    def __init__(self, work: Callable[[], Value], process: ProcessBeside | None = None) -> None:
        self.work, self.process = work, process
        self.there: Future[Value] = Future()
        self._made: tuple[Value] | None = None

    @property
    def value(self) -> Value:
        """The value, made here where the other process could not or has not begun. Raises what the work raises."""
        if self._made is None:
            self._made = (self._from_there(),)
        return self._made[0]

    def _from_there(self) -> Value:
        if self.process is None or self.process.taken_back(self):
            return self.work()
        try:
            return self.there.result()
        except Exception:
            return self.work()


class ProcessBeside:
    """The process beside this one, which does one work after the other; executor: of that process.

    It is given the next work when it has done the one before, so that what it has not begun can be taken back.
    """

    def __init__(self, executor: Executor) -> None:
        self.executor = executor
        self._waiting: deque[Awaited[Any]] = deque()
        self._busy = self._ended = False
        self._lock = threading.Lock()

    def begin(self, work: Callable[[], Value]) -> Awaited[Value]:
        """What ``work`` gives, which must be picklable like it, done beside this process in its turn. Raises
        RuntimeError where the process has ended."""
        one = Awaited(work, self)
        with self._lock:
            self._waiting.append(one)
        self._go_on()
        if self._ended:
            raise RuntimeError("the process beside has ended")
        return one

    @property
    def idle(self) -> bool:
        """Whether it has nothing to do."""
        with self._lock:
            return not self._busy and not self._waiting

    def taken_back(self, one: Awaited[Any]) -> bool:
        """Whether ``one`` had not been begun, and now never will be."""
        with self._lock:
            if one in self._waiting:
                self._waiting.remove(one)
                return True
            return False

    def _go_on(self) -> None:
        with self._lock:
            if self._busy or not self._waiting:
                return
            one, self._busy = self._waiting.popleft(), True
        try:
            future = self.executor.submit(one.work)
        except RuntimeError as error:
            self._end(one, error)
        else:
            future.add_done_callback(partial(self._done, one))

    def _done(self, one: Awaited[Any], future: Future[Any]) -> None:
        error = CancelledError() if future.cancelled() else future.exception()
        if isinstance(error, CancelledError | BrokenExecutor):
            self._end(one, error)  # nothing is submitted from here: the executor holds its locks
            return
        if error is None:
            one.there.set_result(future.result())
        else:
            one.there.set_exception(error)
        with self._lock:
            self._busy = False
        self._go_on()

    def _end(self, one: Awaited[Any], error: BaseException) -> None:
        """From now on all is done in this process."""
        with self._lock:
            left, self._ended = [one, *self._waiting], True
            self._waiting.clear()
        for each in left:
            each.there.set_exception(error)


def begun_beside(process: ProcessBeside | None, work: Callable[[], Value]) -> Awaited[Value]:
    """What ``work`` gives, begun by the ``process`` where there is one that takes it, else done when asked for."""
    if process is not None:
        try:
            return process.begin(work)
        except RuntimeError:  # it has ended
            pass
    return Awaited(work)


def spread_beside(
    process: ProcessBeside | None, function: Callable[[Item], Value], items: Sequence[Item]
) -> list[Value]:
    """Outcomes of ``function``, which must be picklable, for each of ``items``, in order: the ``process`` begins at the
    last one and this one at the first, until they meet. Raises what one raises."""
    begun = [begun_beside(process, partial(function, item)) for item in reversed(items)]
    return [one.value for one in reversed(begun)]


@contextmanager
def process_beside(prepare: Callable[[], object]) -> Iterator[ProcessBeside | None]:
    """A process that ends with this context; None where there is but one core. prepare: what it does first."""
    if cores() < 2:
        yield None
        return
    with helper(int) as executor:
        process = ProcessBeside(executor)
        begun_beside(process, prepare)  # until it has loaded that, it has begun nothing
        yield process


class BothProcesses:
    """An executor: this process and the one beside it. The one begins at the first task, the other at the last."""

    width = 2

    def __init__(self, process: ProcessBeside) -> None:
        self.process = process

    def outcomes(
        self, function: Callable[[Any], Any], tasks: Sequence[Any], finished: Callable[[], None] = lambda: None
    ) -> Iterator[Any]:
        """As of ``Executor``; ``finished`` is called in the order of the ``tasks`` of the ``function``."""
        begun = [begun_beside(self.process, partial(function, task)) for task in reversed(tasks)]
        try:
            while begun:
                yield begun.pop().value
                finished()
        finally:
            for one in begun:  # those that an error left behind
                self.process.taken_back(one)


@contextmanager
def both_processes(prepare: Callable[[], object]) -> Iterator[ProcessBeside | None]:
    """Within this, ``run_all`` shares its tasks between this process and one beside it, whatever ``workers`` are asked
    for: where there is a second core, and memory for two. prepare: what the other does first. Yields that, or None."""
    with process_beside(prepare) if room_for(2) > 1 else nullcontext() as process:
        if process is None:
            yield None
            return
        with executing(BothProcesses(process)):
            yield process


def helping() -> ProcessBeside | None:
    """The process beside this one where both do the tasks (``both_processes``), else None."""
    executor = in_force()
    return executor.process if isinstance(executor, BothProcesses) else None


def evaluated_beside(work: Callable[[], Value]) -> Awaited[Value]:
    """What ``work`` gives, which must be picklable like it: begun by the process beside this one where both do the
    tasks (``both_processes``), else done when asked for."""
    return begun_beside(helping(), work)

"""One process beside this one, which does work that nothing waits for yet, while this one goes on.

What it cannot do, for whatever reason, is done by this process when its value is asked for, which then also raises what
the work raises. The values are the same, bit for bit, wherever they come from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Generic, TypeVar

from fitting.parallel.processes import cores, helper

Value = TypeVar("Value")


class Awaited(Generic[Value]):
    """The value of ``work``: begun beside this process (``future``), or still to be done here (None)."""

    def __init__(self, work: Callable[[], Value], future: Future[Value] | None = None) -> None:
        self.work, self.future = work, future
        self._made: tuple[Value] | None = None

    @property
    def value(self) -> Value:
        """The value, made here where the other process could not or has not begun. Raises what the work raises."""
        if self._made is None:
            self._made = (self._from_there(),)
        return self._made[0]

    def _from_there(self) -> Value:
        if self.future is None or self.future.cancel():
            return self.work()
        try:
            return self.future.result()
        except Exception:
            return self.work()


class ProcessBeside:
    """The process beside this one; executor: its queue, in whose order it works."""

    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def begin(self, work: Callable[[], Value]) -> Awaited[Value]:
        """What ``work`` gives, which must be picklable like it, done beside this process. Raises RuntimeError where the
        process has ended."""
        return Awaited(work, self.executor.submit(work))


def begun_beside(process: ProcessBeside | None, work: Callable[[], Value]) -> Awaited[Value]:
    """What ``work`` gives, begun by the ``process`` where there is one that takes it, else done when asked for."""
    if process is not None:
        try:
            return process.begin(work)
        except RuntimeError:  # it has ended
            pass
    return Awaited(work)


@contextmanager
def process_beside(prepare: Callable[[], None]) -> Iterator[ProcessBeside | None]:
    """A process that ends with this context; None where there is but one core. prepare: what it does first."""
    if cores() < 2:
        yield None
        return
    with helper(prepare) as executor:
        yield ProcessBeside(executor)

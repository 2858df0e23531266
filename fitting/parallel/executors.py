"""Which executor does a list of independent tasks, and what all executors have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol, TypeVar

from fitting.parallel.processes import in_processes

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


class Executor(Protocol):
    """What does tasks beside this process."""

    @property
    def width(self) -> int:
        """How many tasks it does at a time."""

    def outcomes(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
        """Outcomes of ``function`` for each of ``tasks``, in their order, each as soon as those before it are there.

        Raises what a task raises; what is left of the others is then not done.
        """


_EXECUTOR: ContextVar[Executor | None] = ContextVar("executor", default=None)


@contextmanager
def executing(executor: Executor) -> Iterator[None]:
    """Within this, ``run_all`` hands its tasks to the ``executor``."""
    before = _EXECUTOR.set(executor)
    try:
        yield
    finally:
        _EXECUTOR.reset(before)


def width(workers: int) -> int:
    """How many tasks ``run_all`` does at a time when it is given so many ``workers``."""
    executor = _EXECUTOR.get()
    return executor.width if executor else workers


def run_all(
    function: Callable[[Task], Outcome],
    tasks: Sequence[Task],
    workers: int = 1,
    each: Callable[[Outcome], None] = lambda _: None,
) -> list[Outcome]:
    """Outcomes of ``function`` for each of ``tasks``, in order.

    They are done by the executor in force (``executing``); without one in this process, or in as many processes as
    there are ``workers`` when that is more than one. The function must be importable, and tasks and outcomes picklable.
    each: called with every outcome, in order, as soon as it is there. An exception of a task ends all of them and is
    raised.
    """
    executor = _EXECUTOR.get()
    if executor is not None and len(tasks):
        return list(_reported(executor.outcomes(function, tasks), each))
    if workers <= 1 or len(tasks) <= 1:
        return list(_reported(map(function, tasks), each))
    with in_processes(function, tasks, min(workers, len(tasks))) as outcomes:
        return list(_reported(outcomes, each))


def _reported(outcomes: Iterable[Outcome], each: Callable[[Outcome], None]) -> Iterator[Outcome]:
    for outcome in outcomes:
        each(outcome)
        yield outcome

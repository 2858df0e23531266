"""Which executor does a list of independent tasks, and what all executors have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol, TypeVar

from fitting.parallel.processes import process_crew
from mmg.progress import OnProgress, Progress

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
Finished = Callable[[], None]


class Executor(Protocol):
    """What does tasks beside this process."""

    @property
    def width(self) -> int:
        """How many tasks it does at a time."""

    def outcomes(
        self, function: Callable[[Any], Any], tasks: Sequence[Any], finished: Finished = lambda: None
    ) -> Iterator[Any]:
        """Outcomes of ``function`` for each of ``tasks``, in their order, each as soon as those before it are there.

        finished: called after each task, in the order in which they finish. Raises what a task raises; what is left of
        the others is then not done.
        """


_EXECUTOR: ContextVar[Executor | None] = ContextVar("executor", default=None)
_LISTENER: ContextVar[OnProgress | None] = ContextVar("listener", default=None)


@contextmanager
def executing(executor: Executor) -> Iterator[None]:
    """Within this, ``run_all`` hands its tasks to the ``executor``."""
    before = _EXECUTOR.set(executor)
    try:
        yield
    finally:
        _EXECUTOR.reset(before)


@contextmanager
def listening(listener: OnProgress | None) -> Iterator[None]:
    """Within this, the ``listener`` is told how many tasks of each list with a name are done, whoever does them."""
    before = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(before)


@contextmanager
def kept_workers(workers: int) -> Iterator[None]:
    """Within this, the processes that ``run_all`` starts serve all its calls: for lists that follow each other closely,
    such as the generations of a search. ``workers``: of them; nothing changes with one, or where an executor is in
    force."""
    if _EXECUTOR.get() is not None or workers <= 1:
        yield
        return
    with process_crew(workers) as crew, executing(crew):
        yield


def in_force() -> Executor | None:
    """The executor that ``run_all`` hands its tasks to; None where there is none."""
    return _EXECUTOR.get()


def width(workers: int) -> int:
    """How many tasks ``run_all`` does at a time when it is given so many ``workers``."""
    executor = _EXECUTOR.get()
    return executor.width if executor else workers


def run_all(
    function: Callable[[Task], Outcome],
    tasks: Sequence[Task],
    workers: int = 1,
    each: Callable[[Outcome], None] = lambda _: None,
    name: str = "",
) -> list[Outcome]:
    """Outcomes of ``function`` for each of ``tasks``, in order.

    They are done by the executor in force (``executing``); without one in this process, or in as many processes as
    there are ``workers`` when that is more than one. The function must be importable, and tasks and outcomes picklable.
    each: called with every outcome, in order, as soon as it is there; name: of the tasks for the listener
    (``listening``), which is told of each as it finishes. An exception of a task ends all of them and is raised.
    """
    executor, finished = _EXECUTOR.get(), _counted(name, len(tasks))
    if executor is not None and len(tasks):
        return list(_reported(executor.outcomes(function, tasks, finished), each))
    if workers <= 1 or len(tasks) <= 1:
        return list(_reported(_inline(function, tasks, finished), each))
    with process_crew(min(workers, len(tasks))) as crew:
        return list(_reported(crew.outcomes(function, tasks, finished), each))


def _inline(function: Callable[[Task], Outcome], tasks: Iterable[Task], finished: Finished) -> Iterator[Outcome]:
    for task in tasks:
        outcome = function(task)
        finished()
        yield outcome


def _counted(name: str, count: int) -> Finished:
    """What tells the listener that one more of ``count`` tasks of this ``name`` is done."""
    listener, done = _LISTENER.get(), 0
    if listener is None or not name:
        return lambda: None

    def finished() -> None:
        nonlocal done
        done += 1
        listener(Progress(name, done, count))

    return finished


def _reported(outcomes: Iterable[Outcome], each: Callable[[Outcome], None]) -> Iterator[Outcome]:
    for outcome in outcomes:
        each(outcome)
        yield outcome

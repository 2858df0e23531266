"""Lists of independent tasks, done in this process, in processes of this machine or by another executor.

A process of the pool has one thread, ends with its parent, and there are no more of them than there is memory for.
Ctrl-C reaches all processes of a terminal: those of the pool hold it back, except where they note it
(``fitting.solvers.control``), so that none of them dies while it imports and none leaves a traceback.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import itertools
import multiprocessing
import os
import pickle
import signal
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

from mmg.errors import ProgramFailed
from mmg.messages import LOGGER, OnProgress, Progress

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
Value = TypeVar("Value")
P = ParamSpec("P")
R = TypeVar("R")

# Tasks handed over for each worker: one that it does, and one that waits there. Set by hand: more only take memory.
AHEAD = 2
SIGNALS_SEEN = 1.0  # How long a wait may keep signals unanswered [s]. Set by hand: within the two seconds of an answer.
KEPT = 4  # Shared values that a process keeps. Set by hand: it bounds memory.
PROCESS = 300e6  # Least memory of a process that fits or trains [bytes]: its libraries and a few trials. Set by hand.
# How many threads numerical libraries start, read by each when it is loaded.
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# Of ``mallopt`` (malloc.h) [bytes]: M_TRIM_THRESHOLD, from how much unused memory on some is given back; M_TOP_PAD, how
# much is asked for beyond what is needed; M_MMAP_THRESHOLD, from which size on an array has pages of its own.
MALLOPT = {-1: 256 * 2**20, -2: 32 * 2**20, -3: 32 * 2**20}
MEMINFO, CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")  # of Linux; no limit is known elsewhere


class Workers(Protocol):
    """An executor of ``concurrent.futures``, and what ``run_all`` must know of it."""

    @property
    def width(self) -> int:
        """How many tasks it does at a time."""

    def submit(self, function: Callable[[Any], Any], task: Any) -> Future[Any]:
        """The outcome of ``function`` of a ``task``, to come."""

    def explained(self, error: BaseException) -> BaseException:
        """What to raise for an ``error`` of a task: a UserError where the executor itself failed."""


# Not global: a thread has its own.
_WORKERS: ContextVar[Workers | None] = ContextVar("workers", default=None)
_LISTENER: ContextVar[OnProgress | None] = ContextVar("listener", default=None)


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
    each: called with every outcome, in order, as soon as it and those before it are there; name: of the tasks for the
    listener (``listening``), which is told of each as it finishes. An exception of a task ends all of them and is
    raised; UserError where a process is ended from outside.
    """
    there, listener, numbers, outcomes = _WORKERS.get(), _LISTENER.get(), itertools.count(1), list[Outcome]()

    def finished() -> None:
        if listener and name:
            listener(Progress(name, next(numbers), len(tasks)))

    alone = there is None and min(workers, len(tasks)) <= 1
    with nullcontext(there) if there or alone else _processes(min(workers, len(tasks))) as crew:
        for outcome in _handed_over(crew, function, tasks, finished) if crew else map(function, tasks):
            if not crew:
                finished()
            each(outcome)
            outcomes.append(outcome)
    return outcomes


def width(workers: int) -> int:
    """How many tasks ``run_all`` does at a time when it is given so many ``workers``."""
    there = _WORKERS.get()
    return there.width if there else workers


@contextmanager
def _in_force(variable: ContextVar[Value], value: Value) -> Iterator[None]:
    before = variable.set(value)
    try:
        yield
    finally:
        variable.reset(before)


def executing(workers: Workers) -> AbstractContextManager[None]:
    """Within this, ``run_all`` hands its tasks to these ``workers``."""
    return _in_force(_WORKERS, workers)


@contextmanager
def kept_workers(workers: int) -> Iterator[None]:
    """Within this, the processes that ``run_all`` starts serve all its calls: for lists that follow each other closely,
    such as the generations of a search. ``workers``: of them; with one, or an executor in force, nothing changes."""
    if _WORKERS.get() is not None or workers <= 1:
        yield
        return
    with _processes(workers) as crew, executing(crew):
        yield


def listening(listener: OnProgress | None) -> AbstractContextManager[None]:
    """Within this, the ``listener`` is told how many tasks of each list with a name are done, whoever does them."""
    return _in_force(_LISTENER, listener)


def _handed_over(
    workers: Workers, function: Callable[[Any], Any], tasks: Sequence[Any], finished: Callable[[], None]
) -> Iterator[Any]:
    """Outcomes of the ``tasks``, in their order, each as soon as those before it are there."""
    # done: by number, until those before it are
    waiting, running, done = iter(enumerate(tasks)), dict[Future[Any], int](), dict[int, Any]()
    try:
        for number in range(len(tasks)):
            while number not in done:
                for i, task in itertools.islice(waiting, max(0, AHEAD * workers.width - len(running))):
                    running[workers.submit(function, task)] = i
                # a limit, as a lock without one answers no signal on Windows, nor one that another thread was given
                for future in wait(running, SIGNALS_SEEN, FIRST_COMPLETED).done:
                    done[running.pop(future)] = future.result()
                    finished()
            yield done.pop(number)
    except BaseException as error:
        reason = workers.explained(error)
        if reason is error:
            raise
        raise reason from None
    finally:
        for future in running:
            future.cancel()


class _Processes:
    """Processes of this machine. pool: of them; width: how many."""

    def __init__(self, pool: ProcessPoolExecutor, width: int) -> None:
        self.pool, self.width = pool, width

    def submit(self, function: Callable[[Any], Any], task: Any) -> Future[Any]:
        with _held_back():  # the pool starts processes as tasks come
            return self.pool.submit(function, task)

    def explained(self, error: BaseException) -> BaseException:
        if not isinstance(error, BrokenProcessPool):
            return error
        why = "a process that did a task was ended from outside, perhaps for want of memory"
        return ProgramFailed(f"{why}; use fewer --workers or less data at once")


@contextmanager
def _processes(count: int) -> Iterator[_Processes]:
    """At most ``count`` processes, as many as there is memory for, that do tasks and end with this context."""
    count, others = affordable(count), multiprocessing.active_children()
    context = multiprocessing.get_context("spawn")  # the same on all systems, and no locks of threads are copied
    with _one_thread_environment(), ProcessPoolExecutor(count, context, initializer=_end_with_parent) as pool:
        try:
            yield _Processes(pool, count)
        except BaseException:
            for child in multiprocessing.active_children():
                if child not in others:
                    child.terminate()  # what it would still do is of no use
            pool.shutdown(cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """From now on this process ends when the one that started it has, in whatever way that was ended."""

    def end_after(parent: Any) -> None:
        parent.join()
        os._exit(1)  # from a thread; sys.exit would end that alone

    threading.Thread(target=end_after, args=(multiprocessing.parent_process(),), daemon=True).start()


@contextmanager
def _held_back() -> Iterator[None]:
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
def _one_thread_environment() -> Iterator[None]:
    """An environment in which processes begin with one thread each: several only get in each other's way."""
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


@functools.cache
def keep_freed_memory() -> bool:
    """From now on this process keeps the memory that large arrays leave for the next ones; says whether it can: only
    with glibc, which gives it back to the system by default, where each page is cleared before it is handed out again:
    a twelfth of the processor time of a fit."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library, or (TypeError) Windows
        return False
    return all([mallopt(name, value) for name, value in MALLOPT.items()])  # a list: all of them are set


def with_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The ``function`` with one thread in the libraries of linear algebra while it runs, and as before afterwards; it
    keeps the memory of large arrays (``keep_freed_memory``).

    The command sets this by its environment before anything is loaded. From Python numpy is there already, and its
    threads wait for each other over matrices that are far too small for them: a fit took four to six times the
    processor time. Sums of several threads also differ in their last bits from those of one.
    """

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        keep_freed_memory()
        if all(os.environ.get(name) == "1" for name in THREADS):
            return function(*args, **kwargs)
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):
            return function(*args, **kwargs)

    return run


def affordable(count: int) -> int:
    """How many of ``count`` processes there is memory for, one at least; says where they are fewer.

    A process is taken to need what this one holds, which has the same libraries and the trials, and PROCESS at least.
    """
    free, need = free_memory(), PROCESS
    with suppress(OSError, ValueError, IndexError):
        pages = int(Path("/proc/self/statm").read_text().split()[1])  # its second number: resident pages (proc(5))
        need = max(need, float(pages * os.sysconf("SC_PAGE_SIZE")))
    fits = max(1, int(min(free / need, count)))
    if fits < count:
        words = f"{free / 1e6:.0f} MB of memory are free, and each takes about {need / 1e6:.0f} MB"
        LOGGER.warning("%d process(es) instead of %d: %s", fits, count, words)
    return fits


def free_memory() -> float:
    """Memory that processes may still take [bytes], of machine or control group, the lesser; infinite: unknown."""
    limits = [float("inf")]
    with suppress(OSError, ValueError, IndexError):
        rows = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines() if ":" in line)
        limits.append(1024.0 * float(rows["MemAvailable"].split()[0]))  # of kB
    with suppress(OSError, ValueError, KeyError):
        limit, used = ((CGROUP / f"memory.{name}").read_text().strip() for name in ("max", "current"))
        rows = dict(line.split() for line in (CGROUP / "memory.stat").read_text().splitlines())
        limits.append(float(limit) - float(used) + float(rows["inactive_file"]))  # "max" is no number: no limit
    return max(min(limits), 0.0)


_OPENED: OrderedDict[str, Any] = OrderedDict()  # Values of ``Shared`` by their hash, the oldest first


class Shared(Generic[Value]):
    """A ``value`` that many tasks need, such as a model with its trials: it travels with each of them, and is unpickled
    by the first one in each process.

    In the process that made it ``value`` is the same object. It must not be changed by tasks.
    """

    def __init__(self, value: Value) -> None:
        self._original: Value | None = value
        self._data, self._key = b"", ""  # made when it is first sent: nothing is pickled in a single process

    def __getstate__(self) -> dict[str, Any]:
        if not self._key:
            self._data = pickle.dumps(self._original)
            self._key = hashlib.sha256(self._data).hexdigest()
        return {"_data": self._data, "_key": self._key, "_original": None}

    @property
    def value(self) -> Value:
        """The value, made once in this process."""
        if self._original is None:
            if self._key not in _OPENED:
                _OPENED[self._key] = pickle.loads(self._data)  # of our own tasks, never of files
                while len(_OPENED) > KEPT:
                    _OPENED.popitem(last=False)
            self._original = _OPENED[self._key]
        return self._original

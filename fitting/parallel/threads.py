"""One thread per process for the libraries of linear algebra, also where a program has loaded them before.

The command sets this by its environment before anything is loaded. From Python numpy is there already, and its threads
wait for each other over matrices that are far too small for them: a fit took four to six times the processor time.
Sums of several threads also differ in their last bits from those of one.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""How many threads numerical libraries start, read by each when it is loaded."""


@contextmanager
def one_thread_environment() -> Iterator[None]:
    """An environment in which libraries and processes begin with one thread each: several of them only get in each
    other's way."""
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


def with_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The ``function`` with one thread in the libraries of linear algebra while it runs, and as before afterwards."""

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        if all(os.environ.get(name) == "1" for name in THREADS):
            return function(*args, **kwargs)
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):
            return function(*args, **kwargs)

    return run

"""How many threads calculate shooting intervals: one, unless more are asked for or processors are idle."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mmg.errors import UserError

_IDLE: list[Callable[[], int]] = []


@contextmanager
def idle_processors(count: Callable[[], int]) -> Iterator[None]:
    """Within this, intervals are calculated by a thread more for each processor that, by ``count``, is idle then:
    another process of the same command, say, that has nothing to do. It does not change a bit of the numbers."""
    _IDLE.append(count)
    try:
        yield
    finally:
        _IDLE.remove(count)


def kernel_threads() -> int:
    """Threads that calculate intervals: MMG_THREADS, but not more than there are processors; where it is not set, 1
    and those of ``idle_processors``.

    Raises UserError where it is no positive number.
    """
    asked = os.environ.get("MMG_THREADS") or str(1 + sum(count() for count in _IDLE))
    if not asked.isdecimal() or int(asked) < 1:
        raise UserError(f"MMG_THREADS={asked}: not a number of threads; set it to 1 or more")
    return min(int(asked), os.cpu_count() or 1)

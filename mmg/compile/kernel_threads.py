"""Threads of compiled loops over intervals, windows or simulated points: one, unless MMG_THREADS asks for more.

Compiled code lets the interpreter go on meanwhile. What each of these gives does not depend on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import pairwise

from mmg.errors import BadValue


def kernel_threads() -> int:
    """Threads of a compiled loop: MMG_THREADS (default 1), but not more than there are processors.

    Raises UserError where it is no positive number.
    """
    asked = os.environ.get("MMG_THREADS") or "1"
    if not asked.isdecimal() or int(asked) < 1:
        raise BadValue(f"MMG_THREADS={asked}: not a number of threads; set it to 1 or more")
    return min(int(asked), os.cpu_count() or 1)


def in_threads(work: Callable[[int, int], int], shares: Sequence[tuple[int, int]], threads: int | None = None) -> int:
    """The largest of what ``work`` returns for each of the ``shares``, which follow each other, by their first and last
    number: in as many threads as are allowed, or in ``threads`` of them, this one among them. None of the others goes
    on after this, also where Ctrl-C is pressed: the arrays that they write into would be gone."""
    threads = min(threads or kernel_threads(), len(shares))
    if threads <= 1:
        return work(shares[0][0], shares[-1][1])
    begun = [_pool(threads - 1).submit(work, *share) for share in shares[1:]]
    failed: BaseException | None = None
    own = 0
    try:
        own = work(*shares[0])
    except BaseException as one:
        failed = one
    while not all(other.done() for other in begun):
        try:
            wait(begun)
        except KeyboardInterrupt as one:
            failed = one
    if failed:
        raise failed
    return max([own, *(other.result() for other in begun)])


def even_shares(count: int, threads: int | None = None) -> list[tuple[int, int]]:
    """Shares of about the same size of ``count`` things, one for each thread, of which there are as many as allowed, or
    ``threads``."""
    parts = max(1, min(threads or kernel_threads(), count))
    borders = [count * i // parts for i in range(parts + 1)]
    return list(pairwise(borders))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="kernel")

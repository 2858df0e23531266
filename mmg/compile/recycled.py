"""Large arrays in memory that earlier ones have left.

The system clears the pages of each new array before it hands them out, and takes them back when the array goes. Where
the same large arrays are made again and again, that takes longer than to fill them.
"""

from __future__ import annotations

import ctypes
import sys
from math import prod
from threading import Lock

import numpy as np

LEAST = 1 << 17
"""Numbers from which an array is worth it: smaller ones the allocator keeps by itself."""
MOST = 1 << 27
"""Numbers that are kept at most, a gigabyte."""
_kept: list[np.ndarray] = []
_lock = Lock()


def room(*shape: int) -> np.ndarray:
    """An array (m, n, ...) of this ``shape`` for numbers, whose content is what happened to be there.

    It is the caller's as long as anything refers to it or to a part of it.
    """
    size = prod(shape)
    if size < LEAST:
        return np.empty(shape)
    with _lock:
        for i, count in enumerate(_references(_kept)):
            if count == _ALONE and _kept[i].size == size:
                return _kept[i].reshape(shape)
        while _kept and kept() + size > MOST:  # unused ones first
            del _kept[min(range(len(_kept)), key=_references(_kept).__getitem__)]
        _kept.append(np.empty(size))
        return _kept[-1].reshape(shape)


def cleared(*shape: int) -> np.ndarray:
    """An array (m, n, ...) of this ``shape`` of zeros."""
    if prod(shape) < LEAST:
        return np.zeros(shape)
    found = room(*shape)
    ctypes.memset(found.ctypes.data, 0, found.nbytes)  # in half the time of numpy's own
    return found


def kept() -> int:
    """How many numbers there is memory for."""
    return sum(each.size for each in _kept)


def forget() -> None:
    """Give back what nobody holds."""
    with _lock:
        _kept.clear()


def _references(kept: list[np.ndarray]) -> list[int]:
    """How many references there are to each of those that are ``kept``."""
    return [sys.getrefcount(each) for each in kept]


_ALONE = _references([np.empty(0)])[0]
"""That of one to which nothing refers but the list."""

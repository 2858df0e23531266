"""Memory that large arrays leave, kept for the next ones.

By default glibc gives it back to the system, which clears each page again before it hands it out: a sixteenth of the
processor time of a fit, and half that of the filter's covariances.
"""

from __future__ import annotations

import ctypes
from functools import cache

MIB = 2**20
SETTINGS = {-1: 256 * MIB, -2: 32 * MIB, -3: 32 * MIB}
"""Of ``mallopt`` (malloc.h) [bytes]: M_TRIM_THRESHOLD, from how much unused memory on some is given back; M_TOP_PAD,
how much is asked for beyond what is needed; M_MMAP_THRESHOLD, from which size on an array has pages of its own (its
largest value)."""


@cache
def keep_freed_memory() -> bool:
    """From now on this process keeps the memory that large arrays leave; says whether it can: only with glibc."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return False
    return all([mallopt(name, value) for name, value in SETTINGS.items()])

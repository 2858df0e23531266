"""Locks that end with the process that holds them, however it ends: of fcntl on POSIX, of msvcrt on Windows."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]
try:
    import msvcrt
except ImportError:  # POSIX
    msvcrt = None  # type: ignore[assignment]

HELD = (BlockingIOError, PermissionError)
"""What the operating systems raise where another process has the lock."""


@contextlib.contextmanager
def alone(mark: Path) -> Iterator[bool]:
    """While it lasts, no other process gets True for the file ``mark``, which is made, and removed at the end.

    Yields False where another one has it. A file system that knows no locks keeps nobody out. Raises OSError where
    the file cannot be made.
    """
    while True:
        handle = os.open(mark, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            mine = _taken(handle)
            there = not mine or _same(handle, mark)
        except BaseException:
            os.close(handle)
            raise
        if there:
            break
        os.close(handle)  # its last owner removed it in between
    try:
        yield mine
    finally:
        if mine and fcntl:
            with contextlib.suppress(OSError):
                mark.unlink()  # while it is ours
        os.close(handle)
        if mine and not fcntl:
            with contextlib.suppress(OSError):
                mark.unlink()  # Windows removes no open file; fails where another process has opened it by now


def _taken(handle: int) -> bool:
    """Whether this process has the lock of the open file ``handle`` now."""
    try:
        if fcntl:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif msvcrt:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except HELD:
        return False
    except OSError:
        return True  # no locks there
    return True


def _same(handle: int, mark: Path) -> bool:
    """Whether the open file ``handle`` is still the one called ``mark``."""
    try:
        return os.path.samestat(os.fstat(handle), mark.stat())
    except OSError:
        return False

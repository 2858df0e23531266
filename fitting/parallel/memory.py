"""Memory of this machine, and how many processes there is room for."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mmg.progress import LOGGER

PROCESS = 300e6
"""Least memory of a process that fits or trains [bytes]: its libraries and a few trials."""

MEMINFO, CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def free_memory() -> float:
    """Memory that processes may still take [bytes], the lesser of the machine's and the control group's; infinite where
    it is not known."""
    found = [float("inf")]
    with suppress(OSError, ValueError, IndexError):
        rows = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines() if ":" in line)
        found.append(1024.0 * float(rows["MemAvailable"].split()[0]))
    with suppress(OSError, ValueError, KeyError):
        limit, used = ((CGROUP / f"memory.{name}").read_text().strip() for name in ("max", "current"))
        rows = dict(line.split() for line in (CGROUP / "memory.stat").read_text().splitlines())
        found.append(float(limit) - float(used) + float(rows["inactive_file"]))  # "max" is no number: no limit
    return max(min(found), 0.0)


def own_memory() -> float:
    """Memory that this process holds [bytes], 0 where it is not known."""
    with suppress(OSError, ValueError, IndexError):
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return float(pages * os.sysconf("SC_PAGE_SIZE"))
    return 0.0


def room_for(count: int) -> int:
    """How many of ``count`` processes there is memory for, one at least.

    A process is taken to need what this one holds, which has the same libraries and the trials, and PROCESS at least.
    """
    return max(1, min(count, int(min(free_memory() / max(own_memory(), PROCESS), count))))


def affordable(count: int) -> int:
    """``room_for`` so many processes that were asked for (``count``); says where they are fewer."""
    fits = room_for(count)
    if fits < count:
        each, free = max(own_memory(), PROCESS), free_memory()
        words = f"{free / 1e6:.0f} MB of memory are free, and each takes about {each / 1e6:.0f} MB"
        LOGGER.warning("%d process(es) instead of %d: %s", fits, count, words)
    return fits

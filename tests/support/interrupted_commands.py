"""Commands that get Ctrl-C with all their processes, and what is left of these."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path


def interrupted(arguments: list[str], seconds: float) -> tuple[int, str, list[int]]:
    """Exit code, words and processes left of a command that gets Ctrl-C, with all its processes, after a while.

    The while is of processor time: on a busy machine an interpreter may need long for its first steps."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mmg_ident.commands.main", *arguments],
        stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2], start_new_session=True,
    )  # fmt: skip
    while process.poll() is None and processor_time(process.pid) < seconds:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, words = process.communicate(timeout=60)
    left = still_there(process.pid)
    for _ in range(100):  # what was told to end may need a moment for it
        if not left:
            break
        time.sleep(0.1)
        left = still_there(process.pid)
    return process.returncode, words, left


def processes_of(session: int) -> dict[int, list[str]]:
    """Processes of a session, and of each what /proc/PID/stat says after its name."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            stat = path.read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        if int(stat[3]) == session:
            found[int(path.parent.name)] = stat
    return found


def still_there(session: int) -> list[int]:
    """Processes of a session that have not ended."""
    return [pid for pid, stat in processes_of(session).items() if stat[0] != "Z"]


def processor_time(session: int) -> float:
    """Seconds that the processes of a session have worked."""
    ticks = sum(int(stat[11]) + int(stat[12]) for stat in processes_of(session).values())
    return ticks / os.sysconf("SC_CLK_TCK")

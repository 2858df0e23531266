"""Processes of a pool end with the one that started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = """
import os, time
from fitting.parallel import run_all
from tests.fitting.parallel.test_orphans import waits
if __name__ == "__main__":
    run_all(waits, [1, 2], 2)
"""


def waits(_: int) -> None:
    """What a process of the pool does here."""
    os.write(1, f"{os.getpid()}\n".encode())  # at once: print may write the end of the line apart
    time.sleep(120)


def alive(pid: int) -> bool:
    """Whether a process lives; one that has ended and is not yet waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="looks for processes in /proc")
def test_a_pool_whose_parent_is_killed_ends() -> None:
    process = subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    children = [int(process.stdout.readline()) for _ in range(2)]
    assert all(alive(pid) for pid in children)
    process.send_signal(signal.SIGKILL)
    process.wait()
    until = time.monotonic() + 60
    while any(alive(pid) for pid in children) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(alive(pid) for pid in children)

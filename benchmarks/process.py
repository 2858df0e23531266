"""Time and peak memory of a process of Python."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

LAUNCHER = """
import os, subprocess, sys
child = subprocess.Popen(sys.argv[2:])
_, status, used = os.wait4(child.pid, 0)
with open(sys.argv[1], "w") as file:
    file.write(f"{os.waitstatus_to_exitcode(status)} {used.ru_maxrss}")
"""
"""A process between: Linux hands on the peak memory of who starts a process, and this one has none."""


def measured(arguments: Sequence[str], errors: bool = False) -> tuple[float, float, str]:
    """Seconds and peak memory [MB] of a process of Python with these ``arguments`` or of the largest that it starts,
    and what it printed (``errors``: on stderr too). Raises SystemExit with that where it fails."""
    with tempfile.TemporaryDirectory() as folder:
        used, began = Path(folder) / "used", time.perf_counter()
        stderr = subprocess.STDOUT if errors else None
        words = [sys.executable, "-c", LAUNCHER, str(used), sys.executable, *arguments]
        out = subprocess.run(words, check=True, stdout=subprocess.PIPE, stderr=stderr, text=True).stdout
        seconds = time.perf_counter() - began
        code, peak = used.read_text().split()
    if int(code):
        raise SystemExit(f"{arguments[:3]} ended with {code}\n{out}")
    return seconds, float(peak) / (2**20 if sys.platform == "darwin" else 2**10), out

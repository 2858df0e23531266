"""The largest memory of a process that a test starts."""

from __future__ import annotations

PEAK = '''
import sys
from pathlib import Path
def peak_mb():
    """Largest memory of this process [MB]. Linux hands ru_maxrss of the parent on to it, but not VmHWM."""
    status = Path("/proc/self/status")
    if status.is_file():
        return next(int(line.split()[1]) for line in status.open() if line.startswith("VmHWM")) / 1024
    import resource
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
'''
"""Source of ``peak_mb``, for the program of a process of its own."""

"""Large arrays that follow each other take the memory of the ones before."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import resource
import numpy as np
from fitting.parallel.executors import keep_freed_memory

able = keep_freed_memory()
for _ in range(3):
    one, two = np.ones(2_000_000), np.ones(2_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    del one, two
print(able, resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
more = [np.ones(2_000_000) for _ in range(2)]
print(able, resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems keep it, or not, by themselves")
def test_pages_are_not_cleared_again() -> None:
    made = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    able, faults = made.stdout.split()[-2:]
    assert able == "False" or int(faults) < 1000  # of 7,800 pages

"""Measurements, as ratios within one run; results are kept in RESULTS.md."""

import os

from fitting.parallel import THREADS

for _name in THREADS:
    os.environ.setdefault(_name, "1")  # one thread per process, as the command sets it; before numpy is imported

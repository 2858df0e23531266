"""Measurements, as ratios within one run; results are kept in RESULTS.md."""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one thread per process, as the command sets it; before numpy is imported

"""The bootstrap by run of 100 replicates on Train-TZRB: one process against two, and one step against refits.

Run from the repository root: python -m benchmarks.bootstrap [replicates]
"""

from __future__ import annotations

import sys
import time

import numpy as np

from benchmarks.record import record, table
from cases.io.read import read_trials
from cases.published_splits import TRAIN_TZRB, find
from cases.shipfiles.ship_file import load_ship
from fitting.calibration import estimate_coefficients
from fitting.uncertainty.bootstrap import Replicates, bootstrap


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    found = estimate_coefficients(load_ship("esso_osaka_3m"), read_trials(find(TRAIN_TZRB)))
    info, problem, x = found.information, found.problem, found.solution.x
    made: dict[str, tuple[Replicates, float]] = {}
    for name, more in (("one step", ()), ("refits, 1 process", (problem, x)), ("refits, 2 processes", (problem, x, 2))):
        began = time.perf_counter()
        made[name] = (bootstrap(info, count, 0, *more), time.perf_counter() - began)
    single = made["refits, 1 process"][1]
    spread = {name: np.sqrt(np.diag(r.covariance)) for name, (r, _) in made.items()}
    robust = np.sqrt(np.diag(found.covariance))
    wide = {name: f"{np.median(values / robust):.2f}" for name, values in spread.items()}
    rows = [
        [name, f"{seconds:.2f}", f"{single / seconds:.2f}", str(len(r.failures)), wide[name]]
        for name, (r, seconds) in made.items()
    ]
    lines = [
        f"{count} replicates, {len(found.prior.symbols)} coefficients, {len(info.run)} windows of "
        f"{len(found.segments.trials)} runs, starting processes and building kernels included.",
        "",
        *table(["", "seconds", "times faster than 1 process", "failed", "std over the reported one, median"], rows),
    ]
    record("Bootstrap by run", "python -m benchmarks.bootstrap", lines)


if __name__ == "__main__":
    main()

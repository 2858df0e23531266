"""The bootstrap by run on Train-TZRB: one step against refits; one process, two, and a Dask cluster on loopback.

The cluster is a scheduler and two workers on this machine; in the last row one of two workers is killed on the way.

Run from the repository root: python -m benchmarks.bootstrap [replicates]
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path

import numpy as np

from benchmarks.record import record, table
from cases.io.read import read_trials
from cases.published_splits import TRAIN_TZRB, find
from cases.shipfiles.ship_file import load_ship
from fitting.calibration import estimate_coefficients
from fitting.parallel.dask_cluster import dask_cluster
from fitting.uncertainty.bootstrap import Replicates, bootstrap
from tests.support.dask_processes import scheduler, worker

KILLED_AFTER = 15.0
"""Seconds after which a worker is killed."""


@contextmanager
def loopback(killed: bool = False) -> Iterator[None]:
    """A Dask cluster of two workers on this machine does the tasks; one of them is ``killed`` on the way."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        address, _ = stack.enter_context(scheduler(folder))
        workers = [stack.enter_context(worker(address, folder, name)) for name in ("first", "second")]
        cluster = stack.enter_context(dask_cluster(address))
        cluster.client.wait_for_workers(2, timeout=60)
        if killed:
            timer = threading.Timer(KILLED_AFTER, workers[0].kill)
            timer.start()
            stack.callback(timer.cancel)
        yield


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    found = estimate_coefficients(load_ship("esso_osaka_3m"), read_trials(find(TRAIN_TZRB)))
    info, problem, x = found.information, found.problem, found.solution.x
    made: dict[str, tuple[Replicates, float]] = {}
    for name, more, where in (
        ("one step", (), nullcontext()),
        ("refits, 1 process", (problem, x), nullcontext()),
        ("refits, 2 processes", (problem, x, 2), nullcontext()),
        ("refits, Dask, 2 workers", (problem, x), loopback()),
        ("refits, Dask, 1 of 2 workers killed", (problem, x), loopback(killed=True)),
    ):
        with where:
            began = time.perf_counter()
            made[name] = (bootstrap(info, count, 0, *more), time.perf_counter() - began)
    pair = made["refits, 2 processes"][1]
    (alone, single), robust = made["refits, 1 process"], np.sqrt(np.diag(found.covariance))
    rows = [
        [
            name,
            f"{seconds:.2f}",
            f"{single / seconds:.2f}",
            f"{seconds / pair:.2f}" if "2" in name else "",
            str(len(r.failures)),
            f"{np.median(np.sqrt(np.diag(r.covariance)) / robust):.2f}",
            "yes" if np.array_equal(r.p, alone.p, equal_nan=True) else f"{np.nanmax(np.abs(r.p - alone.p)):.1g} apart",
        ]
        for name, (r, seconds) in made.items()
    ]
    header = [
        "",
        "seconds",
        "times faster than 1 process",
        "seconds over those of 2 processes",
        "failed",
        "std over the reported one, median",
    ]
    lines = [
        f"{count} replicates, {len(found.prior.symbols)} coefficients, {len(info.run)} windows of "
        f"{len(found.segments.trials)} runs, starting processes and building kernels included; not the start of a "
        "cluster, which is there already.",
        "",
        *table([*header, "same values as 1 process"], rows),
    ]
    record("Bootstrap by run", "python -m benchmarks.bootstrap", lines)


if __name__ == "__main__":
    main()

"""What a fit costs as a task of a cluster: bytes, seconds, and what follows for 1,000 ships x 1,000 fits on 256 cores.

python -m benchmarks.task_sizes [--tasks 400] [--record]

A task is refits of a bootstrap as `mmg fit` hands them over, pickled as they are sent. Their seconds of one core are
measured on a campaign of synthetic trials. The time of the scheduler for a task is measured with tasks of the same
bytes that do nothing, on a Dask scheduler and one worker on loopback. The rest is arithmetic, printed with its numbers.
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import record, table
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from fitting.calibration import estimate_coefficients
from fitting.parallel.dask_cluster import dask_cluster
from fitting.parallel.executors import run_all
from fitting.uncertainty.bootstrap import drawn_runs, refit
from tests.support.dask_processes import scheduler, worker

SHIPS, FITS, CORES, NETWORK, DISK = 1000, 1000, 256, 10e9 / 8, 200e6
"""Of the campaign on paper; bytes/s of a network of 10 Gbit/s and of a shared disk."""
CHUNK = 10
"""Refits in a task, so that the trials of a ship are sent a hundred times and not a thousand."""


def nothing(task: Any) -> int:
    """A task that only travels."""
    return len(task)


def overhead(tasks: int, size: int) -> float:
    """Seconds that scheduler, network and worker take for one of so many ``tasks`` of ``size`` bytes."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        address, _ = stack.enter_context(scheduler(folder))
        stack.enter_context(worker(address, folder, "only"))
        stack.enter_context(dask_cluster(address))
        payload = np.random.default_rng(0).bytes(size)
        run_all(nothing, [payload] * 20)
        began = time.perf_counter()
        run_all(nothing, [payload] * tasks)
        return (time.perf_counter() - began) / tasks


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=400)
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    ship = load_ship("esso_osaka_3m")
    trials = demo_trials()[0]
    began = time.process_time()
    found = estimate_coefficients(ship, trials)
    whole = time.process_time() - began
    rng = np.random.default_rng(0)
    counts = drawn_runs(found.information.run, CHUNK, rng)
    task = (found.problem, found.solution.x, counts, np.zeros((CHUNK, len(found.information.p))))
    sent = len(pickle.dumps(task, protocol=5))
    outcome = refit((*task[:2], counts[:1], task[3][:1]))  # kernels are built once
    began = time.process_time()
    outcome = refit(task)
    seconds = (time.process_time() - began) / CHUNK
    back = len(pickle.dumps(outcome, protocol=5))
    per_task = overhead(given.tasks, sent)
    refits = SHIPS * FITS
    tasks = refits / CHUNK
    compute, network = refits * seconds / CORES / 3600, tasks * (sent + back) / NETWORK / 3600
    measured = [
        ["data of a campaign", f"{len(trials)} trials, {sum(t.duration for t in trials):.0f} s"],
        ["a first fit, one core", f"{whole:.1f} s"],
        ["a refit, one core", f"{seconds:.2f} s"],
        [f"a task of {CHUNK} refits, sent / returned", f"{sent / 1e6:.2f} / {back / 1e6:.4f} MB"],
        ["scheduler, network and worker for a task that does nothing", f"{1e3 * per_task:.1f} ms"],
    ]
    each, mega = f"{1e3 * per_task:.1f} ms", f"{sent / 1e6:.2f} MB"
    paper = [
        ["compute", f"{compute:.1f} h", f"{refits:.0e} refits x {seconds:.2f} s / {CORES}"],
        ["first fits", f"{SHIPS * whole / CORES / 3600:.2f} h", f"{SHIPS} x {whole:.1f} s / {CORES}"],
        ["scheduler, one task after another", f"{tasks * per_task / 3600:.2f} h", f"{tasks:.0e} x {each}"],
        ["network, 10 Gbit/s at the client", f"{network:.2f} h", f"{tasks:.0e} x {mega}"],
        ["disk, results at 200 MB/s", f"{tasks * back / DISK:.0f} s", f"{tasks:.0e} x {back / 1e3:.1f} kB"],
        [
            "cores that one scheduler keeps busy",
            f"{CHUNK * seconds / per_task:.0f}",
            f"{CHUNK * seconds:.1f} s / {each}",
        ],
        ["memory at the scheduler", f"{2 * CORES * sent / 1e9:.2f} GB", f"two tasks for each of {CORES} workers"],
    ]
    lines = [*table(["measured", "value"], measured), "", *table(["1,000 ships x 1,000 fits", "value", "from"], paper)]
    if given.record:
        record("Tasks on paper: 1,000 ships x 1,000 fits", "python -m benchmarks.task_sizes", lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()

"""Independent tasks handed to an executor: inline, processes of this machine, or a Dask cluster.

``run_all`` gives the same outcomes, in the order of the tasks, whichever executor does them and in whatever order they
are done. Every list of independent tasks of the product goes through it.
"""

from __future__ import annotations

from fitting.parallel.beside import (
    Awaited,
    ProcessBeside,
    begun_beside,
    both_processes,
    evaluated_beside,
    helping,
    process_beside,
    spread_beside,
)
from fitting.parallel.executors import Executor, executing, kept_workers, listening, run_all, width
from fitting.parallel.processes import cores, end_with_parent, held_back, helper
from fitting.parallel.shared import Shared
from fitting.parallel.threads import with_one_thread

__all__ = [
    "Awaited",
    "Executor",
    "ProcessBeside",
    "Shared",
    "begun_beside",
    "both_processes",
    "cores",
    "end_with_parent",
    "evaluated_beside",
    "executing",
    "held_back",
    "helper",
    "helping",
    "kept_workers",
    "listening",
    "process_beside",
    "run_all",
    "spread_beside",
    "width",
    "with_one_thread",
]

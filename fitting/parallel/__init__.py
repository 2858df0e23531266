"""Independent tasks on executors: in this process, in processes of this machine, or on a Dask cluster.

``run_all`` gives the same outcomes, in the order of the tasks, whoever does them and in whatever order they are done.
Every list of independent tasks of the product goes through it.
"""

from __future__ import annotations

from fitting.parallel.executors import Shared, executing, kept_workers, listening, run_all, width, with_one_thread

__all__ = ["Shared", "executing", "kept_workers", "listening", "run_all", "width", "with_one_thread"]

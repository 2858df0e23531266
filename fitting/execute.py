"""Independent tasks handed to an executor: inline, or spread over processes. Nothing else knows about parallelism."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


def run_all(function: Callable[[Task], Outcome], tasks: Sequence[Task], workers: int = 1) -> list[Outcome]:
    """``function`` of each task, in order; with more than one worker in processes of their own.

    The function must be importable and tasks and outcomes picklable between processes of this one program.
    """
    if workers <= 1 or len(tasks) <= 1:
        return [function(task) for task in tasks]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=min(workers, len(tasks)), mp_context=context) as pool:
        return list(pool.map(function, tasks))

"""The trainings of several seeds: spread over processes, stopped by Ctrl-C or a time limit, kept as they finish."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fitting.parallel import run_all, width
from fitting.report.parts import Store
from fitting.solvers.interrupts import interrupts_noted
from mmg.progress import LOGGER, OnProgress, Progress
from residual.training.checkpoint import load_outcome, save_outcome
from residual.training.trainer import Outcome, Task, train_one

STARTED = "started_"
"""Beginning of the names of files by which a process says that it trains."""


def train_seeds(
    tasks: Sequence[Task], progress: OnProgress | None = None, store: Store | None = None
) -> tuple[list[Outcome], bool]:
    """Outcomes of the ``tasks`` of a training in their order, and whether Ctrl-C ended them early.

    progress: called after each epoch where one process trains, else after each seed; store: what it holds is not
    trained again, and what finishes is kept there. After Ctrl-C the trainings under way keep their best weights and
    those not begun are left out. Raises KeyboardInterrupt where none was begun, UserError where the store is of another
    run.
    """
    if store:
        store.open()
    settings = tasks[0].settings
    known = {task.seed: load_outcome(store, task.seed) for task in tasks} if store else {}
    missing = [task for task in tasks if not known.get(task.seed)]
    for seed in [task.seed for task in tasks if known.get(task.seed)]:
        LOGGER.info("seed %d: already trained", seed)
    workers = max(1, min(width(settings.workers), len(missing)))
    if missing:
        LOGGER.info("training from seed(s) %s in %d process(es)", ", ".join(str(t.seed) for t in missing), workers)
    limit = settings.time_limit / -(-len(missing) // workers) if settings.time_limit and missing else None
    done = len(tasks) - len(missing)
    with tempfile.TemporaryDirectory() as scratch:
        stop = Path(scratch) / "stop"

        def interrupted() -> None:
            stop.touch()
            if not any(stop.parent.glob(f"{STARTED}*")):
                raise KeyboardInterrupt  # nothing to keep: do not wait for processes that are still starting
            LOGGER.info("interrupted: keeping the best weights so far")

        def note(outcome: Outcome | None) -> None:
            nonlocal done
            if outcome:
                done += 1
                better = f"judged 30 s windows {outcome.before[0]:.4f} -> {outcome.after[0]:.4f}"
                again = f", restarted {outcome.restarts} time(s) at a lower rate" if outcome.restarts else ""
                weight = "" if len(outcome.path) < 2 else f", weight of the penalty {outcome.penalty}"
                words = f"{outcome.status} in {outcome.seconds:.0f} s, {better}{again}{weight}"
                LOGGER.info(f"seed {outcome.seed}: {words}")
                if progress:
                    progress(Progress("seeds", done, len(tasks), {"error of 30 s windows": outcome.after[0]}))

        with interrupts_noted(interrupted):
            jobs = [(replace(task, stop=stop, seconds=limit), store) for task in missing]
            work = partial(_trained, progress=progress) if workers == 1 else _trained
            made = run_all(work, jobs, workers, note)
        broken = stop.exists()
    found = known | {o.seed: o for o in made if o}
    outcomes = [o for o in (found.get(task.seed) for task in tasks) if o]
    if not outcomes:
        raise KeyboardInterrupt
    return outcomes, broken


def _trained(job: tuple[Task, Store | None], progress: OnProgress | None = None) -> Outcome | None:
    """One training, kept where it came to its end; None where it was stopped before it began."""
    task, store = job
    assert task.stop is not None
    if task.stop.exists():
        return None
    with contextlib.suppress(OSError):  # a worker of another machine has no such folder
        task.stop.with_name(f"{STARTED}{task.seed}").touch()
    outcome = train_one(task, progress)
    if store and outcome.status != "stopped":
        save_outcome(store, outcome)
    return outcome

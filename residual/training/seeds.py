"""The trainings of several seeds: spread over processes, stopped by Ctrl-C or a time limit, kept as they finish."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.interrupts import Interrupts
from fitting.parallel import run_all
from residual.training.checkpoint import Store, load_outcome, save_outcome
from residual.training.trainer import Outcome, Task, Training, train_one

BEGUN = "begun_"
"""Beginning of the names of files by which a process says that it trains."""


def train_seeds(
    tasks: Sequence[Task], training: Training, say: Callable[[str], None], store: Store | None = None
) -> tuple[list[Outcome], bool]:
    """Outcomes of the tasks in their order, and whether Ctrl-C ended them early.

    What ``store`` holds is not trained again, and what finishes is kept there. After Ctrl-C the trainings under way
    keep their best weights and those not begun are left out. Raises KeyboardInterrupt where none was begun, UserError
    where the store is of another run.
    """
    if store:
        store.open()
    known = {task.seed: load_outcome(store, task.seed) for task in tasks} if store else {}
    missing = [task for task in tasks if not known.get(task.seed)]
    for seed in [task.seed for task in tasks if known.get(task.seed)]:
        say(f"seed {seed}: already trained")
    workers = max(1, min(training.workers, len(missing)))
    if missing:
        say(f"training from seed(s) {', '.join(str(t.seed) for t in missing)} in {workers} process(es)")
    limit = training.time_limit / -(-len(missing) // workers) if training.time_limit and missing else None
    with tempfile.TemporaryDirectory() as scratch:
        stop = Path(scratch) / "stop"

        def interrupted() -> None:
            stop.touch()
            if not any(stop.parent.glob(f"{BEGUN}*")):
                raise KeyboardInterrupt  # nothing to keep: do not wait for processes that are still starting
            say("interrupted: keeping the best weights so far")

        def tell(outcome: Outcome | None) -> None:
            if outcome:
                say(_told(outcome))

        with Interrupts(interrupted):
            jobs = [(replace(task, stop=stop, seconds=limit), store) for task in missing]
            made = run_all(_trained, jobs, workers, tell)
        broken = stop.exists()
    found = known | {o.seed: o for o in made if o}
    outcomes = [o for o in (found.get(task.seed) for task in tasks) if o]
    if not outcomes:
        raise KeyboardInterrupt
    return outcomes, broken


def _trained(job: tuple[Task, Store | None]) -> Outcome | None:
    """One training, kept where it came to its end; None where it was stopped before it began."""
    task, store = job
    assert task.stop is not None
    if task.stop.exists():
        return None
    task.stop.with_name(f"{BEGUN}{task.seed}").touch()
    outcome = train_one(task)
    if store and outcome.status != "stopped":
        save_outcome(store, outcome)
    return outcome


def _told(o: Outcome) -> str:
    words = f"seed {o.seed}: {o.status} in {o.seconds:.0f} s, judged 30 s windows {o.before[0]:.4f} -> {o.after[0]:.4f}"
    return words + (f", restarted {o.restarts} time(s) at a lower rate" if o.restarts else "")

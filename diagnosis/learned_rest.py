"""How much a residual learned from the training trials closes of what a diagnosis leaves unexplained."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from cases.trial import Trial
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.time_limit import OutOfTimeError, check_time
from diagnosis.findings import LearnedResidual
from diagnosis.inputs import DiagnosisOptions
from diagnosis.result import Diagnosis
from fitting.parallel import Awaited, begun_beside, helping
from fitting.report.parts import Store
from mmg.errors import UserError, needs_torch
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress
from mmg.ship import Ship


def start_learning(
    ship: Ship,
    data: GriddedTrials | None,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    options: DiagnosisOptions,
) -> Awaited[LearnedResidual] | None:
    """What ``with_learned`` measures for a ``ship`` with the named effects, begun by the process beside this one.

    data: the ``trials`` as they were diagnosed; tests, options: as of ``with_learned``. None where there is no such
    process, without test trials, and where it is not asked for or has a time limit, of which that one knows nothing.
    """
    process = helping() if tests and options.learn and not options.time_limit else None
    if process is None:
        return None
    return begun_beside(process, _Training.of(ship, data, trials, tests, options).measured)


def with_learned(
    found: Diagnosis,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    options: DiagnosisOptions,
    progress: OnProgress | None = None,
    started: Awaited[LearnedResidual] | None = None,
) -> Diagnosis:
    """``found`` with how much a residual learned from ``trials`` closes of the remainder, measured on ``tests``.

    As given where nothing is left unexplained, and without test trials. Where it cannot be measured, a warning says
    why. options, progress: as of ``diagnose``; started: of ``start_learning``, for the ship of ``found``. Returns the
    diagnosis with ``learned``, and where another process measures it, with the figures that are drawn meanwhile.
    """
    if not tests or not (found.verdict == "unknown" or found.remainder):
        return found
    began = time.perf_counter()
    try:
        check_time()
        LOGGER.info("learning the unexplained remainder from the training trials")
        started = started or start_learning(found.ship, found.data, trials, tests, options)
        if started is not None:
            found = found.with_figures()
            rest = started.value
        else:
            rest = _Training.of(found.ship, found.data, trials, tests, options).measured(progress)
    except UserError as reason:
        why = f"how much of the rest a learned residual closes was not measured: {reason}"
        code = "out_of_time" if isinstance(reason, OutOfTimeError) else "not_learned"
        return replace(found, warnings=(*found.warnings, Message(why, code)))
    seconds = time.perf_counter() - began
    spent = {**found.timings, "learned residual": seconds}
    if "total" in spent:
        spent["total"] = spent.pop("total") + seconds
    return replace(found, learned=rest, timings=spent)


@dataclass(frozen=True)
class _Training:
    """What is trained and measured, as another process takes it.

    ship: with the named effects; trials: to train on; tests: to measure on; seed, workers: of the training; step: of
    the diagnosis [s]; straight: inputs were joined by lines between samples; store: of finished trainings.
    """

    ship: Ship
    trials: Sequence[Trial]
    tests: Sequence[Trial]
    seed: int
    workers: int
    step: float | None
    straight: bool
    store: Store | None

    @classmethod
    def of(
        cls,
        ship: Ship,
        data: GriddedTrials | None,
        trials: Sequence[Trial],
        tests: Sequence[Trial],
        options: DiagnosisOptions,
    ) -> _Training:
        """That for a ``ship``; data, trials, tests, options: as of ``start_learning``."""
        step, straight = (options.step, False) if data is None else (data.h, data.straight)
        store = options.store.part("learned") if options.store is not None else None
        return cls(ship, trials, tests, options.seed, options.workers, step, straight, store)

    def measured(self, progress: OnProgress | None = None) -> LearnedResidual:
        """What it closes, which is where torch is imported; progress: called as the training goes on."""
        needs_torch("a learned residual")
        from diagnosis.validation.learned import SEEDS, measure_learned_residual
        from residual.settings import TrainSettings

        settings, store = TrainSettings(seeds=SEEDS, seed=self.seed, workers=self.workers, step=self.step), self.store
        if store is not None and store.folder.is_dir():  # begun by another process of this command, or resumed
            store = replace(store, resume=True)
        return measure_learned_residual(self.ship, self.trials, self.tests, settings, progress, store, self.straight)

"""How much a residual learned from the training trials closes of what a diagnosis leaves unexplained."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from cases.trial import Trial
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.time_limit import OutOfTimeError, check_time
from diagnosis.findings import LearnedResidual
from diagnosis.inputs import DiagnosisOptions
from diagnosis.result import Diagnosis
from fitting.parallel import Awaited, begun_beside, helping
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
    return begun_beside(process, partial(_learned, ship, _reading(data, options), trials, tests, options))


def _reading(data: GriddedTrials | None, options: DiagnosisOptions) -> tuple[float | None, bool]:
    """What ``_learned`` takes, of the trials as they were diagnosed."""
    return (options.step, False) if data is None else (data.h, data.straight)


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
    diagnosis with ``learned``.
    """
    if not tests or not (found.verdict == "unknown" or found.remainder):
        return found
    began = time.perf_counter()
    try:
        check_time()
        LOGGER.info("learning the unexplained remainder from the training trials")
        started = started or start_learning(found.ship, found.data, trials, tests, options)
        if started is not None:
            rest = started.value
        else:
            rest = _learned(found.ship, _reading(found.data, options), trials, tests, options, progress)
    except UserError as reason:
        why = f"how much of the rest a learned residual closes was not measured: {reason}"
        code = "out_of_time" if isinstance(reason, OutOfTimeError) else "not_learned"
        return replace(found, warnings=(*found.warnings, Message(why, code)))
    seconds = time.perf_counter() - began
    spent = {**found.timings, "learned residual": seconds}
    if "total" in spent:
        spent["total"] = spent.pop("total") + seconds
    return replace(found, learned=rest, timings=spent)


def _learned(
    ship: Ship,
    reading: tuple[float | None, bool],
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    options: DiagnosisOptions,
    progress: OnProgress | None = None,
) -> LearnedResidual:
    """The measurement behind ``with_learned``, as another process takes it, which is where torch is imported.

    reading: step [s] of the trials, and whether their inputs are joined by lines.
    """
    needs_torch("a learned residual")
    from diagnosis.validation.learned import SEEDS, measure_learned_residual
    from residual.settings import TrainSettings

    step, straight = reading
    settings = TrainSettings(seeds=SEEDS, seed=options.seed, workers=options.workers, step=step)
    store = options.store.part("learned") if options.store is not None else None
    if store is not None and store.folder.is_dir():  # of another process of this command, or resumed
        store = replace(store, resume=True)
    return measure_learned_residual(ship, trials, tests, settings, progress, store, straight)

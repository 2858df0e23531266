"""How much a residual learned from the training trials closes of what a diagnosis leaves unexplained."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from cases.trial import Trial
from diagnosis.inputs import DiagnosisOptions
from diagnosis.result import Diagnosis
from fitting.solvers.control import OutOfTimeError, check_time
from mmg.errors import UserError, needs_torch
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress


def with_learned(
    diagnosis: Diagnosis,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    options: DiagnosisOptions,
    progress: OnProgress | None = None,
) -> Diagnosis:
    """``diagnosis`` with how much a residual learned from ``trials`` closes of the remainder, measured on ``tests``.

    As given where nothing is left unexplained, and without test trials. Where it cannot be measured, a warning says
    why. options, progress: as of ``diagnose``. Returns the diagnosis with ``learned``.
    """
    if not tests or not (diagnosis.verdict == "unknown" or diagnosis.remainder):
        return diagnosis
    began = time.perf_counter()
    try:
        check_time()
        LOGGER.info("learning the unexplained remainder from the training trials")
        needs_torch("a learned residual")
        from diagnosis.validation.learned import SEEDS, measure_learned_residual
        from residual.settings import TrainSettings

        step, straight = (
            (options.step, False) if diagnosis.data is None else (diagnosis.data.h, diagnosis.data.straight)
        )
        settings = TrainSettings(seeds=SEEDS, seed=options.seed, workers=options.workers, step=step)
        store = options.store.part("learned") if options.store is not None else None
        rest = measure_learned_residual(diagnosis.ship, trials, tests, settings, progress, store, straight)
    except UserError as reason:
        why = f"how much of the rest a learned residual closes was not measured: {reason}"
        code = "out_of_time" if isinstance(reason, OutOfTimeError) else "not_learned"
        return replace(diagnosis, warnings=(*diagnosis.warnings, Message(why, code)))
    seconds = time.perf_counter() - began
    spent = {**diagnosis.timings, "learned residual": seconds}
    if "total" in spent:
        spent["total"] = spent.pop("total") + seconds
    return replace(diagnosis, learned=rest, timings=spent)

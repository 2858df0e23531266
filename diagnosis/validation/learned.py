"""How much a residual learned from the training trials closes of what a diagnosis leaves unexplained.

It is trained by ``residual.pipeline.train`` on the ship with the named effects, and measured like the lines of ``mmg
gap``. The test trials take no part in the training.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis.findings import LearnedResidual
from diagnosis.inputs import DiagnosisOptions
from diagnosis.result import Diagnosis
from diagnosis.validation.gap import held_out_errors
from diagnosis.validation.held_out import interval_of, window_length
from fitting.prediction.predict import change_over
from fitting.report.run_folder import Store
from fitting.solvers.control import OutOfTimeError, check_time
from mmg.errors import NoSolution, UserError, needs_torch
from mmg.messages import LOGGER, Message, OnProgress
from mmg.ship import Ship
from residual.settings import TrainSettings

# Trainings. They are judged on three fifths of the runs; the five of ``mmg train`` cover all runs. Set by hand.
SEEDS = 3
NOTHING = 0.005  # Share of the error up to which a reduction or growth is called none. Set by hand.


def with_learned(diagnosis: Diagnosis, options: DiagnosisOptions, progress: OnProgress | None = None) -> Diagnosis:
    """``diagnosis`` with how much a residual learned from its trials closes of the remainder, measured on its tests.

    As given where nothing is left unexplained, and without test trials. Where it cannot be measured, a warning says
    why. options, progress: as of ``diagnose``. Returns the diagnosis with ``learned``.
    """
    trials, tests = diagnosis.trials, diagnosis.tests
    if not tests or not (diagnosis.verdict == "unknown" or diagnosis.remainder):
        return diagnosis
    began = time.perf_counter()
    try:
        check_time()
        LOGGER.info("learning the unexplained remainder from the training trials")
        needs_torch("a learned residual")
        step = options.step if diagnosis.data is None else diagnosis.data.h
        settings = TrainSettings(seeds=SEEDS, seed=options.seed, workers=options.workers, step=step)
        store = options.store.part("learned") if options.store is not None else None
        if diagnosis.data is not None and diagnosis.data.straight:
            trials, tests = TrialSet.of(trials).sampled, TrialSet.of(tests).sampled
        rest = measure_learned_residual(diagnosis.ship, trials, tests, settings, progress, store)
    except UserError as reason:
        why = f"how much of the rest a learned residual closes was not measured: {reason}"
        code = "out_of_time" if isinstance(reason, OutOfTimeError) else "not_learned"
        return replace(diagnosis, warnings=(*diagnosis.warnings, Message(why, code)))
    seconds = time.perf_counter() - began
    spent = {**diagnosis.timings, "learned residual": seconds}
    if "total" in spent:
        spent["total"] = spent.pop("total") + seconds
    return replace(diagnosis, learned=rest, timings=spent)


def measure_learned_residual(
    ship: Ship,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    settings: TrainSettings | None = None,
    progress: OnProgress | None = None,
    store: Store | None = None,
) -> LearnedResidual:
    """Train residuals on the training trials and measure how far the error of the test trials falls.

    ship: with the named effects; trials: for training; tests: only measured on; settings: how to train (default: as
    ``mmg train`` with SEEDS seeds; its seed also draws the runs); progress: called as the training goes on; store: of
    finished seeds, which are not trained again. Returns the errors before and after. Raises UserError for too little
    data and where every training diverged, KeyboardInterrupt after Ctrl-C.
    """
    from residual.pipeline import train  # late: torch takes a second to import

    ship, settings = ship.without_network(), settings or TrainSettings(seeds=SEEDS)
    seconds = window_length(ship)
    change = change_over(tests, seconds, 0.5 * seconds)
    before = held_out_errors(ship, tests, seconds, change)
    result = train(ship, trials, (), settings, progress=progress, store=store)
    if result.interrupted:
        raise KeyboardInterrupt
    if result.hybrid is None or result.decision is None:
        raise NoSolution("every training diverged, also at lower rates")
    a, b = before.mean, held_out_errors(result.hybrid, tests, seconds, change).mean
    several = len(np.unique(before.run)) > 1
    interval = interval_of(a, b, before.run, np.random.default_rng(settings.seed)) if several else None
    reduction = float(1 - b.sum() / a.sum())
    return LearnedResidual(
        mse_before=float(a.mean()),
        mse_after=float(b.mean()),
        reduction=reduction,
        interval_90=interval,
        windows=len(a),
        kept=result.decision.kept,
        decision=result.decision.words,
        sentence=sentence_of(reduction, interval),
    )


def sentence_of(reduction: float, interval: tuple[float, float] | None) -> str:
    """One sentence on a ``reduction`` of the error and its 90 % interval; no more than chance is called none."""
    size, (low, high) = f"{abs(reduction):.1%}", interval or (-np.inf, np.inf)
    chance = "a single test trial does not tell how much of that is chance"
    if interval:
        chance = f"90 % interval {low:+.1%} to {high:+.1%}"
    what = "of the error of predictions of the test trials"
    if low > 0 and reduction > NOTHING:
        return f"A learned residual closes {size} {what} ({chance}): so much of the remainder can be learned."
    if high < 0 and reduction < -NOTHING:
        return f"A learned residual does not close any {what} but makes it {size} larger ({chance})."
    return (
        f"A learned residual does not close any {what} beyond chance (reduction {reduction:+.1%}; {chance}): "
        "the unexplained remainder was not learned from these trials."
    )

"""Length of the windows of a calibration that is to predict over a horizon: by runs left out.

A fit forgives errors that build up over more than a window, since each window begins at states of its own. Windows as
long as the horizon count what the prediction will suffer from; shorter ones are less bent by gusts and by what the
model lacks. Which of the two weighs more differs from ship to ship, so left-out runs say it: every candidate is
calibrated from the estimate of the first one, and each run is predicted over the horizon by the estimate without it
(fitting/selection/left_out_runs.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.captive import Captive
from fitting.prediction.predict import ShipsByTrial, predict_all
from fitting.prediction.score import pooled_sigma
from fitting.selection.left_out_runs import Jackknifed, apart, estimates_without, jackknifed
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.messages import Message
from mmg.progress import OnProgress
from mmg.ship import Ship

STEPS, HALF = 100.0, 0.5
"""Steps of the usual windows, which are tried beside the horizon; and half of either."""
SHORTEST = 20.0
"""Steps of the shortest windows that are tried."""
APART = 1.2
"""Factor by which candidates differ at least."""
FEWEST = 4
"""Runs from which on a choice is made."""
LEAST_GAIN = 0.005
"""Share by which a candidate must lower the error of runs left out."""
OF_KIND = 3
"""Runs of a kind from which on its own error may forbid a candidate."""
CLEARLY = 1.645
"""Jackknife errors by which a candidate must be better: a chance of 5 % for one that is not."""
ERRORS_WORSE = 2.0
"""Jackknife errors by which a kind may become worse."""


@dataclass(frozen=True)
class TriedWindow:
    """A candidate: its windows [s], mean over runs of the error over the horizon, by what share that changes from the
    first candidate's (mean over runs of the logarithm), with the jackknife error, and whether it is taken."""

    window: float
    error: float
    change: Jackknifed
    taken: bool


def candidates_for(settings: Settings) -> list[float]:
    """Windows [s] to try for ``settings`` with a horizon and a step, the horizon first."""
    assert settings.horizon is not None and settings.step is not None
    chosen = [settings.horizon]
    usual = STEPS * settings.step
    for window in (HALF * settings.horizon, usual, HALF * usual):
        far = all(max(window / w, w / window) >= APART for w in chosen)
        if far and window >= SHORTEST * settings.step:
            chosen.append(window)
    return chosen


def choose_window(
    found: Calibration,
    ship: Ship,
    trials: Sequence[Trial],
    captive: Captive | None = None,
    progress: OnProgress | None = None,
) -> Calibration:
    """The calibration ``found``, whose windows are as long as its horizon, or one with other windows whose predictions
    over the horizon are clearly better on runs left out, with a notice on the choice.

    ship, trials, captive: of ``found``; progress: of further solves. Returns ``found`` as it is where too few runs can
    be left out.
    """
    horizon = found.settings.horizon
    if not horizon or not found.converged or found.constants is not None or len(trials) < FEWEST:
        return found
    try:
        first = errors_over(found, trials, horizon)
    except UserError:
        return found
    if int(np.isfinite(first).sum()) < FEWEST:
        return found
    best, least = found, -LEAST_GAIN
    rows = [TriedWindow(horizon, float(np.nanmean(first)), Jackknifed(0.0, 0.0), True)]
    for window in candidates_for(found.settings)[1:]:
        settings = replace(found.settings, window=window, starts=1, passes=2)
        other = estimate_coefficients(ship, trials, settings, progress, {"p": found.p}, captive)
        if not other.converged:
            continue
        errors = errors_over(other, trials, horizon)
        change = jackknifed(np.log(errors / first))
        good = change.value < min(least, -CLEARLY * change.error) and not worse_kind(first, errors, trials)
        if good:
            best, least = other, change.value
            rows = [replace(row, taken=False) for row in rows]
        rows.append(TriedWindow(window, float(np.nanmean(errors)), change, good))
    if len(rows) == 1:
        return found
    notices = (*found.notices, *best.notices, Message(sentence_of(rows, horizon), "window_chosen"))
    return replace(best, notices=tuple(dict.fromkeys(notices)))


def errors_over(found: Calibration, trials: Sequence[Trial], horizon: float) -> np.ndarray:
    """Mean squared error (R,) of each of ``trials`` over windows of ``horizon`` [s], which overlap by half, by the
    estimate of ``found`` without that trial: the sum over six states in units of their deviation, NaN where none fits.

    Raises UserError for trials without positions.
    """
    sigma, folds, problem = pooled_sigma(trials), apart(trials), found.problem
    own = np.full((len(trials), len(problem.ship.symbols)), np.nan)
    for out, p in zip(folds, estimates_without(found.information, folds, problem.p_bounds()), strict=True):
        own[list(out)] = np.atleast_2d(problem.coefficients(p))[0]
    simulator = ShipsByTrial(problem.ship, own, found.settings.compiled)
    errors = np.full(len(trials), np.nan)
    made = predict_all(simulator, trials, horizon, horizon / 2, short_last=False)
    for i, (trial, (windows, _)) in enumerate(zip(trials, made, strict=True)):
        squares = [((w.error(trial.states)[1:] / sigma) ** 2).sum(axis=1) for w in windows]
        if squares:
            errors[i] = np.concatenate(squares).mean()
    return errors


def worse_kind(before: np.ndarray, after: np.ndarray, trials: Sequence[Trial]) -> str:
    """The first kind of ``trials`` whose errors (R,) rose clearly from ``before`` to ``after``, "" for none."""
    for kind in dict.fromkeys(t.kind for t in trials if t.kind):
        change = jackknifed(np.log(after / before)[[t.kind == kind for t in trials]])
        enough = sum(np.isfinite(before[i]) for i, t in enumerate(trials) if t.kind == kind) >= OF_KIND
        if enough and change.value > max(LEAST_GAIN, ERRORS_WORSE * change.error):
            return kind
    return ""


def sentence_of(rows: Sequence[TriedWindow], horizon: float) -> str:
    """What was chosen of the ``rows`` for predictions over ``horizon`` [s], in words."""
    last = next(row for row in rows if row.taken)
    others = [row for row in rows if row is not last]
    tried = ", ".join(f"{row.window:g} s: {row.error:.4f}" for row in others)
    return (
        f"windows of {last.window:g} s for predictions over {horizon:g} s: error of runs left out {last.error:.4f} "
        f"({tried})"
    )

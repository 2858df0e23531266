"""Which instruments get a value of their own in each campaign: those that make runs better that were left out.

One linearisation beside the calibration (``candidates``) serves every question. A candidate has the width that makes
the data most likely (``spread``); each run is then left out in turn, those of its campaign stay in, and it is
predicted with what they say of its instruments (``left_out_runs``). What is taken must predict better than without it,
and better than one value that all campaigns share: days that do not differ change nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.trial import Trial
from fitting.calibration import Calibration
from fitting.prediction.score import pooled_sigma
from fitting.selection.campaigns.candidates import Beside
from fitting.selection.campaigns.spread import NARROW, Reduced, Widths, with_prior
from fitting.selection.left_out_runs import each_alone, estimates_without, scores_of_folds

LEAST_GAIN = 0.005
"""Share by which the mean of the left-out runs must become better."""


@dataclass(frozen=True)
class InstrumentTried:
    """A row of the table: instrument; its width in units of the scale; evidence: twice the log likelihood ratio against
    one value that all campaigns share; without, shared, own: mean squared error of runs left out without it, with one
    value for all, with one for each campaign (NaN: not looked at); taken."""

    name: str
    width: float
    evidence: float
    without: float
    shared: float
    own: float
    taken: bool


@dataclass(frozen=True)
class KeptInstruments:
    """What was kept: numbers of the candidates, widths of all, and the table."""

    numbers: tuple[int, ...]
    widths: Widths
    table: tuple[InstrumentTried, ...]


class LeftOut:
    """Scores of runs left out, by run, under widths of the candidates."""

    def __init__(self, found: Calibration, beside: Beside, trials: Sequence[Trial]) -> None:
        self.compiled, self.beside, self.trials = found.settings.compiled, beside, list(trials)
        self.judged = [i for i, t in enumerate(trials) if t.has_position]
        self.sigma = pooled_sigma([trials[i] for i in self.judged])

    def scores(self, widths: Widths) -> np.ndarray:
        """Mean squared error of 30 s windows of each run when it is left out, (runs,)."""
        info, columns = with_prior(self.beside.info, self.beside.constants, widths)
        lower, upper = self.beside.problem.p_bounds()
        folds = each_alone(len(self.trials))
        own = estimates_without(info, folds, (lower[columns], upper[columns]))
        whole = np.zeros((len(folds), len(lower)))
        whole[:, columns] = own
        problem = self.beside.problem
        return scores_of_folds(problem, self.trials, folds, whole, self.sigma, compiled=self.compiled).window


def choose(found: Calibration, beside: Beside, trials: Sequence[Trial], started: Sequence[int]) -> KeptInstruments:
    """What to keep of the candidates of ``beside`` the calibration ``found`` of ``trials``, by forward selection.

    started: numbers of the candidates that the calibration has already, with one value for all. What does not help at
    first is not wanted again.
    """
    reduced = Reduced.of(beside.info, beside.constants, found.spread.dispersion)
    left_out = LeftOut(found, beside, trials)
    width = tuple(NARROW if i in started else 0.0 for i in range(len(beside.candidates)))
    now = Widths(width, beside.block, beside.symbol)
    present = left_out.scores(now)
    kept: list[int] = []
    rows: dict[int, InstrumentTried] = {}
    open_ = list(range(len(beside.candidates)))
    while open_:
        found_better: list[tuple[float, int, Widths, np.ndarray]] = []
        for i in open_:
            wide = now.with_width(i, 1.0).fitted(reduced, [*kept, i])
            one = now.with_width(i, NARROW)
            gain = reduced.log_likelihood(wide.covariance()) - reduced.log_likelihood(one.covariance())
            own = left_out.scores(wide)
            row = InstrumentTried(
                beside.candidates[i].name, wide.width[i], 2 * gain, _mean(present), np.nan, _mean(own), False
            )
            if better(present, own):
                shared = present if i in started else left_out.scores(one)
                row = replace(row, shared=_mean(shared))
                if better(shared, own):
                    found_better.append((_mean(own), i, wide, own))
            rows[i] = row
        if not found_better:
            break
        _, best, now, present = min(found_better, key=lambda row: row[:2])
        kept.append(best)
        rows[best] = replace(rows[best], taken=True)
        open_ = [i for _, i, _, _ in found_better if i != best]
    return KeptInstruments(tuple(kept), now, tuple(rows.values()))


def better(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether scores of runs ``after`` (R,) are lower in the mean than those ``before``, by LEAST_GAIN and by more than
    the standard error of the difference over runs."""
    good = np.isfinite(before) & np.isfinite(after)
    change = (after - before)[good]
    if len(change) < 2:
        return False
    error = change.std(ddof=1) / np.sqrt(len(change))
    return bool(change.mean() < -LEAST_GAIN * before[good].mean() and change.mean() < -error)


def _mean(scores: np.ndarray) -> float:
    return float(np.nanmean(scores)) if np.isfinite(scores).any() else float("nan")

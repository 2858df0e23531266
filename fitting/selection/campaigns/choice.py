"""Which instruments get a value of their own in each campaign: those that make runs better that were left out.

One linearisation beside the calibration (``candidates``) serves every question. First a test says whether the values
by run differ between campaigns more than within them (``chance``): days that do not differ change nothing, but for one
case in twenty. Then a candidate has the width that makes the data most likely (``spread``); each run is left out in
turn, those of its campaign stay in, and it is predicted with what they say of its instruments (``left_out_runs``).
What is taken must predict better than without it. The kinematics of the logs say of an instrument that it differs
whatever the model lacks, so any gain will do, and it may lie in one campaign. What only the model says is held to more:
the gain must exceed LEAST_GAIN and its standard error over runs, also against one value that all campaigns share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.trial import Trial
from fitting.calibration import Calibration
from fitting.nlp.fisher_information import Information
from fitting.prediction.score import pooled_sigma
from fitting.selection.campaigns.candidates import Beside
from fitting.selection.campaigns.chance import ByChance
from fitting.selection.campaigns.readings import ReadConstant, reduced_with, with_readings
from fitting.selection.campaigns.spread import NARROW, Reduced, Widths, with_prior
from fitting.selection.left_out_runs import apart, estimates_without, scores_of_folds

LEAST_GAIN = 0.005
"""Share by which the mean of the left-out runs must become better for what only the model says."""


@dataclass(frozen=True)
class InstrumentTried:
    """A row of the table: instrument; chance: probability that it is the same in all campaigns and differs by chance;
    measured: whether that is by the kinematics of the logs, else by the model; its width in units of the scale;
    evidence: twice the log likelihood ratio against one value that all campaigns share; without, shared, own: mean
    squared error of runs left out without it, with one value for all, with one for each campaign (NaN: not looked at);
    taken."""

    name: str
    chance: float
    measured: bool
    width: float
    evidence: float
    without: float
    shared: float
    own: float
    taken: bool


@dataclass(frozen=True)
class KeptInstruments:
    """What was kept: numbers of the candidates, widths of all, the table; info: of the windows beside the calibration,
    with rows of the readings."""

    numbers: tuple[int, ...]
    widths: Widths
    table: tuple[InstrumentTried, ...]
    info: Information


class LeftOut:
    """Scores of runs left out, by run, under widths of the candidates."""

    def __init__(self, found: Calibration, beside: Beside, trials: Sequence[Trial], info: Information) -> None:
        self.compiled, self.beside, self.trials, self.info = found.settings.compiled, beside, list(trials), info
        self.judged = [i for i, t in enumerate(trials) if t.has_position]
        self.sigma = pooled_sigma([trials[i] for i in self.judged])
        self.folds = apart(trials)

    def scores(self, widths: Widths) -> np.ndarray:
        """Mean squared error of 30 s windows of each run when it is left out, (runs,)."""
        info, columns = with_prior(self.info, self.beside.constants, widths)
        lower, upper = self.beside.problem.p_bounds()
        folds = self.folds
        own = estimates_without(info, folds, (lower[columns], upper[columns]))
        whole = np.zeros((len(folds), len(lower)))
        whole[:, columns] = own
        problem = self.beside.problem
        return scores_of_folds(problem, self.trials, folds, whole, self.sigma, compiled=self.compiled).window


def choose(
    found: Calibration, beside: Beside, trials: Sequence[Trial], started: Sequence[int], chances: Sequence[ByChance]
) -> KeptInstruments:
    """What to keep of the candidates of ``beside`` the calibration ``found`` of ``trials``, by forward selection.

    started: numbers of the candidates that the calibration has already, with one value for all; chances: of the
    candidates. What does not differ beyond chance, or does not help at first, is not wanted again.
    """
    read = read_constants(beside, chances)
    reduced = reduced_with(beside.info, read, beside.constants, found.spread.dispersion)
    info = with_readings(beside.info, read)
    width = tuple(NARROW if i in started else 0.0 for i in range(len(beside.candidates)))
    now = Widths(width, beside.block, beside.symbol)
    rows = {i: _untried(beside, reduced, now, i, chance) for i, chance in enumerate(chances)}
    open_ = [i for i, chance in enumerate(chances) if chance.differs]
    kept: list[int] = []
    left_out = LeftOut(found, beside, trials, info) if open_ else None
    present = left_out.scores(now) if left_out else np.array([])
    while open_ and left_out:
        found_better: list[tuple[float, int, Widths, np.ndarray]] = []
        for i in open_:
            wide = now.with_width(i, 1.0).fitted(reduced, [*kept, i])
            own = left_out.scores(wide)
            rows[i] = replace(rows[i], width=wide.width[i], without=_mean(present), own=_mean(own))
            good = gains(present, own) if chances[i].measured else better(present, own)
            if good and not chances[i].measured:
                shared = present if i in started else left_out.scores(now.with_width(i, NARROW))
                rows[i] = replace(rows[i], shared=_mean(shared))
                good = better(shared, own)
            if good:
                found_better.append((_mean(own), i, wide, own))
        if not found_better:
            break
        _, best, now, present = min(found_better, key=lambda row: row[:2])
        kept.append(best)
        rows[best] = replace(rows[best], taken=True)
        open_ = [i for _, i, _, _ in found_better if i != best]
    return KeptInstruments(tuple(kept), now, tuple(rows.values()), info)


def read_constants(beside: Beside, chances: Sequence[ByChance]) -> list[ReadConstant]:
    """Those constants of ``beside`` that differ and that the kinematics measured, by the ``chances`` of the
    candidates."""
    found = []
    for i, chance in enumerate(chances):
        if chance.differs and chance.readings is not None:
            columns = beside.constants[beside.block == i]
            k = beside.symbols.index(beside.candidates[i].symbols[0])
            each = np.ones(len(columns))
            found.append(ReadConstant(chance.readings, columns, beside.centre[k] * each, beside.unit[k] * each))
    return found


def _untried(beside: Beside, reduced: Reduced, now: Widths, number: int, chance: ByChance) -> InstrumentTried:
    """The row of the candidate of this ``number`` before runs are left out."""
    wide = now.with_width(number, 1.0).fitted(reduced, [number])
    one = now.with_width(number, NARROW)
    gain = reduced.log_likelihood(wide.covariance()) - reduced.log_likelihood(one.covariance())
    name, nan = beside.candidates[number].name, float("nan")
    return InstrumentTried(name, chance.p, chance.measured, wide.width[number], 2 * gain, nan, nan, nan, False)


def gains(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether scores of runs ``after`` (R,) are lower in the mean than those ``before``."""
    good = np.isfinite(before) & np.isfinite(after)
    return bool(good.any() and after[good].mean() < before[good].mean())


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
    good = scores[np.isfinite(scores)]
    return float(good.mean()) if len(good) else float("nan")

"""Runs left out of a calibration without calibrating again: the estimate without them, and how it predicts them.

The cost of each window, its states eliminated, is a quadratic in the coefficients near the estimate, with a gradient
and an information of its own (fitting/nlp/fisher_information.py). Without some runs the objective is the sum of the
others, whose minimum one Newton step finds (the infinitesimal jackknife of White 1982, with the exact remaining
information as in Beirami et al. 2017). A constant that only the runs left out determine falls back to its prior, as
it must for a run that was never seen. All windows of all runs are then simulated in one batch, each with the
coefficients of its fold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cases.checks.duplicates import duplicates
from cases.trial import Trial
from fitting.nlp.fisher_information import Information
from fitting.nlp.problem import Problem
from fitting.prediction.predict import ShipsByTrial
from fitting.prediction.score import pooled_sigma, score

METRICS = ("window", "paper")
"""30 s windows, and restarts every 100 s."""
ROUNDS = 8
"""Most times that a step is made again with coefficients held at their bounds."""


class Estimated(Protocol):
    """A calibration: the problem solved, and information and score of its windows at the estimate."""

    @property
    def problem(self) -> Problem: ...

    @property
    def information(self) -> Information: ...


@dataclass(frozen=True)
class Jackknifed:
    """A mean over files, or a difference of means, with its jackknife error over files."""

    value: float
    error: float

    @property
    def significant(self) -> bool:
        """Whether it differs from zero by more than one error."""
        return abs(self.value) > self.error


@dataclass(frozen=True)
class RunScores:
    """Scores of runs that had no part in the estimate that predicts them.

    names, kinds: of the runs; window, paper: (R,) mean squared error of their 30 s windows and 100 s restarts over six
    states in units of ``sigma`` (6,); windows: (R,) number of 30 s windows. A run without a whole window has NaN, one
    on which the estimate diverges inf.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    window: np.ndarray
    paper: np.ndarray
    windows: np.ndarray
    sigma: np.ndarray

    def of(self, metric: str = "window", kind: str | None = None) -> np.ndarray:
        """Scores by run in one of METRICS, of all runs or of those of one ``kind``."""
        values = getattr(self, metric)
        return values if kind is None else values[[k == kind for k in self.kinds]]

    def mean(self, metric: str = "window", kind: str | None = None) -> Jackknifed:
        """Mean of files in one of METRICS, of all runs or of those of one ``kind``."""
        return jackknifed(self.of(metric, kind))

    def change(self, other: RunScores, metric: str = "window", kind: str | None = None) -> Jackknifed:
        """Share by which the mean of files changes from these scores to the ``other`` ones of the same runs, with the
        error of that share."""
        return relative_change(self.of(metric, kind), other.of(metric, kind))


def jackknifed(values: np.ndarray) -> Jackknifed:
    """Mean over files of ``values`` (R,), those that are NaN left out, and its jackknife error."""
    good = values[~np.isnan(values)]
    n = len(good)
    if n < 2:
        return Jackknifed(float(good[0]) if n else float("nan"), float("nan"))
    return Jackknifed(float(good.mean()), float(good.std(ddof=1) / np.sqrt(n)))


def relative_change(before: np.ndarray, after: np.ndarray) -> Jackknifed:
    """mean(after) / mean(before) - 1 over files (R,) that both have, and its jackknife error over files."""
    good = ~(np.isnan(before) | np.isnan(after))
    a, b, n = before[good], after[good], int(good.sum())
    if not n:
        return Jackknifed(float("nan"), float("nan"))
    whole = b.mean() / a.mean() - 1
    if n < 2:
        return Jackknifed(float(whole), float("nan"))
    without = (b.sum() - b) / (a.sum() - a) - 1
    return Jackknifed(float(whole), float(np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())))


def estimates_without(
    info: Information, folds: Sequence[Sequence[int]], bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Estimates of scaled coefficients without the runs of each of ``folds`` (numbers of runs), (folds, P).

    info: of the windows at the estimate; bounds: lower and upper (P,) of the scaled coefficients. What pushes against
    a bound stays there. A fold whose remaining information is not positive is all NaN.
    """
    lower, upper = bounds
    found = np.full((len(folds), len(info.p)), np.nan)
    for k, out in enumerate(folds):
        rest = ~np.isin(info.run, list(out))
        H = info.fisher[rest].sum(axis=0) + info.prior_information
        slope = info.score[rest].sum(axis=0) + info.prior_score
        held = np.zeros(len(info.p), dtype=bool)
        target = info.p.copy()
        try:
            for _ in range(ROUNDS):
                # at the minimum with the held ones where they are: H_ff step = -(slope_f + H_fh moved_h)
                moved = np.where(held, target - info.p, 0.0)
                free = ~held
                step = moved.copy()
                step[free] = -np.linalg.solve(H[np.ix_(free, free)], slope[free] + H[np.ix_(free, held)] @ moved[held])
                wanted = info.p + step
                outside = (wanted < lower) | (wanted > upper)
                if not outside.any():
                    break
                held |= outside
                target = np.clip(wanted, lower, upper)
            found[k] = np.clip(wanted, lower, upper)
        except np.linalg.LinAlgError:
            continue
    return found


def folds_by(labels: Sequence[str], groups: Sequence[int], count: int) -> list[tuple[int, ...]]:
    """Runs in ``count`` folds, those with the same of ``labels`` (R,) spread over them; runs of one of ``groups``
    (R,) stay together, as those that share rows must."""
    first = {g: i for i, g in reversed(list(enumerate(groups)))}
    heads = sorted(first.values(), key=lambda i: (labels[i], i))
    fold = {groups[i]: k % count for k, i in enumerate(heads)}
    parts = [tuple(i for i, g in enumerate(groups) if fold[g] == k) for k in range(count)]
    return [part for part in parts if part]


def sharing_rows(trials: Sequence[Trial]) -> list[int]:
    """A number for each of ``trials`` that those have in common which hold the same rows."""
    groups, position = list(range(len(trials))), {t.name: i for i, t in enumerate(trials)}
    for i, (copies, _) in enumerate(duplicates(trials)):
        for copy in copies:
            pair = (groups[i], groups[position[copy["other"]]])
            groups = [min(pair) if g in pair else g for g in groups]
    return groups


def each_alone(count: int) -> list[tuple[int, ...]]:
    """Folds that leave out each of ``count`` runs alone."""
    return [(i,) for i in range(count)]


def apart(trials: Sequence[Trial]) -> list[tuple[int, ...]]:
    """Folds that leave out each of ``trials`` alone, those that share rows together."""
    groups = sharing_rows(trials)
    return [tuple(i for i, g in enumerate(groups) if g == k) for k in dict.fromkeys(groups)]


def scores_of_folds(
    problem: Problem,
    trials: Sequence[Trial],
    folds: Sequence[Sequence[int]],
    estimates: np.ndarray,
    sigma: np.ndarray | None = None,
    adapt: float | None = None,
    compiled: bool | None = None,
) -> RunScores:
    """Scores of ``trials``, those of ``problem`` in their order, each by the estimate without its fold.

    folds: numbers of the trials left out, together all; estimates: (folds, P) scaled, as of ``estimates_without``;
    sigma: (6,) by which errors are divided, by default pooled over the trials; adapt: seconds of past that a
    prediction may use; compiled: whether to use a C compiler, by default as the problem did. Raises UserError for
    trials without positions.
    """
    return scores_of_estimates(problem, trials, folds, [estimates], sigma, adapt, compiled)[0]


def scores_of_estimates(
    problem: Problem,
    trials: Sequence[Trial],
    folds: Sequence[Sequence[int]],
    several: Sequence[np.ndarray],
    sigma: np.ndarray | None = None,
    adapt: float | None = None,
    compiled: bool | None = None,
) -> list[RunScores]:
    """``scores_of_folds`` of ``several`` estimates of the ``folds``, (folds, P) each, all predicted side by side;
    problem, trials, sigma, adapt, compiled: as there."""
    own = np.full((len(several), len(trials), len(problem.ship.symbols)), np.nan)
    group = dict(zip(problem.segments.run.tolist(), problem.columns.window.tolist(), strict=True))
    for each, estimates in zip(own, several, strict=True):
        for out, p in zip(folds, estimates, strict=True):
            theta = np.atleast_2d(problem.coefficients(p))
            for i in out:
                each[i] = theta[group.get(i, 0)]
    sigma = pooled_sigma(trials) if sigma is None else sigma
    simulator = ShipsByTrial(
        problem.ship,
        own.reshape(-1, own.shape[2]),
        not problem.kernels.interpreted_because if compiled is None else compiled,
    )
    rows = score(simulator, [*trials] * len(several), sigma, adapt=adapt).trials
    return [run_scores(trials, rows[i : i + len(trials)], sigma) for i in range(0, len(rows), len(trials))]


def run_scores(trials: Sequence[Trial], rows: Sequence, sigma: np.ndarray) -> RunScores:  # type: ignore[type-arg]
    """Scores by run from the ``rows`` (``TrialScore``) of ``trials``, made with ``sigma`` (6,)."""
    counts = np.array([row.windows for row in rows])
    return RunScores(
        names=tuple(t.name for t in trials),
        kinds=tuple(t.kind for t in trials),
        window=np.where(counts > 0, [row.window for row in rows], np.nan),
        paper=np.where(counts > 0, [row.paper for row in rows], np.nan),
        windows=counts,
        sigma=np.asarray(sigma, dtype=float),
    )


def leave_out(
    found: Estimated,
    trials: Sequence[Trial],
    folds: Sequence[Sequence[int]] | None = None,
    sigma: np.ndarray | None = None,
    adapt: float | None = None,
    info: Information | None = None,
) -> RunScores:
    """How the calibration ``found`` predicts its own ``trials`` when they are left out, fold by fold.

    folds: numbers of the trials left out, default each alone; sigma (6,), adapt: as of ``scores_of_folds``; info: of
    the windows, by default that of the calibration; with other weights of windows or samples the estimate is what these
    make it. Takes about a second. Raises UserError for trials without positions.
    """
    chosen = each_alone(len(trials)) if folds is None else folds
    estimates = estimates_without(info or found.information, chosen, found.problem.p_bounds())
    return scores_of_folds(found.problem, trials, chosen, estimates, sigma, adapt)

"""Which loss, and how much of its information a run counts with: chosen by runs left out, without refits.

From one rough solution each candidate is a Newton step away: its weights of the samples give other informations of the
windows, and from these come the estimates without each run (fitting/selection/left_out_runs.py), which predict that
run. First the loss is chosen: a Gaussian one is efficient where residuals are, Huber's and Student's let a gust or a
run that does not agree count less. Then the share of its information that a run counts with: residuals of a run are
correlated over more than a window, and runs differ by what no coefficient describes, so that a run may hold far fewer
independent errors than its windows say (an effective sample size, Kish 1965); the prior then decides more.

Each run counts alike: a candidate is judged by the mean over runs of the logarithm by which the errors of a run change,
which a few bad runs cannot decide. It replaces the simpler one before it only if that is a gain of LEAST_GAIN and of
more than CLEARLY jackknife errors, and if no kind of manoeuvre becomes worse by more than ERRORS_WORSE of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cases.trial import Trial
from fitting.nlp.fisher_information import Information, information
from fitting.nlp.loss import LOSSES
from fitting.nlp.problem import Problem
from fitting.prediction.score import pooled_sigma
from fitting.selection.left_out_runs import (
    METRICS,
    Jackknifed,
    RunScores,
    apart,
    estimates_without,
    jackknifed,
    scores_of_estimates,
)
from fitting.settings import Settings
from fitting.solvers.ipopt import Solution
from fitting.solvers.noise_iteration import Choose, reweighed
from mmg.errors import UserError

WEIGHTS = (0.3, 0.1)
"""Shares of its information that a run may count with, beside all of it."""
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
class TriedWeighting:
    """One candidate: loss, share of the information, and its errors on runs left out.

    window, paper: mean of files of 30 s windows and 100 s restarts; change: ``log_change`` from the one before, with
    its jackknife ``error`` over runs; worse: kinds that forbid it; taken: whether the fit uses it; one of all is taken.
    """

    loss: str
    weight: float
    window: float
    paper: float
    change: float
    error: float
    worse: tuple[str, ...]
    taken: bool


@dataclass(frozen=True)
class Weighting:
    """The loss and the share of its information with which a run counts, and how they were found.

    tried: candidates in turn, the first one where the choice began; why: words where nothing could be tried; runs: that
    were left out in turn.
    """

    loss: str
    weight: float
    tried: tuple[TriedWeighting, ...] = ()
    why: str = ""
    runs: int = 0

    @property
    def sentence(self) -> str:
        """What was chosen and by how much, in words."""
        if self.why:
            return f"{self.loss} loss, not chosen by runs left out: {self.why}"
        first = self.tried[0]
        last = next(row for row in self.tried if row.taken)
        known = f"all {self.runs} runs left out in turn"
        counted = "" if self.weight == 1 else f", each run counted with {self.weight:.0%} of its information"
        if last is first:
            return f"{self.loss} loss{counted}: {known}, nothing else predicts them clearly better"
        steps = (("30 s windows", first.window, last.window), ("100 s restarts", first.paper, last.paper))
        words = ", ".join(f"{name} {b:.4f} instead of {a:.4f} ({b / a - 1:+.1%})" for name, a, b in steps)
        return f"{self.loss} loss{counted}: {known} (fast estimate), {words} with a {first.loss} one"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for result.json."""
        return {**asdict(self), "sentence": self.sentence}


def weighed(info: Information, weight: float) -> Information:
    """``info`` with windows that count with the share ``weight`` of their information."""
    return replace(info, fisher=weight * info.fisher, score=weight * info.score)


def log_change(before: RunScores, after: RunScores, kind: str | None = None) -> Jackknifed:
    """Mean over runs of the logarithm by which the errors change from ``before`` to ``after``, 30 s windows and 100 s
    restarts alike, with its jackknife error over runs; of all runs or of those of one ``kind``."""
    return jackknifed(np.mean([np.log(after.of(m, kind) / before.of(m, kind)) for m in METRICS], axis=0))


def kinds_worse(before: RunScores, after: RunScores) -> tuple[str, ...]:
    """Kinds of at least OF_KIND runs of which the errors rose clearly from ``before`` to ``after``: by LEAST_GAIN and
    ERRORS_WORSE jackknife errors."""
    found = []
    for kind in dict.fromkeys(k for k in before.kinds if k):
        change = log_change(before, after, kind)
        enough = int(np.isfinite(before.of("window", kind)).sum()) >= OF_KIND
        if enough and change.value > max(LEAST_GAIN, ERRORS_WORSE * change.error):
            found.append(kind)
    return tuple(found)


class _Choice:
    """Candidates from one rough solution, judged on the same runs."""

    def __init__(self, problem: Problem, x: np.ndarray, trials: Sequence[Trial]) -> None:
        self.problem, self.x, self.trials = problem, x, trials
        self.folds = apart(trials)
        self.sigma = pooled_sigma(trials)
        self.informations: dict[str, Information] = {}
        self.rows: list[TriedWeighting] = []

    def estimates(self, loss: str, weight: float) -> np.ndarray:
        """Estimates without the runs left out, (folds, P)."""
        if loss not in self.informations:
            self.informations[loss] = information(reweighed(self.problem, self.x, loss), self.x)
        info = weighed(self.informations[loss], weight)
        return estimates_without(info, self.folds, self.problem.p_bounds())

    def scores(self, candidates: Sequence[tuple[str, float]]) -> list[RunScores]:
        """Scores of the runs left out, by each of ``candidates`` (loss, weight)."""
        several = [self.estimates(*candidate) for candidate in candidates]
        return scores_of_estimates(self.problem, self.trials, self.folds, several, self.sigma)

    def begin(self, loss: str, weight: float) -> None:
        self.loss, self.weight = loss, weight
        self.first = self.best = self.scores([(loss, weight)])[0]
        self.rows.append(self._row(loss, weight, self.first, Jackknifed(0.0, 0.0), (), True))

    def offer(self, candidates: Sequence[tuple[str, float]]) -> None:
        """The best of ``candidates`` (loss, weight) replaces the present choice if it is clearly better."""
        tried = []
        for (loss, weight), scores in zip(candidates, self.scores(candidates), strict=True):
            change, worse = log_change(self.best, scores), kinds_worse(self.best, scores)
            good = change.value < -max(LEAST_GAIN, CLEARLY * change.error) and not worse
            tried.append(
                (change.value if good else np.inf, scores, self._row(loss, weight, scores, change, worse, False))
            )
        least = min(tried, key=lambda t: t[0], default=None)
        better = least is not None and bool(np.isfinite(least[0]))
        if least and better:
            self.best, self.loss, self.weight = least[1], least[2].loss, least[2].weight
            self.rows = [replace(row, taken=False) for row in self.rows]
        self.rows += [replace(t[2], taken=better and t is least) for t in tried]

    @staticmethod
    def _row(
        loss: str, weight: float, scores: RunScores, change: Jackknifed, worse: tuple[str, ...], taken: bool
    ) -> TriedWeighting:
        window, paper = (scores.mean(m).value for m in METRICS)
        return TriedWeighting(loss, weight, window, paper, change.value, change.error, worse, taken)


@np.errstate(all="ignore")
def choose_weighting(
    problem: Problem, x: np.ndarray, trials: Sequence[Trial], loss: str | None, weight: float | None
) -> Weighting:
    """Loss and share of the information for ``problem`` of ``trials``, from its rough solution x (n,).

    loss, weight: what is not to be chosen, None: what is. Never fails for want of runs or positions: it then says why
    nothing was chosen.
    """
    kept = partial(Weighting, loss or LOSSES[0], 1.0 if weight is None else weight)
    if len(trials) < FEWEST:
        return kept(why=f"{len(trials)} run{'s' * (len(trials) > 1)}, fewer than {FEWEST}")
    try:
        choice = _Choice(problem, x, trials)
        choice.begin(loss or LOSSES[0], 1.0 if weight is None else weight)
    except UserError as error:
        return kept(why=str(error))
    if len(choice.folds) < FEWEST or np.isnan(choice.first.mean("window").value):
        return kept(why="runs left out are not predicted, or too few of them are different")
    if loss is None:
        choice.offer([(name, choice.weight) for name in LOSSES[1:]])
    if weight is None:
        choice.offer([(choice.loss, share) for share in WEIGHTS])
    return Weighting(choice.loss, choice.weight, tuple(choice.rows), runs=len(trials))


class OpenWeighting:
    """The choice of what the ``settings`` leave open of loss and weight of the runs, of ``trials``."""

    def __init__(self, trials: Sequence[Trial], settings: Settings) -> None:
        self.trials, self.settings = trials, settings
        self.made: Weighting | None = None
        self.open = settings.loss is None or settings.weight is None

    @property
    def choose(self) -> Choose | None:
        """What chooses; None where nothing is open."""
        return self._choose if self.open else None

    def _choose(self, problem: Problem, x: np.ndarray) -> tuple[str, float]:
        self.made = choose_weighting(problem, x, self.trials, self.settings.loss, self.settings.weight)
        return self.made.loss, self.made.weight

    def weighting(self, solution: Solution) -> Weighting | None:
        """What was chosen; None where nothing was open, and for a solver that was stopped before the choice."""
        if self.made or not self.open or not solution.at_end:
            return self.made
        s, why = self.settings, "a single pass has no rough solution to choose from"
        weight = 1.0 if s.weight is None else s.weight
        return Weighting(s.loss or LOSSES[0], weight, why="sigma is given" if s.sigma else why)

"""Whether a trained residual is worth keeping: better on windows that it never saw, beyond what chance makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite, nan, sqrt

import numpy as np

from residual.training.decision import MINIMUM_GAIN, Decision
from residual.training.folds import FOLDS
from residual.training.trainer import Outcome


def decide(outcomes: Sequence[Outcome]) -> Decision:
    """Whether to keep the residual of ``outcomes``: windows improve by 1 % and by more than two measures of chance.

    These are the standard deviation over the trainings (not the standard error of their mean, which would be
    1 / sqrt(n) of it) and the standard error by the choice of runs. The 100 s restarts may become worse by no more than
    the standard error of their mean over trainings. Both are the stricter choices.
    """
    good = [o for o in outcomes if o.status != "diverged"]
    if not good:
        words = "every training diverged, also at lower rates: the calibrated ship stays as it is"
        return Decision(False, words, nan, nan, nan, nan, reason="every training diverged, also at lower rates")
    window, spread = _pooled(good, 0)
    restart, restart_spread = _pooled(good, 1)
    among_seeds, among_folds = _parts(good)
    runs = _runs_error(good)
    figures = f"judged 30 s windows {window:+.1%} better, spread of {len(good)} seed(s) {spread:.1%}"
    if isfinite(runs):
        figures += f", standard error by the choice of runs {runs:.1%}"
    if isfinite(restart):
        figures += f"; 100 s restarts {restart:+.1%} better, spread {restart_spread:.1%}"
    worst = restart_spread / sqrt(len(good))
    faults = (
        (-inf in (window, restart), "its predictions diverge where those of the calibrated ship do not"),
        (not window >= MINIMUM_GAIN, f"less than {MINIMUM_GAIN:.0%} is gained"),
        (window <= spread, "the gain is within the spread of seeds"),
        (isfinite(runs) and window <= runs, "the gain is within what the choice of judged runs makes of it"),
        (restart < -worst, "the 100 s restarts became worse beyond the standard error over seeds"),
    )
    reason = next((words for fails, words in faults if fails), "")
    words = f"residual NOT kept, the calibrated ship stays as it is, because {reason}" if reason else "residual kept"
    words = f"{words} ({figures})" if reason else f"{words}: {figures}"
    found = (window, spread, restart, restart_spread, among_seeds, among_folds, runs)
    return Decision(not reason, words, *found, reason)


def _pooled(outcomes: Sequence[Outcome], which: int) -> tuple[float, float]:
    """Improvement of all judged windows together and its standard deviation over trainings; 0 for a single one.

    A training counts by its share in the error before, so that the mean of its gains is the pooled one: half of next
    to nothing, in a part that the ship already predicts well, is little.
    """
    rows = [(o.before[which], o.after[which], max(1, o.held_out_windows)) for o in outcomes]
    before, after, count = np.array([row for row in rows if isfinite(row[0])]).reshape(-1, 3).T
    if not len(before):
        return nan, nan
    if not np.isfinite(after).all():
        return -inf, nan
    gain, share = 1 - after / before, before * count / (before * count).sum()
    pooled = float(share @ gain)
    spread = sqrt(share @ (gain - pooled) ** 2 * len(gain) / (len(gain) - 1)) if len(gain) > 1 else 0.0
    return pooled, spread


def _parts(outcomes: Sequence[Outcome]) -> tuple[float, float]:
    """Standard deviations of the gain of 30 s windows: among seeds judged by the same part, among means of parts."""
    gains: dict[int, list[float]] = {}
    for o in outcomes:
        gains.setdefault(o.fold, []).append(1 - o.after[0] / o.before[0])
    several = [np.var(g, ddof=1) for g in gains.values() if len(g) > 1]
    free = [len(g) - 1 for g in gains.values() if len(g) > 1]
    seeds = sqrt(np.average(several, weights=free)) if several else nan
    folds = float(np.std([np.mean(g) for g in gains.values()], ddof=1)) if several and len(gains) > 1 else nan
    return seeds, folds


def _runs_error(outcomes: Sequence[Outcome]) -> float:
    """Jackknife over runs, pieces of them where they are fewer than FOLDS: standard error of the pooled improvement."""
    rows = np.vstack([o.judged for o in outcomes])
    keys = rows[:, :1] if len(np.unique(rows[:, 0])) >= FOLDS else rows[:, :2]
    which = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    groups = int(which.max()) + 1 if len(rows) else 0
    if groups < 3:
        return nan
    sums = np.array([np.bincount(which, column) for column in rows[:, 2:].T])
    others = sums.sum(axis=1, keepdims=True) - sums
    gains = 1 - others[1] / others[0]
    return sqrt((groups - 1) / groups * ((gains - gains.mean()) ** 2).sum())

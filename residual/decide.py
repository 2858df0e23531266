"""Whether a trained residual is worth keeping: better on whole runs that it never saw, beyond chance. Needs no torch.

Chance is a jackknife over the runs that judged (Efron 1982), of which each is one observation however long it is. Runs
of a day share its wind and its instruments, and runs of a kind what the ship does in them: where the gain scatters more
among days or among kinds than among runs, these are the observations. The interval is Student's, of which few
observations make a wide one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from cases.io.campaigns import campaign_labels
from cases.trial import Trial
from residual.splits import WHOLE

if TYPE_CHECKING:
    from residual.train import Outcome, Task

MINIMUM_GAIN = 0.01
"""Smallest mean improvement of the judged 30 s windows that is worth a network."""


@dataclass(frozen=True)
class Decision:
    """Whether a residual is worth keeping, and why in words.

    Shares by which judged windows became better (positive), pooled over all trainings: improvement: of the 30 s
    windows; restarts: of the 100 s restarts (NaN: none fits); spread, restarts_spread: their standard deviations over
    the trainings, each from another seed and judged by its part; of these, seed_spread: among trainings judged by the
    same part, fold_spread: among the means of parts (NaN where they cannot be separated); runs_error: standard error
    of the improvement by the choice of judged runs, or of their days or kinds where that is more (NaN for fewer than
    two); lowest, highest: ends of the 90 % interval of the improvement on other runs, by that error (NaN where it is);
    groups: how many runs, days or kinds it rests on; reason: why it is not kept, as a clause; past_s: seconds of past
    that the compared predictions used, with and without the residual alike.
    """

    kept: bool
    words: str
    improvement: float
    spread: float
    restarts: float
    restarts_spread: float
    seed_spread: float = nan
    fold_spread: float = nan
    runs_error: float = nan
    reason: str = ""
    lowest: float = nan
    highest: float = nan
    groups: int = 0
    past_s: float = 0.0


LEVEL = 0.95
"""One-sided probability of chance's limit: the interval on other runs holds 90 %."""
BLOCK = 5
"""Windows that count as one observation where fewer than WHOLE runs judge: 75 s."""
KIND_WORSE = 2.0
"""Standard errors by which a kind of manoeuvre may become worse."""


@dataclass(frozen=True)
class Judges:
    """What is known of the runs that judge, by their number: kinds, days; whole: they took no part in the training."""

    kinds: tuple[str, ...] = ()
    days: tuple[str, ...] = ()
    whole: bool = True

    @classmethod
    def of(cls, trials: Sequence[Trial], tasks: Sequence[Task], apart: bool) -> Judges:
        """Of the ``trials`` that judge the ``tasks``; apart: they are not the trials to train on."""
        shared = any({p.run for p in t.split.judge} & {p.run for p in t.split.train} for t in tasks)
        return cls(tuple(t.kind for t in trials), tuple(campaign_labels(trials)), apart or not shared)


def decide(outcomes: Sequence[Outcome], judges: Judges | None = None) -> Decision:
    """Whether to keep the residual of ``outcomes``, judged by runs of which ``judges`` says what is known.

    The 30 s windows must improve by MINIMUM_GAIN, by more than the standard deviation over the trainings (not the
    standard error of their mean, which would be 1 / sqrt(n) of it), and on other runs with a probability of LEVEL. No
    kind of manoeuvre may become worse beyond KIND_WORSE of its standard errors, nor the 100 s restarts beyond the
    standard error of their mean over trainings. Parts of runs that were trained on decide nothing.
    """
    judges = judges or Judges()
    good = [o for o in outcomes if o.status != "diverged"]
    if not good:
        words = "every training diverged, also at lower rates: the calibrated ship stays as it is"
        return Decision(False, words, nan, nan, nan, nan, reason="every training diverged, also at lower rates")
    window, spread = _pooled(good, 0)
    restart, restart_spread = _pooled(good, 1)
    among_seeds, among_folds = _parts(good)
    rows = np.vstack([_numbered(o.judged) for o in good])
    chance = _chance(rows, judges)
    limit = chance.limit
    figures = f"judged 30 s windows {window:+.1%} better, spread of {len(good)} seed(s) {spread:.1%}"
    if isfinite(limit):
        figures += (
            f", on other runs {window - limit:+.1%} to {window + limit:+.1%} (90 %, by {chance.groups} {chance.what})"
        )
    if isfinite(restart):
        figures += f"; 100 s restarts {restart:+.1%} better, spread {restart_spread:.1%}"
    worst = restart_spread / sqrt(len(good))
    worse = _kinds_worse(rows, judges)
    faults = (
        (-inf in (window, restart), "its predictions diverge where those of the calibrated ship do not"),
        (not window >= MINIMUM_GAIN, f"less than {MINIMUM_GAIN:.0%} is gained"),
        (window <= spread, "the gain is within the spread of seeds"),
        (isfinite(limit) and window <= limit, "the gain is within what the choice of judged runs makes of it"),
        (len(rows) > 0 and not isfinite(limit), "too little judged it to tell the gain from chance"),
        (bool(worse), f"the 30 s windows of {' and '.join(worse)} became worse"),
        (restart < -worst, "the 100 s restarts became worse beyond the standard error over seeds"),
        (
            not judges.whole,
            f"no whole run judged it (fewer than {WHOLE} runs; give --validate one that is not trained on)",
        ),
    )
    reason = next((words for fails, words in faults if fails), "")
    words = f"residual NOT kept, the calibrated ship stays as it is, because {reason}" if reason else "residual kept"
    words = f"{words} ({figures})" if reason else f"{words}: {figures}"
    found = (window, spread, restart, restart_spread, among_seeds, among_folds, chance.error)
    ends = (window - limit, window + limit, chance.groups)
    return Decision(not reason, words, *found, reason, *ends)


@dataclass(frozen=True)
class _Chance:
    """Standard error of a gain by the choice of so many groups, called ``what``; limit: half of its 90 % interval."""

    error: float
    groups: int
    what: str

    @property
    def limit(self) -> float:
        return self.error * float(stdtrit(self.groups - 1, LEVEL)) if self.groups > 1 else nan


def _numbered(judged: np.ndarray) -> np.ndarray:
    """The judged rows (run, first row of the piece, before, after) of a training, the number of their block behind."""
    piece = np.unique(judged[:, :2], axis=0, return_inverse=True)[1].ravel()
    number = np.array([(piece[:i] == k).sum() for i, k in enumerate(piece)], dtype=int)
    return np.column_stack([judged, number // BLOCK])


def _chance(rows: np.ndarray, judges: Judges) -> _Chance:
    """That of the improvement of all judged ``rows``: the widest by runs, by days and by kinds."""
    runs = rows[:, 0].astype(int)
    if len(np.unique(runs)) < WHOLE:
        blocks = np.unique(rows[:, [0, 1, 4]], axis=0, return_inverse=True)[1].ravel() if len(rows) else runs
        return _jackknife(rows, blocks, f"blocks of {len(np.unique(runs))} run(s)")
    found = [_jackknife(rows, runs, "runs")]
    for labels, what in ((judges.days, "days"), (judges.kinds, "kinds of manoeuvre")):
        if len({labels[run] for run in runs} if labels else ()) >= WHOLE:
            names = sorted(set(labels))
            found.append(_jackknife(rows, np.array([names.index(labels[run]) for run in runs]), what))
    return max(found, key=lambda c: c.limit)


def _jackknife(rows: np.ndarray, which: np.ndarray, what: str) -> _Chance:
    """Standard error of the pooled improvement of ``rows`` by groups, numbered by ``which`` (rows,)."""
    number = np.unique(which, return_inverse=True)[1].ravel()
    groups = int(number.max()) + 1 if len(rows) else 0
    if groups < 2:
        return _Chance(nan, groups, what)
    sums = np.array([np.bincount(number, column) for column in rows[:, 2:4].T])
    others = sums.sum(axis=1, keepdims=True) - sums
    gains = 1 - others[1] / others[0]
    return _Chance(sqrt((groups - 1) / groups * ((gains - gains.mean()) ** 2).sum()), groups, what)


def _kinds_worse(rows: np.ndarray, judges: Judges) -> list[str]:
    """Kinds of WHOLE judged runs or more whose windows became worse beyond chance."""
    runs, worse = rows[:, 0].astype(int), []
    for kind in sorted({judges.kinds[run] for run in runs} if judges.kinds else ()):
        own = rows[np.array([judges.kinds[run] == kind for run in runs])]
        if kind and len(np.unique(own[:, 0])) >= WHOLE:
            gain = 1 - own[:, 3].sum() / own[:, 2].sum()
            if gain < -max(MINIMUM_GAIN, KIND_WORSE * _jackknife(own, own[:, 0], kind).error):
                worse.append(kind)
    return worse


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

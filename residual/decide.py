"""Whether a trained residual is worth keeping: better on whole runs that it never saw, beyond chance. Needs no torch.

Chance is a jackknife over the runs that judged (Efron 1982), of which each is one observation however long it is. The
interval is Student's, of which few observations make a wide one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from residual.splits import WHOLE

if TYPE_CHECKING:
    from residual.train import Outcome, Task

MINIMUM_GAIN = 0.01  # Smallest mean improvement of the judged 30 s windows that is worth a network. Set by hand.
LEVEL = 0.95  # One-sided probability of chance's limit: the interval holds 90 %, as all intervals of the program
BLOCK = 5  # Windows that count as one observation where fewer than WHOLE runs judge: 75 s. Set by hand.


@dataclass(frozen=True)
class Decision:
    """Whether a residual is worth keeping, and why in words.

    Shares by which judged windows became better (positive), pooled over all trainings: improvement: of the 30 s
    windows; restarts: of the 100 s restarts (NaN: none fits); spread, restarts_spread: their standard deviations over
    the trainings, each from another seed and judged by its part; runs_error: standard error of the improvement by the
    choice of judged runs (NaN for fewer than two); lowest, highest: ends of the 90 % interval of the improvement on
    other runs, by that error (NaN where it is); groups: how many runs it rests on; reason: why it is not kept, as a
    clause; past_s: seconds of past that the compared predictions used, with and without the residual alike.
    """

    kept: bool
    words: str
    improvement: float  # shares, 0.05 for 5 % less error
    spread: float
    restarts: float
    restarts_spread: float
    runs_error: float = nan
    reason: str = ""
    lowest: float = nan
    highest: float = nan
    groups: int = 0
    past_s: float = 0.0


def percent(share: float | None, sign: bool = True) -> str:
    """A ``share`` in per cent with a true minus sign, and a plus where ``sign`` is wanted."""
    if share is None or not isfinite(share):
        return "–"
    if abs(share) < 0.0005:  # what one digit shows as zero has no sign
        return "0.0 %"
    return f"{share:{'+' if sign else ''}.1%}".replace("-", "−").replace("%", " %")


def judged_by_whole_runs(tasks: Sequence[Task]) -> bool:
    """Whether the runs that judge ``tasks`` take no part in their training, not even as other stretches of time."""
    return not any({p.run for p in t.split.judge} & {p.run for p in t.split.train} for t in tasks)


def decide(outcomes: Sequence[Outcome], whole_runs: bool = True) -> Decision:
    """Whether to keep the residual of ``outcomes``; whole_runs: those that judged took no part in the training.

    The 30 s windows must improve by MINIMUM_GAIN, by more than the standard deviation over the trainings (not the
    standard error of their mean, which would be 1 / sqrt(n) of it), and on other runs with a probability of LEVEL. The
    100 s predictions may not become worse beyond their standard error by the choice of runs. Parts of runs that were
    trained on decide nothing.
    """
    good = [o for o in outcomes if o.status != "diverged"]
    if not good:
        reason = "every training diverged, also at lower rates"
        return Decision(False, _words(reason), nan, nan, nan, nan, reason=reason)
    window, spread = _pooled(good, 0)  # 30 s windows
    restart, restart_spread = _pooled(good, 1)  # 100 s restarts
    rows = np.vstack([_numbered(o.judged) for o in good])  # of all trainings together: each has judged other runs
    (error, limit, groups), (long_error, long_limit, _) = map(
        _chance, (rows, np.vstack([_numbered(o.restarts_judged) for o in good]))
    )
    # of single trainings where their runs are too few
    harm = long_error if isfinite(long_error) else restart_spread / sqrt(len(good))
    faults = (
        (-inf in (window, restart), "its predictions diverge where those of the calibrated ship do not"),
        # written so that NaN is a fault
        (not window >= MINIMUM_GAIN, f"less than {MINIMUM_GAIN:.0%} is gained"),
        (window <= spread, "the gain is within the spread of seeds"),
        (isfinite(limit) and window <= limit, "the gain is within what the choice of judged runs makes of it"),
        (len(rows) > 0 and not isfinite(limit), "too little judged it to tell the gain from chance"),
        (restart < -harm, "the 100 s predictions became worse beyond their standard error"),
        (
            not whole_runs,
            f"no whole run judged it (fewer than {WHOLE} runs; give --validate one that is not trained on)",
        ),
    )
    # the first fault alone: they are ordered from what rules out all else to what is closest to a decision
    reason = next((words for fails, words in faults if fails), "")
    chance = f"chance: {percent(spread, False)} among {len(good)} training(s)"
    if isfinite(limit):
        chance += f", on other runs {percent(window - limit)} to {percent(window + limit)}, 90 %"
    longer = "" if np.isnan(restart) else f"; 100 s predictions {_changed(restart)}"
    seen = [f"{percent(size, False)} over {s} s" for size, s in ((limit, 30), (long_limit, 100)) if isfinite(size)]
    longer += f"; a change of {' and '.join(seen)} would have been seen" if seen else ""
    figures = f"30 s predictions of windows it had never seen {_changed(window)} ({chance}){longer}"
    ends = (window - limit, window + limit, groups)
    words = _words(reason, figures)
    return Decision(not reason, words, window, spread, restart, restart_spread, error, reason, *ends)


def _words(reason: str, figures: str = "") -> str:
    """The decision in one sentence; reason: why the residual is declined, "" where it is kept."""
    declined = f"The residual is declined and the calibrated ship stays as it is, because {reason}"
    return ": ".join(filter(None, (declined if reason else "The residual is kept", figures))) + "."


def _changed(gain: float) -> str:
    """A ``gain`` as a share in words: "become 1.2 % better" or the like."""
    if not isfinite(gain):
        return "diverge"
    if abs(gain) < 0.0005:
        return "stay as they are"
    return f"become {percent(abs(gain), False)} {'better' if gain > 0 else 'worse'}"


def _numbered(judged: np.ndarray) -> np.ndarray:
    """The judged rows (run, first row of the piece, before, after) of a training, the number of their block behind."""
    piece = np.unique(judged[:, :2], axis=0, return_inverse=True)[1].ravel()
    number = np.array([(piece[:i] == k).sum() for i, k in enumerate(piece)], dtype=int)
    return np.column_stack([judged, number // BLOCK])


def _chance(rows: np.ndarray) -> tuple[float, float, int]:
    """Standard error of the pooled improvement of all judged ``rows`` by the choice of runs, half of its 90 % interval,
    which is the least improvement that is told from chance, and how many runs these are.

    Of fewer than WHOLE runs by blocks of their windows; NaN of fewer than two.
    """
    # runs are independent, windows of one are not; blocks of windows stand for runs where there are too few
    which = rows[:, :1] if len(np.unique(rows[:, 0])) >= WHOLE else rows[:, [0, 1, 4]]
    number = np.unique(which, axis=0, return_inverse=True)[1].ravel()
    groups = int(number.max()) + 1 if len(rows) else 0
    if groups < 2:
        return nan, nan, groups
    sums = np.array([np.bincount(number, column) for column in rows[:, 2:4].T])  # (2, groups): before, after
    others = sums.sum(axis=1, keepdims=True) - sums  # of all groups but one
    gains = 1 - others[1] / others[0]  # of sums, not the mean of ratios: a run with next to no error before would rule
    error = sqrt((groups - 1) / groups * ((gains - gains.mean()) ** 2).sum())  # the jackknife's standard error
    # Student's t by scipy.special: scipy.stats takes long to import, and a decision is also read without training
    return error, error * float(stdtrit(groups - 1, LEVEL)), groups


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
        return -inf, nan  # a prediction that diverges is worse than any gain elsewhere can make up for
    gain, share = 1 - after / before, before * count / (before * count).sum()
    pooled = float(share @ gain)
    # weighted as the mean is; n / (n - 1) as for an ordinary standard deviation
    spread = sqrt(share @ (gain - pooled) ** 2 * len(gain) / (len(gain) - 1)) if len(gain) > 1 else 0.0
    return pooled, spread

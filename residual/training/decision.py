"""What is decided on a residual. ``residual.training.acceptance`` decides; reports read it without torch."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

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

"""What a comparison of groups of trials found, as data: the part "between" of ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitting.report.run_folder import Real


@dataclass(frozen=True)
class GroupValue:
    """A parameter in one group of trials, with its standard error; difference: from the mean of the other groups, which
    is known better than the value where all groups share an error."""

    value: Real
    std: Real
    difference: Real
    difference_std: Real


@dataclass(frozen=True)
class GroupParameter:
    """A parameter that may differ between groups: its unit, what it is in words, and its value in each group."""

    unit: str
    words: str
    groups: Mapping[str, GroupValue]


@dataclass(frozen=True)
class GroupDifference:
    """An effect, an instrument or a coefficient, tested for different values in groups of trials.

    nature: "instrument", "surroundings" or "ship"; source: "kinematics" (without a model) or "dynamics"; group: the one
    that differs most from the others; statistic: chi-squared with ``degrees``; p_value: corrected for the number of
    tests; log_bayes: log Bayes factor for different values; equivalence_class: what imitates it in these trials.
    """

    name: str
    nature: str
    source: str
    group: str
    parameters: Mapping[str, GroupParameter]
    statistic: Real
    degrees: int
    p_value: Real
    log_bayes: Real
    equivalence_class: tuple[str, ...] = ()


@dataclass(frozen=True)
class Between:
    """Differences between groups of trials.

    by: what the trials of a group have in common; groups: name -> its trials; verdict: "none", "named" or "unknown", in
    words ``sentence``; differences: those named; candidates: all tested, strongest first; remainder: the groups differ
    in something else as well; warnings: what cannot be concluded.
    """

    by: str
    groups: Mapping[str, tuple[str, ...]]
    verdict: str
    sentence: str
    differences: tuple[GroupDifference, ...]
    candidates: tuple[GroupDifference, ...]
    remainder: bool
    warnings: tuple[str, ...] = ()

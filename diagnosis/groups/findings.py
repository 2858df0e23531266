"""What a comparison of groups of trials says, as data: the part "between" of ``diagnosis.json``, and its rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cases.io.groups import Groups
from fitting.report.run_folder import Real
from fitting.uncertainty.group_test import GroupTest


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


def parameters_by_group(
    groups: Groups, words: Mapping[str, tuple[str, str]], values: np.ndarray, covariance: np.ndarray
) -> dict[str, GroupParameter]:
    """Parameters in each of G ``groups``.

    words: name -> unit and meaning of p parameters; values: (G p,) and covariance: (G p, G p) of their values, those of
    a group together. Returns them by name.
    """
    p, G = len(words), len(groups.names)
    out = {}
    for j, (name, (unit, meaning)) in enumerate(words.items()):
        own, C = values[j::p], covariance[j::p, j::p]
        weights = (np.eye(G) * G - 1.0) / (G - 1)
        rows = zip(own, np.diag(C), weights @ own, np.einsum("ga,ab,gb->g", weights, C, weights), strict=True)
        each = (GroupValue(float(v), float(c**0.5), float(d), float(max(e, 0.0) ** 0.5)) for v, c, d, e in rows)
        out[name] = GroupParameter(unit, meaning, dict(zip(groups.names, each, strict=True)))
    return out


def group_row(
    name: str, nature: str, source: str, parts: Mapping[str, GroupParameter], test: GroupTest, p: float
) -> GroupDifference:
    """A row of the result: the group that differs most, the last of several, and what the ``test`` says.

    name, nature, source: as of the row; parts: its parameters; p: probability corrected for the number of tests.
    """
    groups = [p.groups for p in parts.values()]
    sigmas = {k: max(abs(g[k].difference) / max(g[k].difference_std, 1e-300) for g in groups) for k in groups[0]}
    most = max(list(sigmas)[::-1], key=lambda k: round(sigmas[k], 6))
    return GroupDifference(name, nature, source, most, parts, test.statistic, test.degrees, p, test.log_bayes)

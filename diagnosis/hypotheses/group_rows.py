"""Rows of the result of a comparison of groups of trials."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cases.io.groups import Groups
from diagnosis.hypotheses.group_findings import GroupDifference, GroupParameter, GroupValue
from fitting.uncertainty.group_test import GroupTest


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
    """A row of the result: the group that differs most, and what the ``test`` says.

    name, nature, source: as of the row; parts: its parameters; p: probability corrected for the number of tests.
    """
    names = tuple(next(iter(parts.values())).groups)
    off = {
        g: max(abs(x.groups[g].difference) / max(x.groups[g].difference_std, 1e-300) for x in parts.values())
        for g in names
    }
    most = max(names[::-1], key=lambda g: round(off[g], 6))
    return GroupDifference(name, nature, source, most, parts, test.statistic, test.degrees, p, test.log_bayes)

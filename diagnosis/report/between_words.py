"""Differences between groups of trials in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from diagnosis.hypotheses.group_findings import Between, GroupDifference, GroupParameter
from diagnosis.report.where_words import shown_unit
from fitting.report.words import plus_minus
from mmg.effects import EFFECTS

Z90 = 1.645
"""Half width of a 90 % interval, in standard errors."""


SHOWN = 12
"""Tests in the table of the report."""


def sentence(by: str, verdict: str, named: Sequence[GroupDifference], reasons: Sequence[str]) -> str:
    """What differs between groups ``by`` day (or folder, ...), in words.

    verdict: "none", "named" or "unknown"; named: the differences; reasons: why more has no name. Returns text.
    """
    if verdict == "none":
        return f"between groups by {by} nothing differs beyond chance and the scatter of the runs"
    if verdict == "unknown":
        return f"the groups by {by} do not agree, and what differs has no name: {reasons[0]}"
    words = f"between groups by {by}: {'; '.join(difference(d) for d in named)}"
    return words + ("; they differ in more, which has no name" if reasons else "")


def difference(d: GroupDifference) -> str:
    """The named difference ``d`` in words, with 90 % intervals."""
    sizes = ", ".join(f"{_symbol(d, name)}{size(p, d.group, d)}" for name, p in d.parameters.items())
    alike = f" (or {', '.join(d.equivalence_class)}, which would explain it as well)" if d.equivalence_class else ""
    meaning = "".join(f", {p.words}" for p in d.parameters.values() if p.words and len(d.parameters) == 1)
    return f"{d.name}{alike} in {d.group}, {sizes} against the others ({d.nature}{meaning})"


def _symbol(d: GroupDifference, name: str) -> str:
    """A parameter before its size, unless it is what differs itself."""
    return "" if name == d.name else f"{name} "


def size(p: GroupParameter, group: str, d: GroupDifference) -> str:
    """By how much a parameter ``p`` of ``d`` is larger in a ``group`` than in the others, with its 90 % interval; a
    coefficient in per cent."""
    x = p.groups[group]
    factor, unit = shown_unit(p.unit)
    rest = x.value - x.difference
    if d.name not in EFFECTS and d.source == "dynamics" and abs(rest) > Z90 * x.difference_std:
        factor, unit = 100.0 / rest, "%"
    text = plus_minus(factor * x.difference, Z90 * abs(factor) * x.difference_std)
    return f"{'+' if factor * x.difference > 0 else ''}{text} {unit}".rstrip()


def rows(b: Between) -> list[dict[str, Any]]:
    """Rows of the strongest tests of ``b``: what, p, log Bayes factor, value ± std by group, whether named."""
    out = []
    for d in b.candidates[:SHOWN]:
        for name, p in d.parameters.items():
            factor, unit = shown_unit(p.unit)
            cells = [plus_minus(factor * x.value, factor * x.std) for x in p.groups.values()]
            named = any((d.name, d.source, name) == (e.name, e.source, k) for e in b.differences for k in e.parameters)
            out.append(
                {"name": d.name, "parameter": name, "words": p.words, "unit": unit, "nature": d.nature, "named": named}
                | {"source": d.source, "p": d.p_value, "log_bayes": d.log_bayes, "cells": cells}
            )
    return out

"""What the answers to opened cases got right: counts by kind and strength, and the misses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.blind.cases import FOREIGN, Case
from benchmarks.record import Figure, table

STRENGTHS = ("weak", "medium", "strong")
Answer = Sequence[Any]
"""Verdict, names, whether something is left over."""
Pair = tuple[Case, Mapping[str, Any]]
"""A case, and the row of its answer."""
KINDS = {"null": "nothing there: none", FOREIGN: "a cause without a name: unknown or a remainder",
         "pair": "two effects: both named, nothing else", "library": "an effect: named"}  # fmt: skip
"""What each kind is to be answered."""
ANCHORS = {FOREIGN: "foreign"}
"""Words of the anchors of figures where they are not the kind."""


def is_right(kind: str, truth: Sequence[str], answer: Answer) -> bool:
    """Whether an ``answer`` is as it should be: nothing said of nothing, something without a name seen of a stranger,
    both of a pair, else the first name that of the truth."""
    verdict, names, left = answer
    if kind == "null":
        return bool(verdict == "none")
    if kind == FOREIGN:
        return verdict == "unknown" or (verdict == "named" and left)
    return verdict == "named" and (set(names) == set(truth) if kind == "pair" else names[0] in truth)


def is_wrong(kind: str, truth: Sequence[str], answer: Answer) -> bool:
    """Whether a name that is not there is given with nothing left over."""
    verdict, names, left = answer
    return verdict == "named" and not left and names[0] not in truth


def right(pair: Pair) -> bool:
    """Whether a case is answered as it should be."""
    return is_right(pair[0].kind, tuple(pair[0].truth), pair[1]["answer"])


def wrong(pair: Pair) -> bool:
    """Whether a case is given a name that is not there."""
    return is_wrong(pair[0].kind, tuple(pair[0].truth), pair[1]["answer"])


def misses(pairs: Sequence[Pair]) -> list[str]:
    """A table of the cases that were not answered as they should be."""
    lines = []
    for case, row in (p for p in pairs if not right(p)):
        verdict, names, left = row["answer"]
        said = " + ".join(names) + (" and more" if left else "") if names else verdict
        first = " > ".join(c[0] for c in row["evidence"].get("candidates", [])[:3])
        lines.append([case.folder.name, case.kind, case.label, case.strength, said, first])
    return (
        table(["case", "kind", "truth", "strength", "answer", "first three candidates"], lines) if lines else ["none"]
    )


def scored(pairs: Sequence[Pair], name: str) -> list[str]:
    """The score of the world ``name`` in markdown: how long it took, the counts, and the misses."""
    spent = [row["processor"] for _, row in pairs]
    rows = [[f.what, f"{f.value:g} of {f.of}"] for f in figures(pairs, name).values()]
    rows += [["failed", f"{sum(row['answer'][0] == 'error' for _, row in pairs)} of {len(pairs)}"]]
    head = f"{len(pairs)} cases; seconds of processor per case: median {np.median(spent):.0f}, most {max(spent):.0f}."
    return [head, "", *table(["measure", "count"], rows), "", "Not answered as they should be:", "", *misses(pairs)]


def figures(pairs: Sequence[Pair], name: str) -> dict[str, Figure]:
    """Figures for the record, their anchors ending with ``name``: what each kind is to be answered."""
    made = {}
    for kind, words in KINDS.items():
        some = [p for p in pairs if kind == p[0].kind]
        for strength in STRENGTHS if kind == "library" else ("",):
            part = [p for p in some if strength in ("", p[0].strength)]
            if part:
                mark = "_".join(word for word in ("blind", ANCHORS.get(kind, kind), strength, name) if word)
                what = f"blind cases, {name}: {strength + ' ' if strength else ''}{words}"
                made[mark] = Figure(what, sum(map(right, part)), of=len(part))
    what = f"blind cases, {name}: a name that is not there"
    return made | {f"blind_wrong_{name}": Figure(what, sum(map(wrong, pairs)), of=len(pairs))}

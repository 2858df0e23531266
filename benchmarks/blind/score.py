"""The score of the answers to blind cases: rates by strength with their intervals, medians, the misses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import beta

from benchmarks.blind.rows import (
    MISFIT,
    Row,
    closure,
    covered,
    in_group,
    one_too_many,
    right,
    rightly_named,
    top1,
    unnamed_seen,
    wrongly_named,
)
from benchmarks.record import Figure, table

STRENGTHS = ("weak", "medium", "strong")


def interval(k: int, n: int) -> tuple[float, float]:
    """Clopper-Pearson interval (95 %) of a rate k of n."""
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    return low, float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0


def cell(k: int, n: int) -> str:
    """A rate with its interval, in per cent, and its numbers."""
    if not n:
        return ""
    low, high = interval(k, n)
    return f"{100 * k / n:.0f} [{100 * low:.0f}, {100 * high:.0f}] {k}/{n}"


def rate(label: str, rows: Sequence[Row], hit: Callable[[Row], bool]) -> list[str]:
    return _line(label, rows, lambda part: cell(sum(map(hit, part)), len(part)))


def middle(label: str, rows: Sequence[Row], value: Callable[[Row], float | None], digits: int = 2) -> list[str]:
    """A line of medians over the cases that have the value."""

    def words(part: Sequence[Row]) -> str:
        known = [x for x in map(value, part) if x is not None]
        return f"{np.median(known):.{digits}f} (n {len(known)})" if known else ""

    return _line(label, rows, words)


def _line(label: str, rows: Sequence[Row], words: Callable[[Sequence[Row]], str]) -> list[str]:
    return [label, *(words([r for r in rows if r.strength == s]) for s in STRENGTHS), words(rows)]


def measures(rows: Sequence[Row]) -> list[list[str]]:
    """The lines of the table: a measure, by strength and over all."""
    of = {k: [r for r in rows if r.kind == k] for k in ("library", "null", "foreign", "pair", MISFIT)}
    lines: list[list[str]] = []
    for kind, make in (("library", _library), ("null", _null), ("foreign", _foreign), ("pair", _pair)):
        lines += make(of[kind]) if of[kind] else []
    if of[MISFIT]:
        lines += [rate("misfit: its effect named first", of[MISFIT], rightly_named)]
        lines += [rate("misfit: its effect named, nothing else", of[MISFIT], lambda r: set(r.named) == set(r.truth))]
        lines += [rate("misfit: something left over noticed", of[MISFIT], unnamed_seen)]
    lines.append(rate("all: wrong name, with nothing left over", rows, wrongly_named))
    lines.append(rate("all: any name that is not there, also behind a right one", rows, one_too_many))
    lines.append(rate("all: answered as it should be", rows, right))
    return [*lines, rate("all: failed", rows, lambda r: r.verdict == "error")]


def _library(rows: Sequence[Row]) -> list[list[str]]:
    named = [r for r in rows if rightly_named(r)]
    return [
        rate("library: first candidate right (top-1)", rows, top1),
        rate("library: verdict named", rows, lambda r: r.verdict == "named"),
        rate("library: named, and the right one first", rows, rightly_named),
        rate("library: verdict none", rows, lambda r: r.verdict == "none"),
        rate("library: truth in the equivalence class", rows, in_group),
        _line("library: size of the class, mean", rows, _mean_size),
        _line("rightly named: parameters inside 90 % intervals", named, lambda part: cell(*covered(part))),
        middle("library: closure, median", rows, closure),
        middle("rightly named: closure, median", named, closure),
    ]


def _mean_size(rows: Sequence[Row]) -> str:
    return f"{np.mean([len(r.group) for r in rows]):.2f}" if rows else ""


def _null(rows: Sequence[Row]) -> list[list[str]]:
    return [
        rate("null: false alarm", rows, lambda r: r.verdict != "none"),
        rate("null: of these, named", rows, lambda r: r.verdict == "named"),
        rate("null: of these, unknown", rows, lambda r: r.verdict == "unknown"),
    ]


def _foreign(rows: Sequence[Row]) -> list[list[str]]:
    return [
        rate("foreign: unknown, or named with a remainder", rows, unnamed_seen),
        rate("foreign: none", rows, lambda r: r.verdict == "none"),
        rate("foreign: named with nothing left over", rows, wrongly_named),
    ]


def _pair(rows: Sequence[Row]) -> list[list[str]]:
    return [
        rate("pair: both named, nothing else", rows, lambda r: set(r.named) == set(r.truth)),
        rate("pair: both named", rows, lambda r: set(r.truth) <= set(r.named)),
        rate("pair: the first name is one of the two", rows, rightly_named),
    ]


def misses(rows: Sequence[Row]) -> list[str]:
    """A table of the cases that were not answered as they should be."""
    wrong = [r for r in rows if not right(r)]
    names = [" > ".join(c["name"] for c in r.ranking[:3]) for r in wrong]
    said = [" + ".join(r.named) + (" and more" if r.remainder else "") if r.named else r.verdict for r in wrong]
    lines = [[r.case, r.kind, r.label, r.strength, s, n] for r, s, n in zip(wrong, said, names, strict=True)]
    return table(["case", "kind", "truth", "strength", "answer", "first three candidates"], lines) if lines else []


def scored(rows: Sequence[Row]) -> list[str]:
    """The whole score in markdown: how long it took, the table, the misses."""
    seconds = [r.answer["seconds"] for r in rows]
    codes = {r.answer.get("code", "") for r in rows}
    return [
        f"{len(rows)} cases; seconds per case: median {np.median(seconds):.0f}, most {max(seconds):.0f}. Rates in per "
        f"cent with 95 % intervals (Clopper-Pearson) and counts. Code {', '.join(sorted(codes))}"
        + ("." if len(codes) == 1 else ": THE ANSWERS WERE NOT ALL MADE BY THE SAME CODE."),
        "",
        *table(["measure", *STRENGTHS, "all"], measures(rows)),
        "",
        "Cases not answered as they should be:",
        "",
        *(misses(rows) or ["none"]),
    ]


def figures(rows: Sequence[Row], name: str) -> dict[str, Figure]:
    """Figures for the record of all ``rows``, their anchors ending with ``name``: what each kind is to be answered."""
    made = {}
    for kind, words in (("null", "nothing there: none"), ("foreign", "a cause without a name: unknown or a remainder"),
                        ("pair", "two effects: both named, nothing else"), ("library", "an effect: named"),
                        (MISFIT, "an effect on a ship of another structure: named")):  # fmt: skip
        some = [r for r in rows if r.kind == kind]
        for strength in STRENGTHS if kind == "library" else ("",):
            part = [r for r in some if not strength or r.strength == strength]
            if part:
                mark = "_".join(word for word in ("blind", kind, strength, name) if word)
                what = f"blind cases, {name}: {strength + ' ' if strength else ''}{words}"
                made[mark] = Figure(what, sum(map(right, part)), of=len(part))
    wrong = sum(map(wrongly_named, rows))
    return made | {f"blind_wrong_{name}": Figure(f"blind cases, {name}: a name that is not there", wrong, of=len(rows))}

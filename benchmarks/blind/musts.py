"""What a diagnosis must reach on every generator, against what the answers reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.blind.rows import Row, covered, in_group, rightly_named, unnamed_seen, wrongly_named
from benchmarks.blind.score import cell
from benchmarks.record import table

SIZE = 1.5
"""Most effects that the class may hold on the average."""


def musts(rows: Sequence[Row]) -> list[str]:
    """A table: each measure, its limits, the rate with its interval and counts, whether it is within; [] without rows.

    A measure of which there is no case is left out. Whether it is within the limits is judged by the rate itself.
    """
    library, null, foreign, pair = ([r for r in rows if r.kind == k] for k in ("library", "null", "foreign", "pair"))
    named = [r for r in library if rightly_named(r)]
    lines = [
        _line("false alarms (null cases)", null, lambda r: r.verdict != "none", 0.0, 0.06),
        _line("unknown or remainder, foreign medium and strong", _strengths(foreign), unnamed_seen, 0.90, 1.0),
        _line("wrong name with nothing left over", rows, wrongly_named, 0.0, 0.02),
        *(
            _line(f"named and right, {s}", [r for r in library if r.strength == s], rightly_named, least, 1.0)
            for s, least in (("weak", 0.60), ("medium", 0.95), ("strong", 0.98))
        ),
        _line("class holds the truth", library, in_group, 0.98, 1.0),
        _size(library),
        _line("pairs exact", pair, lambda r: set(r.named) == set(r.truth), 0.90, 1.0),
        _counted("90 % intervals of size", *covered(named), 0.85, 0.95),
        _counted("90 % intervals of size, strong", *covered(_strengths(named, ("strong",))), 0.85, 0.95),
    ]
    known = [line for line in lines if line]
    return [*table(["what must be reached", "must", "here", "reached"], known), ""] if known else []


def _strengths(rows: Sequence[Row], which: Sequence[str] = ("medium", "strong")) -> list[Row]:
    return [r for r in rows if r.strength in which]


def _line(label: str, rows: Sequence[Row], hit: Callable[[Row], bool], least: float, most: float) -> list[str]:
    return _counted(label, sum(map(hit, rows)), len(rows), least, most)


def _counted(label: str, k: int, n: int, least: float, most: float) -> list[str]:
    """A line of k of n; [] if n is 0."""
    if not n:
        return []
    limits = f"<= {most:.2f}" if least == 0 else f">= {least:.2f}" if most == 1 else f"{least:.2f} to {most:.2f}"
    return [label, limits, cell(k, n), _yes(least <= k / n <= most)]


def _size(library: Sequence[Row]) -> list[str]:
    sizes = [len(r.group) for r in library]
    return ["class, mean size", f"<= {SIZE}", f"{np.mean(sizes):.2f}", _yes(np.mean(sizes) <= SIZE)] if sizes else []


def _yes(right: bool | np.bool_) -> str:
    return "yes" if right else "no"

"""Tables of ``mmg score``: both metrics, errors in units, manoeuvring figures, and where a model is worse."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from mmg.states import STATES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from fitting.prediction.score import Score, TrialScore
    from fitting.prediction.units import RunErrors


def print_scores(scores: Mapping[str, Score]) -> None:
    """Print everything about the ``scores`` of models, by name."""
    from rich.console import Console
    from rich.table import Table

    from cases.trial import UNITS

    console = Console(width=None)
    first = next(iter(scores.values()))
    table = Table(title="100 s restarts (Eq. 25) | 30 s windows", caption_justify="left", title_justify="left")
    table.add_column("trial", no_wrap=True)
    for name in scores:
        table.add_column(Path(name).name, justify="right")
    table.add_column("windows", justify="right")
    for i, row in enumerate(first.trials):
        cells = [_cell(s.trials[i]) for s in scores.values()]
        table.add_row(row.name, *cells, str(row.windows))
    table.add_section()
    table.add_row("all rows pooled", *[_cell(s) for s in scores.values()], "")
    console.print(table)
    _print_units(console, scores)
    words = ", ".join(f"{s} {v:.5g} {UNITS[s]}" for s, v in zip(STATES, first.sigma, strict=True))
    console.print(f"sigma from {first.sigma_from}: {words}", highlight=False, soft_wrap=True)
    console.print(past_in_words(scores), highlight=False, soft_wrap=True)
    for note in dict.fromkeys(note for s in scores.values() for note in s.notes):
        of = [Path(name).name for name, s in scores.items() if note in s.notes]
        model = f" ({', '.join(of)})" if len(of) < len(scores) else ""
        console.print(f"note: {note}{model}", highlight=False, soft_wrap=True, markup=False)
    for line in worse_than_first(scores):
        console.print(line, highlight=False, soft_wrap=True, markup=False)


def past_in_words(scores: Mapping[str, Score]) -> str:
    """How much of the past of a window the predictions of the ``scores`` used."""
    with_past = {Path(name).name: s.past_s for name, s in scores.items() if s.past_s}
    if not with_past:
        return "past of a window: none is used"
    return f"past of a window: up to {max(with_past.values()):g} s by {', '.join(with_past)}; none by the others"


def _cell(found: Score | TrialScore) -> str:
    """Both metrics of one trial or of all."""
    from fitting.prediction.score_words import in_words

    return f"{in_words(found.paper)} | {in_words(found.window)}"


def _print_units(console: Console, scores: Mapping[str, Score]) -> None:
    """Errors in units by run, and those of the manoeuvring figures."""
    from rich.table import Table

    units = {Path(name).name: s.units for name, s in scores.items() if s.units}
    if not units:
        return
    first = next(iter(units.values()))
    times = f", {first.lengths:.1f} L/U" if first.lengths else ""
    title = f"rms errors over {first.window:g} s windows{times}: position | heading | u | r | share of change"
    table = Table(title=title, title_justify="left")
    table.add_column("trial", no_wrap=True)
    for name in units:
        table.add_column(f"{name} [m | deg | m/s | deg/s | %]", justify="right")
    for i, run in enumerate(first.runs):
        table.add_row(run.name, *[_units(u.runs[i]) for u in units.values()])
    table.add_section()
    table.add_row("all rows pooled", *[_units(u.pooled) for u in units.values()])
    console.print(table)
    figures = Table(title="manoeuvring figures, predicted with the measured rudder: error", title_justify="left")
    for name in ("trial", "manoeuvre", "figure"):
        figures.add_column(name, no_wrap=True)
    for name in ("measured", *units):
        figures.add_column(name, justify="right")
    for i, run in enumerate(first.runs):
        for maneuver in run.maneuvers:
            for figure in maneuver.figures:
                key = (maneuver.title, figure.figure)
                found = [
                    {(m.title, f.figure): f for m in u.runs[i].maneuvers for f in m.figures}.get(key)
                    for u in units.values()
                ]
                cells = [f"{f.predicted:.3g} ({f.error:+.3g})" if f else "-" for f in found]
                measured = f"{figure.measured:.3g} {figure.unit}"
                figures.add_row(run.name, maneuver.title, figure.figure.replace("_", " "), measured, *cells)
    if figures.row_count:
        console.print(figures)


def _units(run: RunErrors) -> str:
    if not run.windows:
        return "-"
    e = run.errors
    if not math.isfinite(e["position"]):
        return "diverges"
    numbers = (e["position"], e["heading"], e["u"], e["r"], 100 * run.share)
    return " | ".join(f"{value:.3g}" for value in numbers)


def worse_than_first(scores: Mapping[str, Score]) -> list[str]:
    """A line for each of the ``scores`` that is worse on some run than the first with as much past, which is itself
    compared with the first of all."""
    from fitting.prediction.score_pairs import ScorePair

    first, *others = scores
    lines = []
    for other in others:
        found, alike = scores[other], next(n for n, s in scores.items() if s.past_s == scores[other].past_s)
        name = first if alike == other else alike
        runs = ScorePair(scores[name], found).worse_runs
        if runs:
            words = f"worse than {Path(name).name} on {len(runs)} of {len(found.trials)} runs: {'; '.join(runs)}"
            lines.append(f"{Path(other).name}: {words}")
    return lines

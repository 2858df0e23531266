"""Manoeuvring figures with 90 % intervals as a page shows them, and where the manoeuvres leave what the trials held."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from cases.criteria.assessment import imo_figures
from cases.criteria.imo import Row
from fitting.prediction.envelope import QUANTITIES, SHOWN_IN
from fitting.prediction.figure_intervals import DRAWS, FigureScatter, JudgedFigures, correlation_in, with_intervals
from fitting.report.page_figures import figure_entry
from fitting.report.plot_maneuvers import maneuver_figure
from fitting.report.plot_style import AFTER, ALARM, DPI, GREY, dress, literal, new_figure
from mmg.errors import UserError
from mmg.messages import Message, has_code
from mmg.ship import Ship

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureSection:
    """What the template shows. count: ships drawn; rows: cells of the table, by column; outside: sentences on
    manoeuvres that leave the trials; images: of the tracks and of the envelope, as the macro ``figure`` takes them."""

    count: int
    rows: tuple[dict[str, str], ...]
    outside: tuple[str, ...]
    images: tuple[dict[str, Any], ...]


def standard_figures(result: Mapping[str, Any], ship: Ship) -> JudgedFigures:
    """The standard manoeuvres of a ship with the draws of which a page shows intervals, the same as ``mmg imo``.

    result: content of result.json; ship: the calibrated or hybrid ship of which it speaks. Where no covariance is known
    or none can be drawn there are no draws, and a notice says why. Raises UserError when no manoeuvre reaches its
    event.
    """
    found = imo_figures(ship)
    why = "no covariance of the coefficients is known"
    if correlation_in(result) is not None:
        try:
            return with_intervals(found, ship, result, DRAWS)
        except UserError as error:
            why = str(error)
    return JudgedFigures(replace(found, notices=(*found.notices, Message(f"no intervals: {why}", "no_covariance"))), {})


def figure_section(result: Mapping[str, Any], judged: JudgedFigures) -> FigureSection | None:
    """The figures of the standard manoeuvres with intervals, None where there are no draws.

    result: content of result.json; judged: of ``standard_figures``.
    """
    if not judged.scatter:
        return None
    found = judged.assessment
    clouds = {name: one.shown for name, one in judged.scatter.items()}
    images = [_image(
        maneuver_figure(found.runs, found.heading, clouds), "maneuvers", "Standard manoeuvres with drawn trials",
        "Lines: the ship as calibrated. Thin and grey: single trials of ships that the trials allow.",
    )]  # fmt: skip
    envelope = result.get("envelope")
    if envelope and judged.scatter:
        images.append(_image(
            envelope_figure(envelope, judged.scatter), "envelope", "Trials and manoeuvres: their ranges",
            "Grey: range of the trials. Bars: range of each manoeuvre; red where it leaves the trials, so that its "
            "figures are extrapolated.",
        ))  # fmt: skip
    rows = tuple(_cells(row) for row in found.rows if row.interval_90 is not None)
    outside = tuple(str(note) for note in found.notices if has_code([note], "outside_the_trials"))
    return FigureSection(DRAWS, rows, outside, tuple(images))


def _image(figure: Figure, name: str, title: str, caption: str) -> dict[str, Any]:
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=DPI)
    return figure_entry(content.getvalue(), name, title, caption)


def _cells(row: Row) -> dict[str, str]:
    """The cells of one line of the table."""
    digits = 1 if row.unit == "deg" else 2

    def ends(pair: Sequence[float] | None) -> str:
        return " to ".join(f"{x:.{digits}f}" if x < float("inf") else "never" for x in pair) if pair else "–"

    return {
        "run": row.run,
        "figure": f"{row.figure.replace('_', ' ')} [{row.unit}]",
        "value": "–" if row.value is None else f"{row.value:.{digits}f}",
        "interval": ends(row.interval_90),
        "trial": ends(row.interval_90_trial),
        "limit": "–" if row.limit is None else f"{row.limit:.3g}",
        "chance": "–" if row.probability is None else f"{100 * row.probability:.0f} %",
        "inside": {None: "not known", True: "no", False: "yes"}[row.extrapolated],
    }


def envelope_figure(envelope: Mapping[str, Sequence[float]], scatter: Mapping[str, FigureScatter]) -> Figure:
    """Ranges of the trials, grey, and of each manoeuvre, a bar per manoeuvre and a panel per quantity.

    envelope: quantity -> least and greatest value of the trials, SI and rad; scatter: by the name of the manoeuvre. A
    bar is red where ``outside_of`` says that the quantity leaves the trials.
    """
    names = [name for name in QUANTITIES if name in envelope]
    lines = -(-len(names) // 3)
    figure = new_figure(lines * (0.9 + 0.24 * len(scatter)))
    grid = figure.add_gridspec(lines, 3)
    for k, name in enumerate(names):
        _range_panel(figure.add_subplot(grid[k // 3, k % 3]), name, envelope[name], scatter, k % 3 == 0)
    return figure


def _range_panel(
    ax: Axes, name: str, held: Sequence[float], scatter: Mapping[str, FigureScatter], labelled: bool
) -> None:
    """One quantity: the range of the trials behind, the ranges of the manoeuvres before it."""
    unit, factor = SHOWN_IN[name]
    dress(ax, f"{QUANTITIES[name]} / {unit}")
    ax.axvspan(factor * held[0], factor * held[1], color=GREY, alpha=0.25, linewidth=1.5)
    for row, one in enumerate(scatter.values()):
        if name not in one.ranges:
            continue
        low, high = (factor * x for x in one.ranges[name])
        leaves = any(words.startswith(QUANTITIES[name]) for words in one.outside or ())
        ax.plot([low, high], [row, row], color=ALARM if leaves else AFTER, linewidth=5 if leaves else 3, marker="|")
    ax.set_yticks(range(len(scatter)), [literal(run) for run in scatter] if labelled else [""] * len(scatter))
    ax.set_ylim(len(scatter) - 0.4, -0.6)
    ax.grid(False, axis="y")

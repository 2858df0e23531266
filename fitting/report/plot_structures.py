"""Figures of a choice of structure: unknowns against the error of held-out trials, and learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fitting.report.plot_style import AFTER, ALARM, DASHES, GREY, dress, literal, new_figure


def structure_plot(rows: Sequence[Mapping[str, Any]], chosen: str) -> Figure:
    """Unknowns against the validation error of each candidate in ``rows``, as in selection.json; the ``chosen`` one is
    filled.

    Errors above five times the least, and runaways, stand at the upper edge. A row without unknowns, the ship as given,
    is a line. Names stand at those that no candidate with fewer unknowns beats.
    """
    figure = new_figure(4.2)
    ax = dress(figure.add_subplot(), "unknowns", "validation error of 30 s windows, by variance", "Structure")
    tried = [row for row in rows if not row["left_out"] and row["unknowns"]]
    errors = [row["validation"] for row in tried if row["validation"] is not None]
    most = 5.0 * min(errors, default=1.0)
    front = _front(tried)
    line = [(row["unknowns"], row["validation"]) for row in tried if row["name"] in front]
    ax.plot(*zip(*sorted(line), strict=True) if line else ([], []), color=GREY, linewidth=0.8, zorder=1)
    for row in tried:
        value, taken = row["validation"], row["name"] == chosen
        off = value is None or value > most
        runaway = row["stable"] < row["sequences"]
        marker, color = "^" if off else "s" if runaway else "o", ALARM if off or runaway else AFTER
        y = most if off else value
        ax.plot(
            row["unknowns"], y, marker=marker, color=color, markerfacecolor=color if taken else "white", markersize=8
        )
        if taken or row["name"] in front:
            label = literal(row["name"] + (" (chosen)" if taken else ""))
            ax.annotate(label, (row["unknowns"], y), (6, -12 if taken else 5), textcoords="offset points", fontsize=7.5)
    for row in rows:
        if not row["unknowns"] and not row["left_out"] and (row["validation"] or np.inf) < most:
            ax.axhline(row["validation"], color=GREY, linestyle="--", linewidth=1.0)
            ax.annotate(literal(row["name"]), (0.01, row["validation"]), (0, 3), xycoords=("axes fraction", "data"),
                        textcoords="offset points", fontsize=7.5, color=GREY)  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.margins(x=0.15, y=0.12)
    ax.xaxis.set_major_formatter("{x:.0f}")
    ax.xaxis.set_minor_formatter("")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter("{x:.2g}")
    values = np.array([row["unknowns"] for row in tried])
    if len(values):
        ax.set_xticks(sorted({int(v) for v in np.geomspace(values.min(), values.max(), 6)}))
    text = "circle: stable or not checked; square: diverged in a random harbour sequence; triangle: off the scale"
    figure.text(0.01, 0.005, text, fontsize=7.5, color=GREY)
    figure.set_layout_engine("constrained", rect=(0, 0.03, 1, 0.97))
    return figure


def _front(rows: Sequence[Mapping[str, Any]]) -> set[str]:
    """Names of those of ``rows`` than which none with as few unknowns has less error."""
    found, least = set[str](), np.inf
    for row in sorted(rows, key=lambda row: (row["unknowns"], row["validation"] or np.inf)):
        if row["validation"] is not None and row["validation"] < least:
            found, least = found | {row["name"]}, row["validation"]
    return found


def learning_plot(curves: Mapping[str, Sequence[Any]]) -> Figure:
    """Each of ``curves``, lessons by name: errors of training (blue) and validation (red), by seconds."""
    figure = new_figure(4.2)
    ax = dress(figure.add_subplot(), "seconds", "squared error in subsequences, by variance", "Learning curves")
    for number, (name, lessons) in enumerate(curves.items()):
        style = DASHES[number % len(DASHES)]
        seconds = [max(lesson.seconds, 0.01) for lesson in lessons]
        for key, color in (("training", AFTER), ("validation", ALARM)):
            label = literal(f"{name}, {key}") if number < len(DASHES) else None
            values = [getattr(lesson, key) for lesson in lessons]
            ax.plot(seconds, values, color=color, linestyle=style, linewidth=1.2, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.legend(fontsize=7, frameon=False, ncols=2, labelcolor=GREY)
    return figure

"""Waterfall of a multi-start: did all starts reach the same optimum?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.report.plot_style import AFTER, ALARM, GREY, dress, new_figure
from fitting.settings import Start


def waterfall_plot(starts: Sequence[Start], ax: Axes | None = None) -> Axes:
    """Objective of each of ``starts`` above the best one, in increasing order, drawn on ``ax``.

    Open squares did not converge; a ring marks a start that was solved again with damping.
    """
    ax = dress(new_figure(3.2).subplots() if ax is None else ax, "start, in order of its objective [-]",
               "objective above the best [-]")  # fmt: skip
    ordered = sorted(starts, key=lambda s: s.objective)
    best = min((s.objective for s in ordered if s.converged), default=ordered[0].objective)
    floor = 1e-10 * max(abs(best), 1.0)
    above = np.array([max(s.objective - best, floor) for s in ordered])
    done = np.array([s.converged for s in ordered])
    again = np.array([s.restarted for s in ordered])
    place = np.arange(1, len(ordered) + 1)
    for which, mark, colour, name in ((done, "o", AFTER, "converged"), (~done, "s", ALARM, "not converged")):
        if which.any():
            face = colour if mark == "o" else "none"
            ax.plot(place[which], above[which], mark, color=colour, markerfacecolor=face, label=name)
    if again.any():
        ax.plot(place[again], above[again], "o", ms=12, color=GREY, markerfacecolor="none", label="restarted, damped")
    for x, y, s in zip(place, above, ordered, strict=True):
        where = {"xytext": (0, 7), "textcoords": "offset points", "ha": "center", "fontsize": 7}
        ax.annotate(str(s.number), (float(x), float(y)), **where)  # type: ignore[arg-type]
    ax.set_yscale("log")
    ax.axhline(max(1e-5 * abs(best), 10 * floor), color=GREY, lw=0.8, ls="--", label="same optimum to 1e-5")
    ax.set_xticks(place)
    ax.margins(y=0.15)
    ax.legend(fontsize=8, frameon=False)
    return ax


def waterfall_figure(starts: Sequence[Start]) -> Figure:
    """The figure of ``waterfall_plot`` of ``starts``."""
    figure = new_figure(3.2)
    waterfall_plot(starts, figure.subplots())
    return figure

"""The figure of ``mmg gap``: errors of the models, and what the network has learned beside what was named."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from diagnosis.validation.gap import FLOOR, REFITTED, Gap
from fitting.report.plot_style import AFTER, BEFORE, GREY, MEASURED, dress, new_figure


def gap_figure(gap: Gap) -> Figure:
    """Errors of position and heading by model in a ``gap`` with 90 % intervals; below, accelerations that the network
    adds, over the feature that they follow most, with those of the named effects."""
    channels = list(gap.learned.items())
    high, low = 1.0 + 0.34 * len(gap.rows), 2.6 if channels else 0.0
    figure = new_figure(high + low)
    grid = figure.add_gridspec(2 if channels else 1, 6, height_ratios=[high, low] if channels else [high])
    pair = [figure.add_subplot(grid[0, :3]), figure.add_subplot(grid[0, 3:])]
    places = np.arange(len(gap.rows))[::-1]
    colours = [{REFITTED: BEFORE, FLOOR: GREY}.get(row.name, AFTER) for row in gap.rows]
    for ax, name, unit in zip(pair, ("position", "heading"), ("m", "deg"), strict=True):
        key = f"{name}_{unit}"
        values = np.array([getattr(row, key) for row in gap.rows], dtype=float)
        ends = np.array([getattr(row, f"{name}_90") for row in gap.rows], dtype=float).T
        dress(ax, f"{name} error after {gap.seconds:.3g} s [{unit}]")
        ax.barh(places, values, height=0.62, color=colours, alpha=0.75)
        ax.hlines(places, *ends, color=MEASURED, lw=1.1)
        ax.set_xlim(0, 1.08 * max(float(np.nanmax(ends)), 1e-9))
        ax.set_yticks(places, [row.name + (" (declined)" if row.kept is False else "") for row in gap.rows])
        ax.grid(False, axis="y")
    pair[1].tick_params(labelleft=False)
    for number, (name, own) in enumerate(channels):
        ax = figure.add_subplot(grid[1, 2 * number : 2 * number + 2])
        dress(ax, own.feature, f"{name} [{own.unit}]", f"learned: {100 * own.explained:.0f} % by {own.feature}")
        ax.plot(own.at, own.learned, "o-", color=AFTER, ms=3.5, lw=1.2, label="network")
        if gap.effects:
            label = " and ".join(gap.effects)
            ax.plot(own.at, own.named, "s--", color=BEFORE, ms=3.5, lw=1.2, label=label)
        ax.axhline(0.0, color=GREY, lw=0.7)
        ax.ticklabel_format(axis="y", scilimits=(-2, 3))
        if number == 0:
            ax.legend(fontsize=8, frameon=False)
    return figure

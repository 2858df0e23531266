"""Figure of learning curves: error in subsequences of training and validation trials against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from fitting.report.plot_style import AFTER, ALARM, DASHES, GREY, dress, literal, new_figure


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

"""Figures of a comparison: growth of the error, error over the amount of data."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fitting.report.plot_style import DASHES, FigureFolder, dress, new_figure
from residual.papers.comparison import GROWTH, HORIZONS, TYPES, Comparison

COLOURS = {
    "captive": "#8A8A8A", "calibrated": "#0072B2", "hybrid": "#009E73", "fnn": "#D58A00", "rnn": "#CC79A7",
    "rnn-window": "#C0305A",
}  # fmt: skip
DASHED = dict(zip(COLOURS, DASHES, strict=True))
MARKERS = dict(zip(COLOURS, "oDs^vX", strict=True))  # Of the lines of the models: they differ without their colours too
# Model -> the one whose look it has: those of a paper stand beside the captive ship alone.
AS = {model: model for model in COLOURS} | dict(zip(TYPES, list(COLOURS)[1:], strict=True))


def _look(model: str) -> dict[str, Any]:
    model = AS[model]
    return {"color": COLOURS[model], "marker": MARKERS[model], "markersize": 4}


def growth_plot(comparison: Comparison) -> Figure:
    """Position and heading error over the horizon, of ``comparison``; mean and range over the seeds."""
    figure = new_figure(3.2)
    axes = figure.subplots(1, 2)
    for ax, (error, (words, factor, _)) in zip(axes, GROWTH.items(), strict=True):
        dress(ax, "time since the start [s]", words, "" if ax is axes[1] else "Growth of the error")
        for model in comparison.study.models:
            rows = [factor * np.array(e.growth[error]) for e in comparison.of(model)]
            if rows:
                ax.plot(HORIZONS, np.mean(rows, axis=0), linestyle=DASHED[AS[model]], label=model, **_look(model))
                ends, colour = (np.min(rows, axis=0), np.max(rows, axis=0)), COLOURS[AS[model]]
                ax.fill_between(HORIZONS, *ends, color=colour, alpha=0.15)
        ax.set_ylim(bottom=0)
    axes[0].legend(fontsize=7.5, frameon=False)
    return figure


def efficiency_plot(comparison: Comparison) -> Figure:
    """Pooled 30 s windows over the seconds of training data, of ``comparison``; dashed without random manoeuvres."""
    figure = new_figure(3.2)
    ax = dress(figure.subplots(), "training data [s]", "30 s windows, mean squared error", "Data efficiency")
    style = {True: "-", False: "--"}
    for model, random in itertools.product((m for m in comparison.study.models if m != "captive"), style):
        parts = [comparison.of(model, subset) for subset in comparison.study.subsets if subset.random is random]
        points = sorted((p[0].training_s, np.mean([e.score.window for e in p if e.score])) for p in parts if p)
        if points:
            label = model if random else None
            ax.plot(*zip(*points, strict=True), style[random], label=label, **_look(model))
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.legend(fontsize=7.5, frameon=False, title="dashed: without random", title_fontsize=7.5)
    return figure


def write_figures(written: FigureFolder, comparison: Comparison) -> None:
    """Write the figures of the ``comparison``. written: where to."""
    plots = {"growth": growth_plot}
    if len(comparison.study.subsets) > 1:
        plots["efficiency"] = efficiency_plot
    for name, plot in plots.items():
        written.write(name, partial(plot, comparison), name, "")

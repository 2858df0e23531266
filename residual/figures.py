"""Figures of a training: learning curves, growth of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cases.trial import Trial
from fitting.prediction.predict import Forecaster
from fitting.report.plot_style import ALARM, BEFORE, DASHES, FigureFolder, dress, new_figure
from fitting.report.plots import write_error_growth
from mmg.rollout import Simulator


def learning_plot(per_seed: Sequence[Mapping[str, Any]], before: str = "calibrated ship") -> Figure:
    """Stop error over that of what was ``before``, per epoch and seed of ``per_seed``.

    Dots: weights kept; bars: judged error. Returns the figure.
    """
    figure = new_figure(3.2)
    ax = dress(figure.subplots(), "epoch", f"30 s windows: error / {before}")
    end = max(row["history"][-1]["epoch"] for row in per_seed)
    for row, dashes in zip(per_seed, cycle(DASHES), strict=False):
        epochs = [h["epoch"] for h in row["history"]]
        errors = [h["stop"] / row["stop_window"]["before"] for h in row["history"]]
        judged = row["judged_window"]["after"] / row["judged_window"]["before"]
        (line,) = ax.plot(epochs, errors, linewidth=1.1, linestyle=dashes, label=f"seed {row['seed']}")
        if np.isfinite(errors).any():
            best = int(np.nanargmin(errors))
            ax.plot(epochs[best], errors[best], "o", color=line.get_color(), markersize=4)
        ax.plot(1.03 * max(end, 1), judged, "_", color=line.get_color(), markersize=9, markeredgewidth=2.0)
        if row["status"] == "diverged":
            ax.plot(epochs[-1], errors[-1], "x", color=ALARM)
    if ax.get_ylim()[0] < 0.1:
        ax.set_yscale("log")
    ax.axhline(1.0, color=BEFORE, linestyle=(0, (4, 1.5)), linewidth=1.0, label=before)
    ax.legend(fontsize=7.5, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def write_figures(
    written: FigureFolder,
    content: Mapping[str, Any],
    models: Mapping[str, Simulator | Forecaster],
    trials: Sequence[Trial],
) -> None:
    """Write the figures of the training whose result.json has this ``content``.

    written: where to; models: by their names in the figures, without and with what was trained; trials: that show how
    the error grows, () to leave that figure out.
    """
    hybrid, held_out = content.get("decision") is not None, content["validation_data"]
    start = "calibrated ship" if hybrid else "untrained network"
    apart = ", which took no part in the training" if hybrid else ", here the same that it stopped by, which flatters"
    written.write(
        "learning", lambda: learning_plot(content["per_seed"], start), "Error of the windows to stop by",
        f"Error of the windows to stop by after each epoch, over that of the {start}. Dot: the weights kept; bar "
        f"at the right: their error on the windows that judge{apart}.",
    )  # fmt: skip
    if trials and any(row["has_position"] for row in held_out or content["data"]):
        write_error_growth(written, models, trials, "validation" if held_out else "training")

"""Figures of a training: learning curves, and scores per trial without and with the residual."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from fitting.plot_style import ALARM, BEFORE, DPI, dress, new_figure
from fitting.plots import score_plot


def learning_plot(per_seed: list[dict[str, Any]], before: str = "calibrated ship") -> Figure:
    """Stop error over that of what was ``before``, per seed and epoch; dots: weights kept; bars: the judged error."""
    figure = new_figure(3.2)
    ax = dress(figure.subplots(), "epoch", "30 s windows, error / before", "Learning curves")
    for row in per_seed:
        epochs = [h["epoch"] for h in row["history"]]
        errors = [h["stop"] / row["stop_window"]["before"] for h in row["history"]]
        judged = row["judged_window"]["after"] / row["judged_window"]["before"]
        (line,) = ax.plot(epochs, errors, linewidth=1.0, label=f"seed {row['seed']}")
        best = min(range(len(errors)), key=errors.__getitem__)
        ax.plot(epochs[best], errors[best], "o", color=line.get_color(), markersize=4)
        ax.plot(1.03 * max(epochs), judged, "_", color=line.get_color(), markersize=9, markeredgewidth=2.0)
        if row["status"] == "diverged":
            ax.plot(epochs[-1], errors[-1], "x", color=ALARM)
    ax.axhline(1.0, color=BEFORE, linestyle=(0, (4, 1.5)), linewidth=1.0, label=before)
    ax.legend(fontsize=7.5, frameon=False, ncols=2)
    return figure


def write_figures(folder: Path, content: Mapping[str, Any], before: str = "calibrated ship") -> list[dict[str, str]]:
    """Write the figures of a training's result.json as PNG into ``folder``/figures; file, title and caption of each."""
    target = folder / "figures"
    target.mkdir(parents=True, exist_ok=True)
    learning_plot(content["per_seed"], before).savefig(target / "learning.png", dpi=DPI)
    words = (
        f"Error of the windows to stop by after each epoch, over that of the {before}. Dot: the weights kept; bar at "
        "the right: their error on the windows that judge, which took no part in the training."
    )
    written = [{"file": "learning.png", "title": "Learning curves", "caption": words}]
    scores = {name: pair for name, pair in content["scores"].items() if "after" in pair}
    if scores:
        score_plot(scores).savefig(target / "scores.png", dpi=DPI)
        words = "Mean squared error of open-loop predictions without (before) and with the residual; lower is better."
        written.append({"file": "scores.png", "title": "Scores per trial", "caption": words})
    return written

"""Figures of a training: learning curves, scores, growth of the error, size of the residual against its bound."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cases.trial import Trial
from fitting.prediction.predict import Forecaster
from fitting.report.plot_style import AFTER, ALARM, BEFORE, DPI, GREY, dress, new_figure
from fitting.report.plot_tracks import error_growth_plot
from fitting.report.plots import score_plot
from mmg.rollout import Simulator


def learning_plot(per_seed: list[dict[str, Any]], before: str = "calibrated ship") -> Figure:
    """Stop error over that of what was ``before``, per seed and epoch; dots: weights kept; bars: the judged error."""
    figure = new_figure(3.2)
    ax = dress(figure.subplots(), "epoch", f"30 s windows: error / {before}")
    end = max(row["history"][-1]["epoch"] for row in per_seed)
    for row in per_seed:
        epochs = [h["epoch"] for h in row["history"]]
        errors = [h["stop"] / row["stop_window"]["before"] for h in row["history"]]
        judged = row["judged_window"]["after"] / row["judged_window"]["before"]
        (line,) = ax.plot(epochs, errors, linewidth=1.0, label=f"seed {row['seed']}")
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


def size_plot(size: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Share of training rows in which the residual exceeds a size, per channel, with its bound and the ship's own."""
    figure = new_figure(2.7)
    names = {"du": "surge |du|", "dv": "sway |dv|", "dr": "yaw |dr|"}
    label = "share of rows beyond [%]"
    for ax, (channel, row) in zip(figure.subplots(1, 3, sharey=True), size.items(), strict=True):
        dress(ax, f"[{row['unit']}]", label if channel == "du" else "", names[channel])
        quantiles = np.maximum(row["quantiles"], 1e-4 * row["bound"] + 1e-15)
        ax.plot(quantiles, np.linspace(100, 0, len(quantiles)), color=AFTER, linewidth=1.6, label="residual")
        ax.axvline(row["bound"], color=ALARM, linewidth=1.4, label="its bound")
        ax.axvline(row["ship_rms"], color=GREY, linestyle=(0, (4, 1.5)), linewidth=1.2, label="rms of the ship's own")
        ax.set_xscale("log")
        if channel == "du":
            handles = ax.get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=3, fontsize=8, frameon=False)
    return figure


def write_figures(
    folder: Path,
    content: Mapping[str, Any],
    models: Mapping[str, Simulator | Forecaster],
    trials: Sequence[Trial],
    before: str = "calibrated ship",
) -> list[dict[str, str]]:
    """Write the figures of a training's result.json as PNG into ``folder``/figures; file, title and caption of each.

    models: by their names in the figures, without and with what was trained; trials: that show how the error grows;
    before: what the learning curves are relative to.
    """
    target = folder / "figures"
    target.mkdir(parents=True, exist_ok=True)
    written: list[dict[str, str]] = []

    def write(name: str, title: str, caption: str, draw: Callable[[], Figure]) -> None:
        draw().savefig(target / f"{name}.png", dpi=DPI)
        written.append({"file": f"{name}.png", "title": title, "caption": caption})

    write(
        "learning", "Error of the windows to stop by",
        f"Error of the windows to stop by after each epoch, over that of the {before}. Dot: the weights kept; bar at "
        f"the right: their error on the windows that judge{_apart(content)}.",
        lambda: learning_plot(content["per_seed"], before),
    )  # fmt: skip
    scores = {name: pair for name, pair in content["scores"].items() if "after" in pair}
    if scores:
        write(
            "scores", "Scores per trial",
            f"Mean squared error of open-loop predictions; lower is better. Before: {next(iter(models))}; after: "
            f"{list(models)[-1]}.",
            lambda: score_plot(scores),
        )  # fmt: skip
    if any(t.has_position for t in trials):
        which = "validation" if content["validation_data"] else "training"
        write(
            "error_growth", "How errors grow with the length of the prediction",
            f"Rms error over windows of the {which} trials, each started from the measured state and from there on "
            "driven by the measured rudder, revolutions and wind alone.",
            lambda: error_growth_plot(models, trials),
        )  # fmt: skip
    if content.get("residual_size"):
        write(
            "residual_size", "Size of the residual against its bound",
            "Share of the training rows in which the residual acceleration is larger than a value. It cannot pass the "
            "bound, whatever the inputs. Dashed: rms acceleration of the ship without it in the same rows.",
            lambda: size_plot(content["residual_size"]),
        )  # fmt: skip
    return written


def _apart(content: Mapping[str, Any]) -> str:
    """What is to be known of the judging windows of a training."""
    if content.get("decision"):
        return ", which took no part in the training"
    return ", here the same that it stopped by, which flatters"

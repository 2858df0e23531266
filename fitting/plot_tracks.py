"""Figures of predictions: the track of a trial with its time histories, and how errors grow over the horizon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.trial import Trial
from fitting.plot_style import GREY, MEASURED, STYLES, dress, new_figure
from fitting.predict import Window, predict
from fitting.score import PAPER_WINDOW, wrapped_error
from mmg.rollout import Simulator


def _joined(trial: Trial, windows: Sequence[Window]) -> tuple[np.ndarray, np.ndarray]:
    """Time from the first sample (rows,) and states (rows, 6) of all windows with NaN rows between them."""
    gap = np.full((1, 6), np.nan)
    t = [np.append(trial.t[w.first : w.last + 1] - trial.t[0], np.nan) for w in windows]
    z = [np.vstack([w.states, gap]) for w in windows]
    return (np.concatenate(t), np.vstack(z)) if windows else (np.empty(0), np.empty((0, 6)))


def trajectory_plot(
    trial: Trial, before: Sequence[Window], after: Sequence[Window], length: float | None = None
) -> Figure:
    """Track of one trial, measured against open-loop windows, north up, and histories of its states and inputs.

    before, after: windows of ``predict``; length: of the ship [m], to draw outlines on the measured track.
    """
    t, states = trial.t - trial.t[0], trial.states
    runs = [_joined(trial, before), _joined(trial, after)]
    starts = t[[w.first for w in after]] if after else np.empty(0)
    heights = [1.0] * 5
    figure = new_figure(10.2 if trial.has_position else 6.4)
    if trial.has_position:
        grid = figure.add_gridspec(6, 1, height_ratios=[5.2, *heights])
        ax = dress(figure.add_subplot(grid[0]), "y, east [m]", "x, north [m]")
        _track(ax, states, runs, [w.first for w in after], length)
        first = 1
    else:
        grid, first = figure.add_gridspec(5, 1, height_ratios=heights), 0
    below: list[Axes] = []
    wanted = ((3, "u [m/s]", 1.0), (4, "v [m/s]", 1.0), (5, "r [deg/s]", 180 / np.pi), (2, "psi [deg]", 180 / np.pi))
    for k, (state, label, factor) in enumerate(wanted):
        ax = dress(figure.add_subplot(grid[first + k], sharex=below[0] if below else None), y=label)
        ax.plot(t, states[:, state] * factor, color=MEASURED, lw=1.1, label="measured")
        for (tw, zw), style, name in zip(runs, STYLES[:2], ("before", "after"), strict=True):
            ax.plot(tw, zw[:, state] * factor, lw=1.2, label=name, **style)
        values = states[:, state][np.isfinite(states[:, state])] * factor
        reach = runs[1][1][:, state] * factor
        reach = np.concatenate([values, reach[np.isfinite(reach)]])
        if len(reach):  # a prediction that runs away before the calibration must not flatten the rest
            middle, span = 0.5 * (reach.max() + reach.min()), max(np.ptp(reach), 1e-9)
            ax.set_ylim(*np.clip(ax.get_ylim(), middle - 1.1 * span, middle + 1.1 * span))
        below.append(ax)
    ax = dress(
        figure.add_subplot(grid[first + 4], sharex=below[0]), "time from the first sample [s]", "delta [deg]"
    )
    ax.plot(t, np.degrees(trial["delta"]), color=MEASURED, lw=1.0)
    twin = dress(ax.twinx(), y="n [1/s]")
    twin.plot(t, trial["n"], color=GREY, lw=1.0)
    twin.yaxis.label.set_color("#666666")
    twin.grid(False)
    twin.spines["right"].set_visible(True)
    below.append(ax)
    for ax in below:
        for start in starts:
            ax.axvline(start, color="#C8C8C8", lw=0.7, ls=":", zorder=0)
        ax.set_xlim(0, max(t[-1], 1e-9))
        ax.tick_params(labelbottom=ax is below[-1])
    figure.align_ylabels(below)
    handles, labels = below[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    return figure


def _track(ax: Axes, states: np.ndarray, runs: list, first: list[int], length: float | None) -> None:
    ax.plot(states[:, 1], states[:, 0], color=MEASURED, lw=1.3, zorder=2)
    for (_, z), style in zip(runs, STYLES[:2], strict=True):
        ax.plot(z[:, 1], z[:, 0], lw=1.3, zorder=3, **style)
    ax.plot(states[first, 1], states[first, 0], ".", color=MEASURED, ms=6, zorder=4)
    if length:
        body = np.array([[0.5, 0], [0.32, 0.08], [-0.5, 0.08], [-0.5, -0.08], [0.32, -0.08], [0.5, 0]]) * length
        for x, y, psi in states[first, :3]:
            c, s = np.cos(psi), np.sin(psi)
            ax.fill(y + body @ [s, c], x + body @ [c, -s], fc="none", ec=MEASURED, lw=0.8, zorder=4)
    good = states[np.isfinite(states[:, :2]).all(axis=1), :2]
    if len(good):
        margin = 0.35 * max(np.ptp(good[:, 0]), np.ptp(good[:, 1]), 1e-6)
        (north, south), (east, west) = ((good[:, i].max(), good[:, i].min()) for i in (0, 1))
        ax.set_ylim(*np.clip(ax.get_ylim(), south - margin, north + margin))
        ax.set_xlim(*np.clip(ax.get_xlim(), west - margin, east + margin))
    ax.set_aspect("equal", adjustable="datalim")


def window_errors(
    simulator: Simulator, trials: Sequence[Trial], times: np.ndarray, stride: float
) -> np.ndarray:
    """Open-loop errors (windows, times, 6) at ``times`` [s] after window starts ``stride`` seconds apart, NaN beyond."""
    rows = []
    for trial in trials:
        windows, _ = predict(simulator, trial, float(times[-1]), stride, short_last=True)
        for w in windows:
            error = wrapped_error(w.states, trial.states[w.first : w.last + 1])
            clock = trial.t[w.first : w.last + 1] - trial.t[w.first]
            rows.append(np.column_stack([np.interp(times, clock, e, right=np.nan) for e in error.T]))
    return np.array(rows).reshape(-1, len(times), 6)


def error_growth_plot(
    simulators: Mapping[str, Simulator],
    trials: Sequence[Trial],
    horizon: float = PAPER_WINDOW,
    stride: float | None = None,
) -> Figure:
    """Rms error of open-loop predictions against the time since the measured start, for each simulator.

    horizon: longest prediction [s]; stride: between the starts of windows [s], default half the horizon.
    """
    times = np.linspace(0, horizon, 101)
    used = [t for t in trials if t.has_position] or list(trials)
    figure = new_figure(5.0)
    axes = figure.subplots(2, 3, sharex=True).ravel()
    panels = (
        ("position [m]", (0, 1), 1.0), ("heading [deg]", (2,), 180 / np.pi), ("u [m/s]", (3,), 1.0),
        ("v [m/s]", (4,), 1.0), ("r [deg/s]", (5,), 180 / np.pi),
    )  # fmt: skip
    counts = np.zeros(len(times))
    for (name, simulator), style in zip(simulators.items(), STYLES, strict=False):
        errors = window_errors(simulator, used, times, stride or horizon / 2)
        counts = np.isfinite(errors[:, :, 3]).sum(axis=0)
        shown = counts >= max(1, 0.3 * counts.max(initial=0))
        for ax, (_, states, factor) in zip(axes, panels, strict=False):
            squares = np.where(np.isfinite(errors[:, :, states]), errors[:, :, states] ** 2, 0.0).sum(axis=(0, 2))
            rms = np.sqrt(squares / np.maximum(counts, 1)) * factor
            ax.plot(times[shown], rms[shown], lw=1.8, label=name, **style)
    for ax, (label, *_) in zip(axes, panels, strict=False):
        dress(ax, "", f"rms error of {label}")
        ax.set_ylim(bottom=0)
        ax.set_xlim(0, horizon)
    dress(axes[5], "", "windows [-]").plot(times, counts, color=GREY, lw=1.4)
    axes[5].set_ylim(bottom=0)
    for ax in axes[3:]:
        ax.set_xlabel("time since the start of a window [s]", fontsize=8.5)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    return figure

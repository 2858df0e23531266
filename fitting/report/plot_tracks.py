"""Figures of predictions: the track of a trial with its histories, and how errors grow over the horizon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.trial import Trial
from fitting.prediction.predict import Forecaster, Window, predict_all
from fitting.prediction.score import PAPER_WINDOW
from fitting.report.plot_style import GRID, MEASURED, STYLES, dress, new_figure, placed_axes
from mmg.rollout import Simulator

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEGREES = 180 / np.pi
HISTORIES = (
    (3, "u [m/s]", 1.0), (4, "v [m/s]", 1.0), (5, "r [deg/s]", DEGREES), (2, "psi [deg]", DEGREES),
)  # fmt: skip
"""State number, label and factor of each time history."""

OUTLINE = np.array([[0.5, 0], [0.32, 0.08], [-0.5, 0.08], [-0.5, -0.08], [0.32, -0.08], [0.5, 0]])
"""Outline of a ship of unit length: forward, starboard."""

TRACK_SHAPE = 1.7
"""Width over height of the track's panel."""

INPUTS = (("#555555", "-"), ("#555555", "--"), ("#A0A0A0", "-"), ("#A0A0A0", "--"))
"""Colour and line of each input of one kind."""


def trajectory_plot(
    trial: Trial, before: Sequence[Window], after: Sequence[Window], length: float | None = None
) -> Figure:
    """Track of one trial, measured against open-loop windows, north up; below it states and inputs over time.

    before, after: windows of ``predict``; length: of the ship [m], to draw its outline where windows start.
    """
    t, states = trial.t - trial.t[0], trial.states
    runs = [_joined(trial, before), _joined(trial, after)]
    first = [w.first for w in after]
    top = 1 if trial.has_position else 0
    inputs = _inputs(trial)
    count = len(HISTORIES) + len(inputs)
    height = (4.4 if top else 0.0) + 0.5 + 0.95 * count
    figure = new_figure(height, layout=None)
    grid = figure.add_gridspec(
        count + top, 1, height_ratios=[5.2] * top + [1.0] * count, left=0.1, right=0.985, bottom=0.5 / height,
        top=1 - 0.4 / height, hspace=0.14,
    )  # fmt: skip
    if top:
        ax = dress(figure.add_subplot(grid[0]), "y, east [m]", "x, north [m]")
        _track(ax, states, runs, first, length)
        box = ax.get_position()  # room for the label of the horizontal axis
        ax.set_position((box.x0, box.y0 + 0.026, box.width, box.height - 0.026))
    strips: list[Axes] = []
    for state, label, factor in HISTORIES:
        ax = figure.add_subplot(grid[top + len(strips)], sharex=strips[0] if strips else None)
        dress(ax, y=label).plot(t, states[:, state] * factor, color=MEASURED, lw=1.1, label="measured")
        for (clock, z), style, name in zip(runs, STYLES, ("before", "after"), strict=False):
            ax.plot(clock, z[:, state] * factor, lw=1.2, label=name, **style)
        reach = np.concatenate([states[:, state], runs[1][1][:, state]]) * factor
        ax.set_ylim(*_near(ax.get_ylim(), reach, 0.6))
        strips.append(ax)
    for label, rows in inputs.items():
        ax = dress(figure.add_subplot(grid[top + len(strips)], sharex=strips[0]), y=label)
        for (name, values), (color, dashes) in zip(rows.items(), cycle(INPUTS)):
            ax.plot(t, values, color=color, ls=dashes, lw=1.0, label=name)
        if len(rows) > 1:
            ax.legend(fontsize=7, ncols=4, loc="upper right", frameon=False, borderaxespad=0.1)
        strips.append(ax)
    strips[-1].set_xlabel("time from the first sample [s]", fontsize=9)
    strips[-1].set_xlim(0, max(t[-1], 1e-9))
    for ax in strips:
        _upright(ax, t[first], color="#C8C8C8", linewidth=0.7, linestyle=":")
        if ax is not strips[-1]:  # a tick is five artists: those of the lowest strip serve all
            ax.xaxis.set_visible(False)
            _upright(ax, strips[-1].get_xticks(), color=GRID, linewidth=0.6)
        ax.yaxis.set_label_coords(-0.085, 0.5)
    handles, labels = strips[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=3, fontsize=9, frameon=False)
    return figure


def _upright(ax: Axes, at: np.ndarray, **look: Any) -> None:
    """Lines of one ``look`` through the whole height of ``ax``, behind all else, ``at`` these values (m,)."""
    from matplotlib.collections import LineCollection  # late: slow to import

    lines = [((x, 0.0), (x, 1.0)) for x in at]
    ax.add_collection(LineCollection(lines, transform=ax.get_xaxis_transform(), zorder=0, **look), autolim=False)


def _inputs(trial: Trial) -> dict[str, dict[str, np.ndarray]]:
    """What moves the ship, by the label of its axis: angles, then revolutions, by column; none that rests."""
    angles = {c: np.degrees(trial[c]) for c in trial.columns if c.startswith(("delta", "azimuth"))}
    turns = {c: trial[c] for c in trial.columns if c == "n" or c.startswith("n_")}
    labels = ("delta [deg]" if list(angles) == ["delta"] else "angles [deg]", "n [1/s]")
    moved = [{c: x for c, x in rows.items() if np.any(x)} for rows in (angles, turns)]
    shown = moved if any(moved) else [angles, turns]
    return {label: rows for label, rows in zip(labels, shown, strict=True) if rows}


def _joined(trial: Trial, windows: Sequence[Window]) -> tuple[np.ndarray, np.ndarray]:
    """Time from the first sample (rows,) and states (rows, 6) of all windows, a row of NaN between them."""
    if not windows:
        return np.empty(0), np.empty((0, 6))
    gap = np.full((1, 6), np.nan)
    t = [np.append(trial.t[w.first : w.last + 1] - trial.t[0], np.nan) for w in windows]
    return np.concatenate(t), np.vstack([part for w in windows for part in (w.states, gap)])


def _near(limits: tuple[float, float], values: np.ndarray, room: float) -> tuple[float, float]:
    """Limits no further than ``room`` spans from the values: a run-away prediction must not flatten the rest."""
    values = values[np.isfinite(values)]
    if not len(values):
        return limits
    low, high = float(values.min()), float(values.max())
    span = room * max(high - low, 1e-9)
    return max(limits[0], low - span), min(limits[1], high + span)


def _track(ax: Axes, states: np.ndarray, runs: list, first: list[int], length: float | None) -> None:
    ax.plot(states[:, 1], states[:, 0], color=MEASURED, lw=1.3, zorder=2)
    for (_, z), style in zip(runs, STYLES, strict=False):
        ax.plot(z[:, 1], z[:, 0], lw=1.3, zorder=3, **style)
    ax.plot(states[first, 1], states[first, 0], ".", color=MEASURED, ms=6, zorder=4)
    if length:
        body = OUTLINE * length
        for x, y, psi in states[first, :3]:
            c, s = np.cos(psi), np.sin(psi)
            ax.fill(y + body @ [s, c], x + body @ [c, -s], fc="none", ec=MEASURED, lw=0.8, zorder=4)
    near = np.vstack([states, runs[1][1]])
    low_y, high_y = _near(ax.get_xlim(), near[:, 1], 0.3)
    low_x, high_x = _near(ax.get_ylim(), near[:, 0], 0.3)
    height = max(high_x - low_x, (high_y - low_y) / TRACK_SHAPE)
    ax.set_xlim(*(0.5 * (low_y + high_y) + 0.5 * TRACK_SHAPE * height * np.array([-1, 1])))
    ax.set_ylim(*(0.5 * (low_x + high_x) + 0.5 * height * np.array([-1, 1])))
    ax.set_aspect("equal", adjustable="box")


def window_errors(
    simulator: Simulator | Forecaster, trials: Sequence[Trial], times: np.ndarray, stride: float
) -> np.ndarray:
    """Returns open-loop errors (windows, times, 6) at ``times`` [s] after the start of windows ``stride`` [s] apart.

    simulator: what predicts; trials: measured. Windows that reach the last time are used; where there are none, shorter
    ones, with NaN after their end.
    """
    rows: list[np.ndarray] = []
    for short in (False, True):
        predicted = predict_all(simulator, trials, float(times[-1]), stride, short_last=short)
        for trial, w in ((t, w) for t, (windows, _) in zip(trials, predicted, strict=True) for w in windows):
            clock, right = trial.t[w.first : w.last + 1] - trial.t[w.first], np.nan if short else None
            rows.append(np.transpose([np.interp(times, clock, e, right=right) for e in w.error(trial.states).T]))
        if rows:
            break
    return np.array(rows).reshape(-1, len(times), 6)


def error_growth_plot(
    simulators: Mapping[str, Simulator | Forecaster],
    trials: Sequence[Trial],
    horizon: float = PAPER_WINDOW,
    stride: float | None = None,
) -> Figure:
    """Rms error of open-loop predictions against the time since the measured start, for each simulator or black box.

    simulators: by name; trials: measured, those with positions are used where there are any; horizon: longest
    prediction [s]; stride: between the starts of windows [s], default a quarter of the horizon. Errors in ship lengths
    are those of the first simulator that is a ship.
    """
    length = next((s.ship.particulars["L"] for s in simulators.values() if isinstance(s, Simulator)), None)
    times = np.linspace(0, horizon, 101)
    used = [t for t in trials if t.has_position] or list(trials)
    figure, grid = placed_axes(4.9, (2, 3), (0.7, 0.2, 0.5, 0.15), (0.75, 0.65))
    axes = grid.ravel()
    panels = (
        ("position [m]", (0, 1), 1.0), ("heading [deg]", (2,), DEGREES), ("u [m/s]", (3,), 1.0),
        ("v [m/s]", (4,), 1.0), ("r [deg/s]", (5,), DEGREES),
    )  # fmt: skip
    count, words = 0, ""
    for (name, simulator), style in zip(simulators.items(), STYLES, strict=False):
        errors = window_errors(simulator, used, times, stride or horizon / 4)
        count = len(errors)
        for ax, (_, states, factor) in zip(axes, panels, strict=False):
            part = errors[:, :, states]
            measured = np.isfinite(part).all(axis=2)
            squares = np.where(measured, np.nan_to_num(part**2).sum(axis=2), 0.0).sum(axis=0)
            shown = measured.sum(axis=0) >= max(1, 0.3 * count)
            rms = np.sqrt(squares / np.maximum(measured.sum(axis=0), 1)) * factor
            ax.plot(times[shown], rms[shown], lw=1.8, label=name, **style)
            if states == (0, 1) and shown[-1] and length:
                words += f"\nposition, {name}: {rms[-1] / length:.2g} ship lengths"
    for ax, (label, *_) in zip(axes, panels, strict=False):
        dress(ax, "time since window start [s]", f"rms error of {label}")
        ax.set_ylim(bottom=0)
        ax.set_xlim(0, horizon)
    axes[5].axis("off")
    axes[5].legend(*axes[0].get_legend_handles_labels(), loc="upper left", fontsize=9, frameon=False)
    after = f"\n\nafter {horizon:g} s:{words}" if words else ""
    note = f"{count} windows of {horizon:g} s\nof {len(used)} trial(s){after}"
    axes[5].text(0.0, 0.62, note, transform=axes[5].transAxes, fontsize=8, va="top", linespacing=1.5)
    return figure

"""Figures of predictions: the track of a trial with its histories, and how errors grow over the horizon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.trial import Trial
from fitting.prediction.predict import Forecaster, Window, predict_all
from fitting.prediction.score import PAPER_WINDOW
from fitting.report.plot_style import GREY, GRID, MEASURED, STYLES, dress, new_figure, placed_axes
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
    top = 4.5 if trial.has_position else 0.0
    strips = [
        _Strip(label, [(t, states[:, i] * factor, {"color": MEASURED, "lw": 1.1, "label": "measured"})]
               + [(clock, z[:, i] * factor, {"lw": 1.2, "label": name} | style)
                  for (clock, z), style, name in zip(runs, STYLES, ("before", "after"), strict=False)],
               np.concatenate([states[:, i], runs[1][1][:, i]]) * factor)
        for i, label, factor in HISTORIES
    ]  # fmt: skip
    for label, rows in _inputs(trial).items():
        looks = [{"color": color, "ls": dashes, "lw": 1.0} for (color, dashes), _ in zip(cycle(INPUTS), rows)]
        words = label if len(rows) == 1 else f"{label}: {', '.join(rows)}"
        lines = [(t, values, look) for values, look in zip(rows.values(), looks, strict=True)]
        strips.append(_Strip(words, lines, np.concatenate(list(rows.values()))))
    high = 0.95 * len(strips)
    figure = new_figure(top + high + 0.9, layout=None)
    over = high + 0.5 + (0.5 if top else 0.0)  # height of the lower edge of the track
    if top:
        place = (0.1, over / figure.get_figheight(), 0.885, (top - 0.5) / figure.get_figheight())
        ax = dress(figure.add_axes(place), "y, east [m]", "x, north [m]")
        ax.locator_params(nbins=6)
        _track(ax, states, runs, first, length)
    ax = figure.add_axes((0.1, 0.5 / figure.get_figheight(), 0.885, high / figure.get_figheight()))
    dress(ax, "time from the first sample [s]").set_xlim(0, max(t[-1], 1e-9))
    _draw_strips(ax, strips, t[first])
    figure.legend(*ax.get_legend_handles_labels(), loc="upper center", ncols=3, fontsize=9, frameon=False)
    return figure


@dataclass(frozen=True)
class _Strip:
    """Histories of one quantity over time: label with its unit, lines (times, values, look), and the values (m,) from
    which a run-away prediction must not lead the scale."""

    label: str
    lines: list[tuple[np.ndarray, np.ndarray, dict[str, Any]]]
    values: np.ndarray


def _draw_strips(ax: Axes, strips: Sequence[_Strip], starts: np.ndarray) -> None:
    """Draw ``strips`` below one another on ``ax``, each over the height 1: axes of their own cost five times as much.
    starts: times of the windows, dotted."""
    from matplotlib.collections import LineCollection  # late: slow to import
    from matplotlib.ticker import MaxNLocator

    across, marks = ax.get_yaxis_transform(), []
    for row, strip in enumerate(reversed(strips)):
        every = np.concatenate([y for _, y, _ in strip.lines])
        every = every[np.isfinite(every)]
        low, high = _near((every.min(), every.max()), strip.values, 0.6) if len(every) else (0.0, 1.0)
        room = max(high - low, 1e-9)
        scale, zero = 0.76 / room, row + 0.06 - 0.76 * low / room  # the label stands above
        for x, y, look in strip.lines:
            look = look if strip is strips[0] else {k: v for k, v in look.items() if k != "label"}
            ax.plot(x, np.clip(zero + scale * y, row, row + 1), **look)
        for tick in MaxNLocator(3).tick_values(low, high):
            if row + 0.04 < zero + scale * tick < row + 0.9:
                marks.append(zero + scale * tick)
                words = f"{tick:.6g}".replace("-", "−")
                ax.text(-0.008, marks[-1], words, transform=across, fontsize=8, ha="right", va="center")
        ax.text(0.004, row + 0.98, strip.label, transform=across, fontsize=8, va="top", color="#333333")
    ax.set_ylim(0, len(strips))
    ax.yaxis.set_visible(False)
    for at, look in (
        (marks, {"color": GRID, "linewidth": 0.6}),
        (range(len(strips)), {"color": GREY, "linewidth": 0.8}),
    ):
        ax.add_collection(LineCollection([((0, y), (1, y)) for y in at], transform=across, zorder=0, **look), False)
    upright = {"transform": ax.get_xaxis_transform(), "color": "#C8C8C8", "linewidth": 0.7, "linestyle": ":"}
    ax.add_collection(LineCollection([((x, 0), (x, 1)) for x in starts], zorder=0, **upright), False)


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
) -> tuple[np.ndarray, np.ndarray]:
    """Returns open-loop errors (W, times, 6) at ``times`` [s] after the start of W windows ``stride`` [s] apart, and
    the number of the trial of each window, (W,).

    simulator: what predicts; trials: measured. Windows that reach the last time are used; where there are none, shorter
    ones, with NaN after their end.
    """
    rows: list[np.ndarray] = []
    numbers: list[int] = []
    for short in (False, True):
        predicted = predict_all(simulator, trials, float(times[-1]), stride, short_last=short)
        for number, (trial, (windows, _)) in enumerate(zip(trials, predicted, strict=True)):
            for w in windows:
                clock, right = trial.t[w.first : w.last + 1] - trial.t[w.first], np.nan if short else None
                rows.append(np.transpose([np.interp(times, clock, e, right=right) for e in w.error(trial.states).T]))
                numbers.append(number)
        if rows:
            break
    return np.array(rows).reshape(-1, len(times), 6), np.array(numbers, dtype=int)


def rms_with_error(squares: np.ndarray, run: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root of the mean of ``squares`` (W, T) over windows, NaN left out, and its standard error, both (T,).

    run: the trial of each window, (W,). The error is that of leaving out one trial after the other (jackknife, Efron
    1982), NaN with a single one: windows of a trial share its gusts.
    """
    known = np.isfinite(squares)
    groups = [run == number for number in np.unique(run)]
    total = np.array([np.where(known[g], squares[g], 0.0).sum(axis=0) for g in groups])  # (trials, T)
    count = np.array([known[g].sum(axis=0) for g in groups])
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.sqrt(total.sum(axis=0) / count.sum(axis=0))
        without = np.sqrt((total.sum(axis=0) - total) / (count.sum(axis=0) - count))
    if len(groups) < 2:
        return rms, np.full_like(rms, np.nan)
    return rms, np.sqrt((len(groups) - 1) * np.mean((without - without.mean(axis=0)) ** 2, axis=0))


PANELS = (
    ("position [m]", (0, 1), 1.0), ("heading [deg]", (2,), DEGREES), ("u [m/s]", (3,), 1.0),
    ("r [deg/s]", (5,), DEGREES),
)  # fmt: skip
"""Title, state numbers and factor of each panel of the growth of errors: the errors that scores show in units."""


def error_growth_plot(
    simulators: Mapping[str, Simulator | Forecaster],
    trials: Sequence[Trial],
    horizon: float = PAPER_WINDOW,
    stride: float | None = None,
) -> Figure:
    """Rms error of open-loop predictions against the time since the measured start, for each simulator or black box.

    Shaded: one standard error, by leaving out trials, of a single one windows. simulators: by name; trials: measured,
    those with positions are used where there are any; horizon: longest prediction [s]; stride: between the starts of
    windows [s], default half of it. The legend gives position errors in lengths of the first simulator that is a ship.
    """
    length = next((s.ship.particulars["L"] for s in simulators.values() if isinstance(s, Simulator)), None)
    times = np.linspace(0, horizon, 51)
    used = [t for t in trials if t.has_position] or list(trials)
    figure, grid = placed_axes(2.4, (1, 4), (0.38, 0.15, 0.45, 0.55), (0.55, 0.0))
    count = 0
    for (name, simulator), style in zip(simulators.items(), STYLES, strict=False):
        errors, run = window_errors(simulator, used, times, stride or horizon / 2)
        count, words = len(errors), name
        for ax, (_, states, factor) in zip(grid[0], PANELS, strict=True):
            squares = (errors[:, :, states] ** 2).sum(axis=2)
            parts = run if len(np.unique(run)) > 1 else np.arange(len(run))  # of a single trial its windows
            rms, std = (factor * part for part in rms_with_error(squares, parts))
            rms[np.isfinite(squares).sum(axis=0) < max(1, 0.3 * count)] = np.nan
            if states == (0, 1) and length and np.isfinite(rms[-1]):
                words += f" ({rms[-1] / length:.2g} ship lengths after {horizon:g} s)"
            good = np.isfinite(rms + std)
            ends = np.concatenate([rms + std, (rms - std)[::-1]])[np.concatenate([good, good[::-1]])]
            ax.fill(np.concatenate([times[good], times[good][::-1]]), ends, color=style["color"], alpha=0.18, lw=0)
            ax.plot(times, rms, lw=1.8, label=words if ax is grid[0, 0] else None, **style)
    for ax, (label, *_) in zip(grid[0], PANELS, strict=True):
        dress(ax, "time [s]", title=label)
        ax.set_ylim(bottom=0)
        ax.set_xlim(0, horizon)
        ax.locator_params(nbins=4)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="upper left", ncols=3, fontsize=8.5, frameon=False)
    words = f"{count} windows of {horizon:g} s, {len(used)} trial{'s' * (len(used) != 1)}"
    figure.text(0.985, 0.945, words, fontsize=8, ha="right", va="center", color="#555555")
    return figure

"""Figures of a calibration: one function per plot, each takes a result and returns a matplotlib Figure.

No pyplot, no backend and no rcParams are touched; units stand on every axis. Measured is black, before the calibration
orange and dashed, after it blue (colours of Okabe & Ito, told apart by colour-blind readers and in grey print).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.trial import Trial
from fitting.calibration import Calibration, Start
from fitting.ipopt import Solution
from fitting.predict import Window, predict
from fitting.run import coefficient_rows
from fitting.score import PAPER_WINDOW, wrapped_error
from mmg.components import ROLES, coefficient_table
from mmg.rollout import Simulator
from mmg.ship import Ship

BEFORE, AFTER, MEASURED, GREY, ALARM = "#D58A00", "#0072B2", "#111111", "#8A8A8A", "#C0305A"
STYLES = ({"color": BEFORE, "linestyle": (0, (4, 1.5))}, {"color": AFTER}, {"color": "#009E73", "linestyle": ":"})
WIDTH, DPI = 8.2, 110
GROUPS = ("mass", *ROLES, "other")
DETERMINED, PARTLY = 0.1, 0.7
"""Prior's share of the variance below which a coefficient is determined, partly determined by the data."""


def component_of(ship: Ship) -> dict[str, str]:
    """Component each coefficient belongs to: "mass", or the role of its force model."""
    found = dict.fromkeys(coefficient_table({}, ship.particulars), "mass")
    for role, name in ship.components.items():
        for symbol in coefficient_table({role: name}, ship.particulars):
            found.setdefault(symbol, role)
    return found


def grouped(rows: Mapping[str, Any], components: Mapping[str, str]) -> list[tuple[str, list[str]]]:
    """(component, symbols in their order) for each component that has any of ``rows``."""
    groups: dict[str, list[str]] = {g: [] for g in GROUPS}
    for symbol in rows:
        groups.setdefault(components.get(symbol, "other"), []).append(symbol)
    return [(group, symbols) for group, symbols in groups.items() if symbols]


def determination(row: Mapping[str, Any]) -> str:
    """ "determined", "partly", "prior" or "unknown": what decided a coefficient, from the prior's share."""
    share = row.get("prior_share")
    if share is None or not np.isfinite(share):
        return "unknown"
    return "determined" if share < DETERMINED else "partly" if share < PARTLY else "prior"


def _figure(height: float) -> Figure:
    return Figure(figsize=(WIDTH, height), dpi=DPI, layout="constrained", facecolor="white")


def _dress(ax: Axes, x: str = "", y: str = "", title: str = "") -> Axes:
    ax.set_xlabel(x, fontsize=9)
    ax.set_ylabel(y, fontsize=9)
    ax.set_title(title, fontsize=9.5, loc="left", fontweight="bold")
    ax.tick_params(labelsize=8, length=3, color=GREY)
    ax.grid(True, color="#E4E4E4", linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color(GREY)
    return ax


MARKS = {
    "determined": {"marker": "o", "color": AFTER, "mfc": AFTER, "label": "determined by the data"},
    "partly": {"marker": "o", "color": AFTER, "mfc": "white", "label": "partly determined"},
    "prior": {"marker": "s", "color": GREY, "mfc": "white", "label": "decided by the prior"},
    "unknown": {"marker": "x", "color": GREY, "mfc": GREY, "label": "uncertainty not available"},
}


def coefficient_plot(
    source: Calibration | Mapping[str, Mapping[str, Any]], components: Mapping[str, str] | None = None
) -> Figure:
    """Shift of every free coefficient from its prior in prior standard deviations, with its standard error.

    source: a calibration, or the rows of "coefficients" in result.json; components: symbol -> component, for rows.
    """
    if isinstance(source, Calibration):
        components = components or component_of(source.ship)
        rows: Mapping[str, Mapping[str, Any]] = coefficient_rows(source)
    else:
        rows = source
    lines: list[tuple[str, str | None]] = []
    for group, symbols in grouped(rows, components or {}):
        lines += [(group, None), *((group, symbol) for symbol in symbols)]
    columns = 2 if len(lines) > 24 else 1
    half = -(-len(lines) // columns)
    if columns == 2:  # break at the component boundary nearest to the middle if that keeps the columns balanced
        heads = [i for i, line in enumerate(lines) if line[1] is None and abs(i - half) <= 5]
        half = min(heads, key=lambda i: abs(i - half)) if heads else half
    parts = [lines[:half], lines[half:]] if columns == 2 else [lines]
    longest = max(len(part) for part in parts)
    figure = _figure(1.3 + 0.185 * longest)
    used: dict[str, Any] = {}
    extent = 2.2
    axes = figure.subplots(1, columns, squeeze=False, sharex=True)[0]
    for ax, part in zip(axes, parts, strict=True):
        _dress(ax, "(estimate - prior) / prior standard deviation [-]")
        ax.axvspan(-1, 1, color="#EFF3F6", zorder=0)
        ax.axvline(0, color=GREY, linewidth=0.8, zorder=1)
        for height, (group, symbol) in enumerate(part):
            if symbol is None:
                ax.text(
                    0.01, height, group, transform=ax.get_yaxis_transform(), fontsize=9, fontweight="bold", va="center"
                )
                continue
            row = rows[symbol]
            prior_std = row["prior_std"] or np.nan
            shift = (row["value"] - row["prior_value"]) / prior_std
            std = row["std"] / prior_std if row.get("std") is not None else np.nan
            kind = determination(row)
            look = MARKS[kind]
            used[kind] = ax.errorbar(
                shift, height, xerr=std if np.isfinite(std) else None, fmt=look["marker"], color=look["color"],
                mfc=look["mfc"], ms=4.2, lw=1.2, zorder=3,
            )  # fmt: skip
            if np.isfinite(shift):
                extent = max(extent, abs(shift) + (std if np.isfinite(std) else 0) + 0.2)
            if row.get("at_bound"):
                sign = "<" if row["at_bound"] == "lower" else ">"
                used["bound"] = ax.plot(shift, height, sign, color=ALARM, ms=9, mfc="none", mew=1.4, zorder=4)[0]
        ax.set_ylim(longest - 0.4, -0.8)
        ax.set_yticks(
            [i for i, line in enumerate(part) if line[1]], [line[1] for line in part if line[1]], fontsize=8
        )
        ax.grid(axis="y", visible=False)
    axes[0].set_xlim(-extent, extent)
    order = [k for k in (*MARKS, "bound") if k in used]
    names = {**{k: str(v["label"]) for k, v in MARKS.items()}, "bound": "at a bound"}
    figure.legend(
        [used[k] for k in order], [names[k] for k in order], loc="outside upper center", ncols=5, fontsize=8,
        frameon=False,
    )  # fmt: skip
    return figure


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
    figure = _figure(10.2 if trial.has_position else 6.4)
    if trial.has_position:
        grid = figure.add_gridspec(6, 1, height_ratios=[5.2, *heights])
        ax = _dress(figure.add_subplot(grid[0]), "y, east [m]", "x, north [m]")
        _track(ax, states, runs, [w.first for w in after], length)
        first = 1
    else:
        grid, first = figure.add_gridspec(5, 1, height_ratios=heights), 0
    below: list[Axes] = []
    wanted = ((3, "u [m/s]", 1.0), (4, "v [m/s]", 1.0), (5, "r [deg/s]", 180 / np.pi), (2, "psi [deg]", 180 / np.pi))
    for k, (state, label, factor) in enumerate(wanted):
        ax = _dress(figure.add_subplot(grid[first + k], sharex=below[0] if below else None), y=label)
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
    ax = _dress(
        figure.add_subplot(grid[first + 4], sharex=below[0]), "time from the first sample [s]", "delta [deg]"
    )
    ax.plot(t, np.degrees(trial["delta"]), color=MEASURED, lw=1.0)
    twin = _dress(ax.twinx(), y="n [1/s]")
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
    figure = _figure(5.0)
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
        _dress(ax, "", f"rms error of {label}")
        ax.set_ylim(bottom=0)
        ax.set_xlim(0, horizon)
    _dress(axes[5], "", "windows [-]").plot(times, counts, color=GREY, lw=1.4)
    axes[5].set_ylim(bottom=0)
    for ax in axes[3:]:
        ax.set_xlabel("time since the start of a window [s]", fontsize=8.5)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    return figure


def score_plot(scores: Mapping[str, Mapping[str, Mapping[str, Any]]], most: int = 30) -> Figure:
    """Both metrics of every trial before and after, from "scores" of result.json: set -> before, after -> rows.

    At most ``most`` trials are drawn, held-out ones first.
    """
    lines: list[tuple[str, dict | None, dict | None]] = []
    for name, pair in scores.items():
        rows = list(zip(pair["before"]["trials"], pair["after"]["trials"], strict=True))
        title = {"validation": "held out", "training": "training"}.get(name, name)
        room = most - sum(1 for line in lines if line[1])
        if rows and room > 0:
            pooled = dict(pair["before"], name="all pooled"), dict(pair["after"], name="all pooled")
            lines += [(title, None, None), ("", *pooled), *(("", b, a) for b, a in rows[:room])]
    figure = _figure(1.1 + 0.3 * len(lines))
    axes = figure.subplots(1, 2, sharey=True)
    for ax, key, title in zip(axes, ("window", "paper"), ("30 s windows", "100 s restarts"), strict=True):
        _dress(ax, "mean squared normalised error [-]", "", title)
        largest = max((v for _, *pair in lines for row in pair if row and (v := row[key])), default=1.0)
        for height, (_, *pair) in enumerate(lines):
            for row, offset, colour in zip(pair, (-0.19, 0.19), (BEFORE, AFTER), strict=True):
                if row is None or row[key] is None:
                    continue
                ax.barh(height + offset, row[key], 0.36, color=colour, hatch="////" if colour == BEFORE else None,
                        edgecolor="white", linewidth=0)  # fmt: skip
                ax.text(
                    row[key] + 0.012 * largest, height + offset, f"{row[key]:.3g}", fontsize=7, va="center",
                    color="#444444",
                )  # fmt: skip
        ax.set_xlim(0, 1.14 * largest)
        ax.grid(axis="y", visible=False)
        ax.tick_params(axis="y", length=0)
    labels = [heading or (pair[0]["name"] if pair[0] else "") for heading, *pair in lines]
    axes[0].set_yticks(range(len(lines)), labels, fontsize=7.5)
    for tick, (heading, *_) in zip(axes[0].get_yticklabels(), lines, strict=True):
        tick.set_fontweight("bold" if heading or tick.get_text() == "all pooled" else "normal")
    axes[0].set_ylim(len(lines) - 0.4, -0.6)
    bars = [figure_bar(BEFORE, "////"), figure_bar(AFTER, None)]
    figure.legend(bars, ["before", "after"], loc="outside upper center", ncols=2, fontsize=9, frameon=False)
    return figure

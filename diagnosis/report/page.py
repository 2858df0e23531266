"""The report on a diagnosis: figures and one self-contained HTML page that a naval architect reads in two minutes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from cases.criteria.standard_runs import approach_speed, simulated_run
from cases.shipfiles.effects import calm_and_deep
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.findings import Findings
from diagnosis.groups.between import table_rows
from diagnosis.report import words
from diagnosis.report.words import TURN_BACK, shown_unit
from diagnosis.validation.gap import FLOOR, REFITTED, Gap
from fitting.report.page import rendered, write_page
from fitting.report.plot_style import AFTER, BEFORE, GREY, MEASURED, FigureFolder, dress, figures_of, new_figure
from fitting.report.plots import OUTLINE
from fitting.report.run_folder import FIGURES, PAGE
from mmg.errors import UserError

ARROWS = 26  # Arrows along a track. Set by hand: more run into one another.
SHOWN = 6  # Variables in the figure of what the missing force depends on. Set by hand.
PANELS = 4  # Tracks in the figure. Set by hand: they fill a screen.
# Colours of a moment to port, none, to starboard; white dashes along the line as well where it turns to port.
TURNING = LinearSegmentedColormap.from_list("turning", ["#7A3B9A", "#B9B9B9", "#009E73"])
FELT = 0.1  # Share of the full scale from which on a moment to port is marked by them. Set by hand.


def track_figure(d: Findings) -> Figure:
    """Tracks of the windows of ``d`` with the largest missing force, as arrows of one scale, the moment by colour.

    d: with its fit and data, which findings read from a folder have not.
    """
    fit, data = d.null, d.data
    assert fit is not None and data is not None
    chosen = _strongest(fit, data, d.where["channels"])
    columns = 2 if len(chosen) > 1 else 1
    rows = -(-len(chosen) // columns)
    figure = new_figure(0.5 + (3.6 if columns > 1 else 5.0) * rows)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    # one scale for all panels, by a quantile: a single spike would make all other arrows dots
    force = np.concatenate([fit.path.force[: data.steps[w], w] for w in chosen])
    scale = tuple(max(float(np.quantile(a, 0.95)), 1e-12) for a in (np.hypot(*force[:, :2].T), np.abs(force[:, 2])))
    length = float(d.ship.particulars["L"])
    lines = [plot_track(fit, data, ax, int(w), scale, length) for ax, w in zip(axes, chosen, strict=False)]
    for ax in axes[len(chosen) :]:
        ax.axis("off")
    if lines:
        bar = figure.colorbar(lines[-1], ax=list(axes), location="bottom", fraction=0.02, aspect=70, pad=0.02)
        bar.outline.set_visible(False)
        bar.set_label(
            "missing yaw moment [N m]: bow to port (white dashes)  ←   track   →  bow to starboard", fontsize=8.5
        )
        bar.ax.tick_params(labelsize=8)
    return figure


def _strongest(fit: Estimate, data: GriddedTrials, channels: Mapping[str, Any]) -> np.ndarray:
    """Windows with the most energy of the missing force, one of each trial, in the order of the trials."""
    weight = np.array([row["share"] / max(row["force_rms"], 1e-12) ** 2 for row in channels.values()])
    energy = [float((fit.path.force[:s, w] ** 2 @ weight).mean()) for w, s in enumerate(data.steps)]
    best = [max(np.flatnonzero(data.run == run), key=lambda w: energy[w]) for run in np.unique(data.run)]
    return np.array(sorted(sorted(best, key=lambda w: -energy[w])[:PANELS]), dtype=int)


def plot_track(
    fit: Estimate, data: GriddedTrials, ax: Axes, window: int, scale: tuple[float, ...], length: float
) -> LineCollection:
    """The track of one ``window`` of ``data`` with the missing force of ``fit``, into ``ax``; the line, for a colour
    bar.

    scale: the force [N] drawn 0.15 of the panel long, and the moment [N m] in full colour; length: of the ship [m].
    """
    reach, turn = scale
    steps = data.steps[window]
    z, force = fit.path.z[: steps + 1, window], fit.path.force[:steps, window]
    points = z[:, 1::-1]  # east, north
    dress(ax, "y, east [m]", "x, north [m]", data.trials[data.run[window]])
    half = 0.65 * max(np.ptp(points[:, 0]), np.ptp(points[:, 1]), 2 * length)
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
    ax.set_xlim(middle[0] - half, middle[0] + half)
    ax.set_ylim(middle[1] - half, middle[1] + half)
    ax.set_aspect("equal", adjustable="box")
    lines = LineCollection(np.stack([points[:-1], points[1:]], axis=1), cmap=TURNING, lw=3.0, zorder=2)  # type: ignore[arg-type]
    lines.set_array(force[:, 2])
    lines.set_clim(-turn, turn)
    ax.add_collection(lines)
    ax.plot(*to_port(points, force[:, 2], FELT * turn), color="white", lw=1.1, ls=(0, (3, 3)), zorder=2.5)
    at = np.linspace(0, steps - 1, min(ARROWS, steps)).round().astype(int)
    c, s = np.cos(z[at, 2]), np.sin(z[at, 2])
    north, east = c * force[at, 0] - s * force[at, 1], s * force[at, 0] + c * force[at, 1]
    style: dict[str, Any] = {
        "color": BEFORE, "angles": "xy", "scale_units": "xy", "scale": reach / (0.3 * half),
        "width": 0.006, "zorder": 3,
    }  # fmt: skip
    arrows = ax.quiver(points[at, 0], points[at, 1], east, north, **style)
    size = float(f"{reach:.1g}")
    ax.quiverkey(arrows, 0.8, 0.94, size, f"{size:g} N", labelpos="E", fontproperties={"size": 8.5})
    for k in np.linspace(0, steps - 1, 5).round().astype(int):
        c, s = np.cos(z[k, 2]), np.sin(z[k, 2])
        body = OUTLINE * length
        ax.fill(points[k, 0] + body @ [s, c], points[k, 1] + body @ [c, -s], fc="none", ec="#666666", lw=0.7, zorder=4)
    ax.plot(points[0, 0], points[0, 1], "o", color=MEASURED, ms=4.5, zorder=5)
    return lines


def to_port(points: np.ndarray, moment: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """East and north of the parts of a track whose ``moment`` (M,) turns the bow to port by more than ``least``, nan
    between them. points: (M + 1, 2)."""
    marked = np.append(moment, moment[-1]) < -least
    return np.where(marked, points[:, 0], np.nan), np.where(marked, points[:, 1], np.nan)


def state_figure(d: Findings) -> Figure:
    """Missing force of ``d`` averaged in bins of what it depends on most, with two standard errors."""
    rows: list[Mapping[str, Any]] = []
    for row in d.where.get("variables", []):  # the best first, two of a variable at most
        if sum(row["variable"] == other["variable"] for other in rows) < 2:
            rows.append(row)
    rows = rows[:SHOWN]
    figure = new_figure(0.4 + 2.5 * max(1, -(-len(rows) // 3)))
    axes = np.atleast_1d(figure.subplots(max(1, -(-len(rows) // 3)), 3)).ravel()
    for ax, row in zip(axes, rows, strict=False):
        plot_variable(row, ax)
    for ax in axes[len(rows) :]:
        ax.axis("off")
    if rows:
        handles, names = (list(part)[::-1] for part in axes[0].get_legend_handles_labels())
        figure.legend(handles, names, loc="outside upper center", ncols=2, fontsize=9, frameon=False)
    return figure


def plot_variable(row: Mapping[str, Any], ax: Axes) -> None:
    """A row of where["variables"]: the mean of the missing force over the variable, before and after, into ``ax``."""
    factor, unit = shown_unit(row["unit"])
    at = factor * np.array(row["at"])
    dress(ax, f"{row['variable']} [{unit}]", f"missing {row['channel']} [{row['force_unit']}]")
    ax.axhline(0.0, color=MEASURED, lw=0.8)
    ax.xaxis.set_major_locator(MultipleLocator(90) if row["variable"] in TURN_BACK else MaxNLocator(5))
    words = "before" if "mean_after" in row else "missing force"
    style: dict[str, Any] = {"color": BEFORE, "ls": "--", "marker": "o", "ms": 4, "lw": 1.3, "capsize": 2.5}
    ax.errorbar(at, row["mean"], 2 * np.array(row["std"]) if "std" in row else None, label=words, **style)
    if "mean_after" in row:
        ax.plot(at, row["mean_after"], color=AFTER, marker="s", ms=4, lw=1.5, label="after")
    share = max(0.0, row["explained"])
    weight = "bold" if share > 0.2 else "normal"
    ax.set_title(f"explains {100 * share:.0f} % of {row['channel']}", fontsize=8.5, loc="left", fontweight=weight)


def unexplained_figure(d: Findings) -> Figure:
    """The unexplained force of ``d`` through the trials in which it is largest, with the 90 % band and the latent
    force; beside it what each channel follows most.

    d: with its fit and data, which findings read from a folder have not.
    """
    missing, data, fit = d.unexplained_force, d.data, d.final if d.effects else d.null
    assert missing is not None and data is not None and fit is not None
    shown = [name for name, row in missing.channels.items() if row.force_rms > 0] or list(missing.channels)[:1]
    time = missing.times[0]
    windows = np.flatnonzero(data.run == data.trials.index(time.trial))
    figure = new_figure(0.6 + 2.4 * len(shown))
    axes = np.atleast_2d(figure.subplots(len(shown), 2, width_ratios=[2.0, 1.0]))
    for (left, right), name in zip(axes, shown, strict=True):
        c, unit = list(missing.channels).index(name), missing.channels[name].unit
        dress(left, "time [s]", f"{name} [{unit}]", f"{time.trial}" if name == shown[0] else "")
        left.axvspan(time.start, time.end, color="#F3EBDD", zorder=0)
        for w in windows:
            rows = slice(0, data.steps[w])
            t, mean, std = data.t[rows, w], missing.force[rows, w, c], missing.std[rows, w, c]
            first = w == windows[0]
            label = "latent force of the fit (chance included)" if first else ""
            left.plot(t, fit.path.force[rows, w, c], color="#B9B9B9", lw=0.9, label=label)
            left.fill_between(t, mean - 1.64 * std, mean + 1.64 * std, color=AFTER, alpha=0.25, lw=0)
            left.plot(t, mean, color=AFTER, lw=1.6, label="unexplained force, 90 % band" if first else "")
        row = next((v for v in missing.follows if v["channel"] == name), None)
        if row is None:
            right.axis("off")
            continue
        plot_variable(row, right)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=2, fontsize=9, frameon=False)
    return figure


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


def figures_for(d: Findings) -> Sequence[tuple[str, Callable[[Findings], Figure], str, str]]:
    """Name, function, title and caption of each figure that ``d`` can have. Those of tracks and times need its fit,
    which a diagnosis read from a folder has not."""
    fitted, every = d.null is not None and d.data is not None, []
    if d.unexplained_force is not None and d.unexplained_force.times and fitted:
        every.append((
            "unexplained_force", unexplained_figure, "The unexplained force",
            "Left: the force that motion, inputs, wind and place explain in an unnamed way, with its 90 % band, in the "
            "trial in which it is largest (shaded), and in grey the whole latent force of the fit, chance included. "
            "Right: its mean over the variable that it follows most.",
        ))  # fmt: skip
    if d.where and fitted:
        every.append((
            "where_on_track", track_figure, "The missing force on the track",
            "Tracks from above, north up. A dot marks the start, outlines show the ship. Arrows: the surge and sway "
            "force that the calibrated ship lacks (smoothed latent force); all panels have one scale. Colour of the "
            "track: the missing yaw moment. The trials with the largest missing force are shown.",
        ))  # fmt: skip
    if d.where:
        every.append((
            "where_in_state", state_figure, "What the missing force depends on",
            "Missing force averaged in bins; positive: ahead, to starboard, bow to starboard. Bars: two standard "
            "errors. The panels are in order of the share of the mean square that the average explains beyond chance.",
        ))  # fmt: skip
    return every


def write_report(d: Findings, folder: Path, gap: Gap | None = None) -> FigureFolder:
    """Make the figures and ``report.html`` of ``d`` in ``folder``; gap: comparison of which it is a part. Returns what
    was made and what could not be made."""
    written = FigureFolder(folder / FIGURES)
    if gap is not None:
        title = "White, learned and named models on the test trials"
        written.write("gap", partial(gap_figure, gap), title, "Bars: root mean square errors with 90 % intervals.")
    for name, draw, title, caption in figures_for(d):
        written.write(name, partial(draw, d), title, caption)
    for row in written.rows:
        row["file"] = f"{FIGURES}/{row['file']}"
    with written.making("the report"):
        write_page(build_report(d, folder, written.rows, gap), folder / PAGE)
    return written


def build_report(d: Findings, folder: Path, listed: Sequence[Mapping[str, str]], gap: Gap | None = None) -> str:
    """The page on ``d``; listed: rows of the figures that lie in ``folder``; gap: as of ``write_report``."""
    names = [*(e.name for e in d.effects), *(f.name for f in d.instruments)]
    rows, order = words.ranking(d), [words.plain(name) for name in names]
    return rendered(
        "diagnosis",
        "diagnosis.report",
        d=d,
        gap=gap,
        words=words,
        figures={f["name"]: f for f in figures_of(folder, listed)},
        budget=words.budget_parts(d.budget) if d.budget else [],
        budget_lines=words.budget_lines(d.budget) if d.budget else [],
        figures_moved=figures_moved(d),
        warnings=[*map(words.sentence, d.warnings)],
        between=table_rows(d.between) if d.between else [],
        between_warnings=[*map(words.sentence, d.between.warnings)] if d.between else [],
        held=held_rows(d),
        rows=sorted(rows, key=lambda row: order.index(row["name"]) if row["name"] in order else len(order)),
    )


# Manoeuvre, figure, its words and unit.
FIGURES_MOVED = (
    ("turning:35", "tactical_diameter", "tactical diameter", "L"),
    ("turning:35", "advance", "advance", "L"),
    ("zigzag:20/20", "overshoot_1", "first overshoot of the 20°/20° zigzag", "°"),
)


def figures_moved(d: Findings) -> list[str]:
    """What was found does to the figures of the ship of ``d``, a line each; nothing where that is not known."""
    if d.before is None or d.before is d.ship:
        return []
    lines = []
    try:
        ships = [calm_and_deep(ship)[0] for ship in (d.before, d.ship)]
        runs = {
            text: [simulated_run(ship, text, approach_speed(ship, None)[0]).figures for ship in ships]
            for text in dict.fromkeys(row[0] for row in FIGURES_MOVED)
        }
    except UserError:
        return []
    for text, name, meaning, unit in FIGURES_MOVED:
        scale = 1 / float(d.ship.particulars["L"]) if unit == "L" else 180 / math.pi
        before, after = (scale * figures.get(name, math.nan) for figures in runs[text])
        if math.isfinite(before) and math.isfinite(after):
            space = "" if unit == "°" else " "
            lines.append(f"{meaning} {before:.3g} → {after:.3g}{space}{unit}")
    return lines


def held_rows(d: Findings) -> list[dict[str, Any]]:
    """Errors of the test trials of ``d`` before and after, the total last."""
    if d.held_out is None:
        return []
    every = [*d.held_out.by_run.items(), ("all windows", (d.held_out.mse_before, d.held_out.mse_after))]
    rows = []
    for name, (before, after) in every:
        share = after / before - 1 if before > 0 else math.nan
        change = f"{words.signed(100 * share, f'.{words.places(share)}f')} %" if before > 0 else "–"
        rows.append({"name": name, "before": before, "after": after, "worse": after > before, "change": change})
    return rows

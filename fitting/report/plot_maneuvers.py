"""Figures of standard manoeuvres: turning circles with their dimensions, zigzags with their overshoots, stops.

One function per kind of panel, each draws runs (cases/criteria/standard_runs.py) of one ship on axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.criteria.figures import Since, since, spiral_branches
from cases.criteria.standard_runs import Run
from fitting.report.plot_style import AFTER, ALARM, BEFORE, DASHES, GREY, MEASURED, dress, literal, new_figure, own_axes
from mmg.errors import UnknownName, unknown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Of the lines, with DASHES in the same order, so that they can be told apart in grey.
COLOURS = (AFTER, BEFORE, "#009E73", ALARM, "#7A5AA6", MEASURED)


def maneuver_figure(runs: Sequence[Run], title: str, clouds: Mapping[str, Sequence[Since]] | None = None) -> Figure:
    """All ``runs`` on one sheet under a ``title``: turning circles and stops in L side by side, a panel per zigzag,
    spiral and pull-out. clouds: other runs of a manoeuvre by its name, drawn thin behind.

    Raises ValueError for no runs.
    """
    if not runs:
        raise ValueError("no runs to draw")
    top = [some for kind in JOINT if (some := [run for run in runs if run.kind == kind])]
    others = [[run] for run in runs if run.kind in PANELS and run.kind not in JOINT]
    heights = [4.9] * bool(top) + [2.9] * math.ceil(len(others) / 2)  # inch: a row of square axes, rows of two
    figure = new_figure(sum(heights) + 0.4)
    figure.suptitle(literal(title), fontsize=10.5, x=0.01, ha="left", fontweight="bold")
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    for first, panels in ((0, top), (int(bool(top)), others)):
        for k, some in enumerate(panels):
            alone = len(panels) % 2 == 1 and k == len(panels) - 1
            ax = figure.add_subplot(grid[first + k // 2, :] if alone else grid[first + k // 2, k % 2])
            _draw(ax, some, clouds or {})
    return figure


JOINT = ("turning", "crash-stop")  # Kinds of which several runs share axes


def draw_maneuvers(
    runs: Sequence[Run], kind: str, clouds: Mapping[str, Sequence[Since]], ax: Axes | None = None
) -> Axes:
    """Draw those of ``runs`` whose kind or name is ``kind`` on ``ax`` (None: new axes), which it returns. clouds: as of
    ``maneuver_figure``. Raises UserError where there is none of them."""
    chosen = [run for run in runs if kind in (run.kind, run.name)]
    if not chosen:
        raise UnknownName(unknown("manoeuvre", kind, dict.fromkeys([*(r.kind for r in runs), *(r.name for r in runs)])))
    ax = own_axes(ax)
    _draw(ax, chosen if chosen[0].kind in JOINT else chosen[:1], clouds)
    return ax


def _draw(ax: Axes, runs: Sequence[Run], clouds: Mapping[str, Sequence[Since]]) -> None:
    """Draw ``runs`` of one kind, and the clouds of each."""
    PANELS[runs[0].kind](ax, runs)
    for run in runs:
        _cloud(ax, run, clouds.get(run.name, ()))


def _cloud(ax: Axes, run: Run, others: Sequence[Since]) -> None:
    """Other runs of the same manoeuvre, thin and behind all else."""
    L = run.length
    shown = {
        "turning": lambda m: (m.transfer / L, m.advance / L),
        "crash-stop": lambda m: (m.path / L, m.u / run.speed),
        "zigzag": lambda m: (m.t, np.degrees(m.change)),
    }
    if not others or run.kind not in shown:
        return
    parts = [part for motion in others for part in (shown[run.kind](motion), ([np.nan], [np.nan]))]
    ax.plot(*np.hstack(parts), color=GREY, linewidth=0.4, alpha=0.45, zorder=0.5)
    if run.kind == "crash-stop":  # its limits were set to the nominal stop, and draws may go farther
        ax.autoscale(axis="x")
        ax.set_xlim(left=0)


def _cut(run: Run) -> Since:
    """The run from the order to its end."""
    motion = since(run.trial, run.order_time)
    rows = motion.t <= run.end - run.order_time + 1e-9  # rounding of times
    return Since(**{name: values[rows] for name, values in vars(motion).items()})


def _turning(ax: Axes, runs: Sequence[Run]) -> None:
    """Tracks from the order on in ship lengths, the ship heading up at the origin. Dashed: the course before it."""
    dress(ax, "to starboard / L", "ahead / L", "Turning circles")
    for run, colour, dashes in zip(runs, cycle(COLOURS), cycle(DASHES), strict=False):
        motion, L = _cut(run), run.length
        label = literal(run.name) if not run.measured else f"{literal(run.name)} ({math.degrees(run.rudder):+.0f} deg)"
        ax.plot(motion.transfer / L, motion.advance / L, color=colour, linestyle=dashes, linewidth=1.3, label=label)
    ax.plot([0, 0], [-2, 0], color=GREY, linewidth=1.0, linestyle=(0, (4, 2)))
    ax.plot(0, 0, marker="^", color=MEASURED, markersize=6)
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend(fontsize=7.5, loc="lower right", frameon=True, framealpha=0.9, edgecolor="none")


def _stopping(ax: Axes, runs: Sequence[Run]) -> None:
    """Speed over that of the approach against the track in ship lengths, with the reach."""
    dress(ax, "track / L", "u / V", "Stop: headway along the track")
    for run, colour, dashes in zip(runs, cycle(COLOURS), cycle(DASHES), strict=False):
        motion = _cut(run)
        along, speed = motion.path / run.length, motion.u / run.speed
        ax.plot(along, speed, color=colour, linestyle=dashes, linewidth=1.3, label=literal(run.name))
        reach = run.figures.get("track_reach")
        if reach is not None:
            ax.plot(reach / run.length, 0, marker="o", color=colour, markersize=4)
            words = f"track reach {reach / run.length:.2f} L"
            _note(ax, words, (reach / run.length, 0), (-6, 8), colour, ha="right")
    ax.axhline(0, color=GREY, linewidth=0.8)
    ax.set_xlim(left=0)
    if len(runs) > 1:
        ax.legend(fontsize=7.5, frameon=False)


def _zigzag(ax: Axes, runs: Sequence[Run]) -> None:
    """Heading change and rudder against time since the first order [s], headings of the switches dotted, overshoots
    marked."""
    run = runs[0]
    name = run.name
    if run.measured:
        rudder, heading = run.steps
        name += "" if run.title in name else f" ({rudder:g}/{heading:g})"
    dress(ax, "time since the order / s", "heading change (blue), rudder (grey) / deg", name)
    motion = _cut(run)
    degrees = np.degrees(motion.change)
    ax.plot(motion.t, np.degrees(motion.delta), color=GREY, linewidth=1.0)
    ax.plot(motion.t, degrees, color=AFTER, linewidth=1.4)
    switch = math.degrees(run.heading)
    for level in (switch, -switch):
        ax.axhline(level, color=GREY, linewidth=0.6, linestyle=":")
    for k, (row, value) in enumerate(_overshoots(run, motion)):
        sign, top = math.copysign(1.0, degrees[row]), degrees[row]
        ax.plot([motion.t[row]] * 2, [top - sign * value, top], color=ALARM, linewidth=1.6)
        words, below = f"{value:.1f}°" if k else f"overshoot {value:.1f}°", "bottom" if sign > 0 else "top"
        _note(ax, words, (motion.t[row], top), (0, 5 * sign), ALARM, ha="center", va=below)
    ax.margins(y=0.16)


def _overshoots(run: Run, motion: Since) -> list[tuple[int, float]]:
    """(row of the extreme, overshoot [deg]) of each overshoot among the figures."""
    side, row, extremes = math.copysign(1.0, run.rudder), 0, []
    count = sum(name.startswith("overshoot_") for name in run.figures)
    for k in range(1, count + 1):  # each lies between a swing to one side and the way back through the course
        beyond = np.flatnonzero(side * motion.change[row:] >= 0.5 * run.heading)
        if len(beyond) == 0:
            break
        row += int(beyond[0])
        back = np.flatnonzero(side * motion.change[row:] < 0)
        end = row + int(back[0]) if len(back) else len(motion.t)
        top = row + int(np.argmax(side * motion.change[row:end]))
        extremes.append((top, math.degrees(run.figures[f"overshoot_{k}"])))
        row, side = end, -side
    return extremes


def _spiral(ax: Axes, runs: Sequence[Run]) -> None:
    """Steady turn rate r L / V against rudder angle, both ways."""
    run = runs[0]
    dress(ax, "rudder / deg", "r L / V", run.name)
    ways = (("there", "o-", AFTER, 4.0), ("back", "s-", BEFORE, 2.5))
    branches = spiral_branches(since(run.trial, run.order_time))
    for (rudder, rate), (label, style, color, ms) in zip(branches, ways, strict=False):
        ax.plot(np.degrees(rudder), rate * run.length / run.speed, style, color=color, ms=ms, lw=1.2, label=label)
    if branches:
        ax.legend(fontsize=7.5, frameon=False)
    ax.axhline(0, color=GREY, linewidth=0.6)
    ax.axvline(0, color=GREY, linewidth=0.6)


def _pull_out(ax: Axes, runs: Sequence[Run]) -> None:
    """Turn rate r L / V against time since the order [s], and its residual."""
    run = runs[0]
    dress(ax, "time since the order / s", "r L / V", run.name)
    motion, unit = _cut(run), run.length / run.speed
    ax.plot(motion.t, motion.r * unit, color=AFTER, linewidth=1.3)
    residual = run.figures.get("residual_rate")
    if residual is not None:
        ax.axhline(residual * unit, color=ALARM, linewidth=0.8, linestyle=(0, (4, 2)))
        at = (motion.t[-1], residual * unit)
        _note(ax, f"residual {residual * unit:+.3f}", at, (0, 4), ALARM, ha="right", va="bottom")
    ax.axhline(0, color=GREY, linewidth=0.6)


# What draws the runs of a kind.
PANELS = {"turning": _turning, "crash-stop": _stopping, "zigzag": _zigzag, "spiral": _spiral, "pull-out": _pull_out}


def _note(
    ax: Axes, words: str, at: tuple[float, float], offset: tuple[float, float], colour: str, **align: Any
) -> None:
    """``words`` beside the point ``at``, ``offset`` from it in points."""
    ax.annotate(words, at, xytext=offset, textcoords="offset points", fontsize=7.5, color=colour, **align)

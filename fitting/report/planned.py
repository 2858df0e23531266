"""A planned trial in lines for a person, and as a map."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.design.plan import corners
from fitting.report.plot_style import AFTER, BEFORE, GREY, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fitting.design.planned_trial import PlannedTrial


def in_words(content: Mapping[str, Any], file: str) -> list[str]:
    """Lines for a person on a planned trial. content: its ``to_dict``; file: name of that for the autopilot."""
    start, area, gain = content["start"], content["area_m"], content["mean_log_variance"]
    lines = [
        f"{content['title']}: {content['time_s']:g} s in {area['length']:g} x {area['width']:g} m. Start at x "
        f"{start['x_m']:.2f} m, y {start['y_m']:.2f} m, heading {start['heading_deg']:.0f} deg, with "
        f"{start['speed_m_s']:.3g} m/s and {start['n_rps']:.3g} 1/s. File for the autopilot: {file}.",
        "    t [s]   n [1/s]   rudder [deg]",
    ]
    lines += [f"  {o['t_s']:7.1f} {o['n_rps']:9.2f} {o['delta_deg']:14.0f}" for o in content["orders"]]
    lines.append("standard deviation before -> after")
    for name, row in sorted(content["wanted"].items(), key=lambda item: item[1]["left"]):
        unit, factor = ("deg", math.degrees(1.0)) if row["unit"] == "rad" else (row["unit"], 1.0)
        before, after = (f"{factor * row[key]:.3g}" for key in ("std_before", "std_after"))
        words = name + (f" [{unit}]" if unit and unit != "-" else "")
        lines.append(f"  {words:22s} {before:>10s} -> {after:>10s}  ({row['left']:.0%})")
    lines += ["mean log variance", f"  {gain:+.2f} by the designed trial"]
    lines += [
        f"  {row['mean_log_variance']:+.2f} by {row['name']}" + "  (leaves the area)" * (not row["stays_inside"])
        for row in content["library"][:5]
    ]
    pairs = content["best_two_of_the_library"]
    for key, where in (("inside", "that stay inside"), ("library", "wherever there is room")):
        if key in pairs and not (key == "library" and pairs.get("inside") == pairs[key]):
            names = " and ".join(pairs[key]["names"])
            lines.append(f"  {pairs[key]['mean_log_variance']:+.2f} by the best two, {where}: {names}")
    return [*lines, *(f"assumed: {line}" for line in content["assumed"])]


def plan_map(planned: PlannedTrial) -> Figure:
    """A figure of the ``planned`` trial: map with the hull at equal times, and the orders over time below."""
    from matplotlib.patches import Ellipse, Polygon, Rectangle  # late: slow to import

    f, area, ship, m = planned.found, planned.task.area, planned.ship, planned.task.area.margin
    figure = new_figure(8.0)
    title = f"Planned trial of {planned.task.wish.seconds:g} s: {ship.title}"[:110]  # the letters of a line
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    ax, *others = figure.subplots(3, 1, height_ratios=(3.6, 1, 1))
    dress(ax, "y, east [m]", "x, north [m]", "Track, hull, 2 standard deviations")
    ax.add_patch(Rectangle((0, 0), area.width, area.length, fill=False, ec="black", lw=1.5))
    ax.add_patch(Rectangle((m, m), area.width - 2 * m, area.length - 2 * m, fill=False, ec=GREY, lw=0.8, ls="--"))
    x, y = f.states[:, 0], f.states[:, 1]
    for k in range(0, len(x), max(1, len(x) // 12)):
        # (east, north) of the four corners round the hull
        outline = np.array(corners(f.states[k : k + 1, :3, None], ship))[::-1, (0, 1, 3, 2), 0, 0].T
        ax.add_patch(Polygon(outline, closed=True, fill=k == 0, fc=BEFORE, ec=BEFORE, lw=0.8, alpha=0.8))
        size = 4 * np.minimum(f.std[k, 1::-1], 1e3)  # diameters of two standard deviations, east and north
        ax.add_patch(Ellipse((y[k], x[k]), *size, fc=AFTER, ec="none", alpha=0.15))
    ax.plot(y, x, color=AFTER, lw=1.6)
    ax.set_aspect("equal")
    orders = {"rudder [deg]": np.degrees(f.orders[:, 1]), "revolutions [1/s]": f.orders[:, 0]}
    for ax, (words, values) in zip(others, orders.items(), strict=True):
        dress(ax, "t [s]" if ax is others[-1] else "", words)
        ax.step(planned.dt * np.arange(len(x)), values, where="post", color=AFTER, lw=1.4)
        ax.axhline(0, color=GREY, lw=0.6)
    return figure

"""The map of a planned trial, and the plan kept in the folder of its run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from cases.io.files import replaced
from fitting.design.area import corners
from fitting.report.plan_section import FOLDER, MAP, PLAN
from fitting.report.planned_trial import PlannedTrial
from fitting.report.plot_style import AFTER, BEFORE, DPI, GREY, dress, new_figure
from fitting.report.run_folder import write_json


def keep_plan(planned: PlannedTrial, folder: Path, out: Path) -> None:
    """Keep a ``planned`` trial in the ``folder`` of its run, in the place of an earlier one, for the report.

    out: the file for the autopilot, of which the report says the name. Raises OSError where it cannot be written.
    """
    own = folder / FOLDER
    own.mkdir(exist_ok=True)
    with replaced(own / MAP) as scratch:
        plan_map(planned).savefig(scratch, format="png", dpi=DPI)
    write_json(own / PLAN, planned.to_dict() | {"file": out.name})


def plan_map(planned: PlannedTrial) -> Figure:
    """A figure of the ``planned`` trial: map with the hull at equal times, and the orders over time below."""
    f, area, ship = planned.found, planned.task.area, planned.ship
    figure = new_figure(8.0)
    figure.suptitle(f"Planned trial of {planned.task.seconds:g} s: {ship.title}"[:110], fontsize=10, x=0.01, ha="left")
    grid = figure.add_gridspec(3, 1, height_ratios=(3.6, 1, 1))
    ax = dress(figure.add_subplot(grid[0]), "x, north [m]", "y, east [m]", "Track, hull, 2 standard deviations")
    ax.add_patch(Rectangle((0, 0), area.length, area.width, fill=False, ec="black", lw=1.5))
    m = area.margin
    ax.add_patch(Rectangle((m, m), area.length - 2 * m, area.width - 2 * m, fill=False, ec=GREY, lw=0.8, ls="--"))
    x, y = f.states[:, 0], f.states[:, 1]
    every = max(1, len(x) // 12)
    for k in range(0, len(x), every):
        cx, cy = corners(f.states[k : k + 1, :3, None], ship)
        outline = [(cx[i, 0, 0], cy[i, 0, 0]) for i in (0, 1, 3, 2)]
        ax.add_patch(Polygon(outline, closed=True, fill=k == 0, fc=BEFORE, ec=BEFORE, lw=0.8, alpha=0.8))
        ax.add_patch(_ellipse(x[k], y[k], f.std[k]))
    ax.plot(x, y, color=AFTER, lw=1.6)
    ax.set_aspect("equal")
    ax.invert_yaxis()  # north to the right, east down: starboard is to the right of the track
    t = planned.dt * np.arange(len(x))
    for row, (values, words) in enumerate(
        ((np.degrees(f.orders[:, 1]), "rudder [deg]"), (f.orders[:, 0], "revolutions [1/s]")), 1
    ):
        ax = dress(figure.add_subplot(grid[row]), "t [s]" if row == 2 else "", words)
        ax.step(t, values, where="post", color=AFTER, lw=1.4)
        ax.axhline(0, color=GREY, lw=0.6)
    return figure


def _ellipse(x: float, y: float, std: np.ndarray) -> Any:
    """Two standard deviations about a place x, y [m]; std: (6,)."""
    from matplotlib.patches import Ellipse

    return Ellipse((x, y), 4 * min(std[0], 1e3), 4 * min(std[1], 1e3), fc=AFTER, ec="none", alpha=0.15)

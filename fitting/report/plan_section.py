"""A planned trial in words and as a map, and the section of a report on that which the folder of a run keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.io.files import read_json, replaced
from fitting.report.plot_style import AFTER, BEFORE, GREY, dress, figure_entry, new_figure
from fitting.report.run_folder import write_json
from mmg.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fitting.design.planned_trial import PlannedTrial

# Folder in that of a run which holds its last planned trial, and the files in it.
FOLDER, PLAN, MAP = "planned_trial", "plan.json", "map.png"


def plan_section(folder: Path) -> dict[str, Any] | None:
    """The planned trial that the ``folder`` of a run keeps, as the template shows it: what ``_words`` gives and image,
    the map as the macro ``figure`` takes it. None where there is none or it cannot be read."""
    drawn = folder / FOLDER / MAP
    caption = (
        "Hull at equal times, the first one filled; shaded: two standard deviations of its place by draws of the "
        "coefficients; dashed: the margin."
    )
    try:
        words = _words(read_json(folder / FOLDER / PLAN))
        content = drawn.read_bytes() if drawn.is_file() else b""
    except (UserError, OSError, LookupError, TypeError, ValueError, AttributeError):
        return None
    image = figure_entry(content, "planned_trial", "Map and orders of the designed trial", caption, MAP)
    return words | {"image": image if content else None}


def _words(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a plan's ``content`` says. lead: sentences; wanted: name, standard deviation before, after, and what is left
    of it; library: the trial and the best ones of the library: name, gain, what is left, stays inside; orders: t [s],
    n [1/s], rudder [deg]; assumed: sentences."""
    start, area = content["start"], content["area_m"]
    wanted = sorted(content["wanted"].items(), key=lambda item: item[1]["left"])
    rows = [("the designed trial", content["mean_log_variance"], True)]
    rows += [(row["name"], row["mean_log_variance"], row["stays_inside"]) for row in content["library"][:5]]
    return {
        "lead": (
            f"{content['time_s']:g} s in {area['length']:g} x {area['width']:g} m, by mmg plan. Start at x "
            f"{start['x_m']:.2f} m, y {start['y_m']:.2f} m, heading {start['heading_deg']:.0f} deg, with "
            f"{start['speed_m_s']:.3g} m/s and {start['n_rps']:.3g} 1/s. File for the autopilot: {content['file']}.",
            _comparison(content),
        ),
        "wanted": [_wanted(name, row) for name, row in wanted],
        "library": [(name, f"{gain:+.2f}", _left(gain), "yes" if fits else "no") for name, gain, fits in rows],
        "orders": [(f"{o['t_s']:.1f}", f"{o['n_rps']:.2f}", f"{o['delta_deg']:.0f}") for o in content["orders"]],
        "assumed": (*map(str, content["assumed"]), *map(str, content["notes"])),
    }


def _comparison(content: Mapping[str, Any]) -> str:
    """The gain of a plan's ``content`` beside that of the best two of the library, in a sentence."""
    gain, pairs = content["mean_log_variance"], content["best_two_of_the_library"]
    words = f"It is expected to leave {_left(gain)} of the standard deviations, by their mean logarithm"
    places = {"inside": "that stay inside", "library": "wherever there is room"}
    parts = [
        f"{_left(pairs[key]['mean_log_variance'])} ({' and '.join(pairs[key]['names'])}, {where})"
        for key, where in places.items()
        if key in pairs
    ]
    parts = parts[:1] if pairs.get("inside") == pairs.get("library") else parts
    return f"{words}; the best two manoeuvres of the library together, each as long: {', '.join(parts) or 'none'}."


def _left(gain: float) -> str:
    """What is left of a standard deviation after a ``gain`` in log variance."""
    return f"{math.exp(gain / 2):.0%}"  # log variance = 2 log standard deviation


def _wanted(name: str, row: Mapping[str, Any]) -> tuple[str, str, str, str]:
    """The cells of what is to be known better; angles in degrees."""
    unit, factor = row.get("unit") or "", 1.0
    if unit == "rad":
        unit, factor = "deg", math.degrees(1.0)
    before, after = (f"{factor * row[key]:.3g}" for key in ("std_before", "std_after"))
    return name + (f" [{unit}]" if unit and unit != "-" else ""), before, after, f"{row['left']:.0%}"


def in_words(content: Mapping[str, Any], file: str) -> list[str]:
    """Lines for a person on a planned trial. content: its ``to_dict``; file: name of that for the autopilot."""
    words = _words({**content, "file": file})
    lines = [f"{content['title']}: {words['lead'][0]}", "    t [s]   n [1/s]   rudder [deg]"]
    lines += [f"  {t:>7s} {n:>9s} {delta:>14s}" for t, n, delta in words["orders"]]
    lines.append("standard deviation before -> after")
    lines += [
        f"  {name:22s} {before:>10s} -> {after:>10s}  ({remaining})"
        for name, before, after, remaining in words["wanted"]
    ]
    lines.append("mean log variance")
    for name, gain, _, inside in words["library"]:
        lines.append(f"  {gain} by {name}" + ("" if inside == "yes" else "  (leaves the area)"))
    return [*lines, words["lead"][1], *(f"assumed: {line}" for line in content["assumed"])]


def keep_plan(planned: PlannedTrial, folder: Path, out: Path) -> None:
    """Keep a ``planned`` trial in the ``folder`` of its run, in the place of an earlier one, for the report.

    out: the file for the autopilot, of which the report says the name, with the map beside it. Raises OSError where it
    cannot be written.
    """
    target = folder / FOLDER
    target.mkdir(exist_ok=True)
    with replaced(target / MAP) as scratch:
        scratch.write_bytes(out.with_suffix(".png").read_bytes())
    write_json(target / PLAN, planned.to_dict() | {"file": out.name})


def plan_map(planned: PlannedTrial) -> Figure:
    """A figure of the ``planned`` trial: map with the hull at equal times, and the orders over time below."""
    from matplotlib.patches import Ellipse, Polygon, Rectangle  # late: slow to import

    from fitting.design.plan import corners

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

"""The figure of a scaled ship: turning circles and a zigzag of model and ship in ship lengths, with draws."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.criteria.scatter import draw_coefficients
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.simulation.simulate_batch import simulate_batch
from fitting.record import FigureRow, MessageRow
from fitting.report.plot_style import AFTER, BEFORE, GREY, FigureFolder, dress, new_figure
from fitting.report.run_folder import FIGURES
from fitting.result import FitResult
from mmg.motion.froude import reference_speed, time_scale
from mmg.ship import Ship

DRAWS, STEP = 60, 0.5
"""Draws of the ship that are shown; step of their motions in seconds of a 3 m model."""
CIRCLES, ZIGZAG = ("turning:35", "turning:-35"), "zigzag:20/20"
CAPTION = (
    "Model and ship at the same Froude number {froude:.3f}, in ship lengths; thin: {draws} draws of the ship from her "
    "covariance. Left: 35 degrees of rudder; right: zigzag 20/20."
)


def write_scaled(result: FitResult, folder: Path) -> FitResult:
    """Write the run folder ``folder`` of a scaled ``result`` with its figure; returns the result as it was saved.

    A figure that cannot be made is a warning. Raises UserError when the folder exists or cannot be written.
    """
    with tempfile.TemporaryDirectory() as scratch:
        written = FigureFolder(Path(scratch) / FIGURES)
        speed = (result.scaling or {})["self_propulsion"]["model"]
        caption = CAPTION.format(froude=speed["froude"], draws=DRAWS)
        if {"propeller", "rudder"} <= set(result.ship.components):
            written.write("scaling", partial(scaled_figure, result), "From model to ship", caption)
        failed = tuple(MessageRow("warning", m.code, m) for m in written.failures)
        rows = tuple(FigureRow(**row) for row in written.rows)
        complete = replace(result, figures=rows, messages=(*failed, *result.messages), folder=Path(scratch))
        return complete.save(folder)


def scaled_figure(result: FitResult) -> Figure:
    """Turning circles and a zigzag of a scaled ``result`` and of its model, in ship lengths."""
    assert result.model is not None and result.scaling is not None
    speed = float(result.scaling["self_propulsion"]["model"]["speed_m_s"])
    ships = {"model": calm_and_deep(result.model.ship)[0], "ship": calm_and_deep(result.ship)[0]}
    correlation = (result.correlation.symbols, np.array(result.correlation.matrix, dtype=float))
    drawn = draw_coefficients(ships["ship"], DRAWS, 0, correlation) if correlation[1].size else {}
    figure = new_figure(3.6)
    circles, zigzags = figure.subplots(1, 2, width_ratios=(1.6, 1))
    dress(circles, "to starboard / L", "ahead / L", "Turning, 35 degrees")
    dress(zigzags, "t √(g / L)", "heading [deg]", "Zigzag 20/20")
    circles.set_aspect("equal", adjustable="box")
    looks: dict[str, dict] = {"model": {"color": BEFORE, "linestyle": (0, (4, 1.5))}, "ship": {"color": AFTER}}
    for name, ship in ships.items():
        froude = speed / reference_speed(ships["model"].particulars["L"])
        approach = froude * reference_speed(ship.particulars["L"])
        draws = drawn if name == "ship" else {}
        for text in (*CIRCLES, ZIGZAG):
            _draw(circles if text in CIRCLES else zigzags, ship, text, approach, draws, looks[name], name)
    for ax in (circles, zigzags):
        ax.legend(fontsize=7.5, loc="best", frameon=True, framealpha=0.9, edgecolor="none")
    return figure


def _draw(ax: Axes, ship: Ship, text: str, speed: float, drawn: dict[str, np.ndarray], look: dict, name: str) -> None:
    """One manoeuvre of a ship, and of draws of it."""
    L = ship.particulars["L"]
    plan = parse_maneuver(text, ship, speed=speed)
    values = {s: np.concatenate([[ship.coefficients[s].value], rows]) for s, rows in drawn.items()}
    first = next(iter(ship.symbols))
    given = values or {first: np.array([ship.coefficients[first].value])}
    runs = simulate_batch(ship, plan, given, STEP * time_scale(L))
    time = np.arange(runs.states.shape[0]) * STEP * time_scale(L) * math.sqrt(9.80665 / L)
    for k in reversed(range(runs.states.shape[2])):
        rows = slice(0, int(runs.last[k]) + 1)
        x, y, psi = (runs.states[rows, i, k] for i in range(3))
        across, along = (time[rows], np.degrees(psi)) if text == ZIGZAG else (y / L, x / L)
        if k:
            ax.plot(across, along, color=GREY, linewidth=0.4, alpha=0.35)
        else:
            label = name if text != CIRCLES[1] else None
            ax.plot(across, along, linewidth=1.5, label=label, **look)

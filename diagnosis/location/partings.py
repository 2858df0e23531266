"""Ways to part the grid times of the trials: by run, phase, heading, and ranges of motion, inputs and their rates."""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.location.situations import phases
from mmg.motion.flow import INPUTS

PARTS = 3
"""Parts, of about equal time, by the size of a variable."""
RUN = "run"
OUTSIDE = (RUN, "heading", "time since the start")
"""Partings that are none of what the ship does: weather differs by them."""


def partings(steps: TransitionModel, data: GriddedTrials, found: Point) -> dict[str, np.ndarray]:
    """Ways to part the grid times of ``data``: (K + 1, R) number of the part of each, -1: none.

    steps: the transition model; found: the fit whose path is taken.
    """
    z, names = found.path.z, list(steps.model.controls)
    inside = data.inside
    inputs = np.concatenate([data.inputs, data.inputs[-1:]])
    runs = np.broadcast_to(data.run, data.good.shape[:2])
    phase = np.full(data.good.shape[:2], -1)
    phase[:-1][inside] = phases(names, data, z, float(steps.ship.particulars["L"]))
    variables = {"u": z[..., 3], "|v|": np.abs(z[..., 4]), "|r|": np.abs(z[..., 5]), "r": z[..., 5], "v": z[..., 4]}
    for name in (n for n in names if n in INPUTS):
        x = inputs[..., names.index(name)]
        variables |= {name: x, f"|{name}|": np.abs(x)}
        if data.changes is not None:
            change = np.concatenate([data.changes, data.changes[-1:]])[..., names.index(name)]
            variables[f"rate of {name}"] = np.abs(change)
    variables["time since the start"] = data.t
    quadrant = np.floor(z[..., 2] / (np.pi / 2)).astype(int) % 4
    found_parts = {RUN: runs, "phase": phase, "heading": quadrant}
    for name, x in variables.items():
        edges = np.unique(np.quantile(x[:-1][inside], np.linspace(0, 1, PARTS + 1)[1:-1]))
        found_parts[name] = np.digitize(x, edges)
    return found_parts

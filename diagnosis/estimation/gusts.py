"""Gusts that the anemometer does not show, as a random force.

Air turns and swells between the anemometer and the ship, and faster than it follows. What that does to the ship is no
latent force of constant size: it grows with the wind and turns with her heading. So along and across the logged wind a
process of first order with a size that is a share of its speed adds to it, and pushes as the ship's own wind force
says, at the coefficients and the logged motion that she was given with. Turbulence of the natural wind is 10 to 20 % of
its mean along it and less across (WMO No. 8, 2018, volume I, chapter 5; Kaimal & Finnigan 1994, section 1.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.linearisation import initial_trajectory
from diagnosis.estimation.transition_model import TransitionModel
from mmg.ship import AIR

# Gust at which the slope of the wind force is taken, on either side, as a share of the wind's speed. Set by hand.
SHARE = 0.1


def trials_in_gusts(steps: TransitionModel, trials: Sequence[Trial], straight: bool = False) -> GriddedTrials:
    """The ``trials`` on the grid of ``steps``, with gusts. straight: as of ``grid_trials``, whose errors it raises."""
    return with_gusts(steps, grid_trials(trials, steps.ship, steps.h, straight))


def with_gusts(steps: TransitionModel, data: GriddedTrials) -> GriddedTrials:
    """The trials ``data`` with what a gust pushes the ship of ``steps`` by; the same where no wind pushes her."""
    controls = list(steps.model.controls)
    if not set(AIR) <= set(controls):
        return data
    at, (K, R) = [controls.index(name) for name in AIR], data.inputs.shape[:2]
    theta = steps.ship.values
    z = initial_trajectory(steps, data, theta).z[:-1].reshape(K * R, -1).T
    inputs = data.inputs.reshape(K * R, -1).T
    north, east = np.nan_to_num(inputs[at])
    _, J = steps.rates(z, inputs, theta)
    pushes = []
    for turned in ((north, east), (-east, north)):  # along the wind, and across: turned by 90 degrees
        ends = []
        for way in (SHARE, -SHARE):
            air = inputs.copy()
            air[at] += way * np.array(turned)
            ends.append(steps.rates(z, air, theta)[0][:, 3:6])
        # the force that gives the same accelerations
        pushes.append(np.linalg.solve(J[:, 3:6, steps.S :], ((ends[0] - ends[1]) / (2 * SHARE))[..., None])[..., 0])
    gusts = np.stack(pushes, axis=2).reshape(K, R, 3, 2)
    gusts[~data.inside] = 0.0
    if not np.isfinite(gusts).all() or not gusts.any():
        return data
    return replace(data, gusts=gusts)

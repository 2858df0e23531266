"""What a small error of the logged times of the inputs does: no two clocks are the same."""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point
from diagnosis.estimation.transition_model import TransitionModel
from mmg.motion.flow import INPUTS

TIMING = 0.1
"""Standard deviation of the time of an input, in intervals of its samples."""
DIFFERENCE = {"rad": 1e-3, "rps": 1e-2}
"""Change of an input of each unit by which its action is differentiated."""


def timing_columns(steps: TransitionModel, data: GriddedTrials, at: Point, active: np.ndarray) -> np.ndarray:
    """What each actuator adds over a step to the ``active`` states (A,) if it acts TIMING of a sample late.

    steps: the transition model; data: the trials, with the changes of the inputs and their sampling time; at: the
    point. Returns (K, R, A, c) for c actuators.
    """
    data = acting(steps, data, at.theta)
    K, R = data.inputs.shape[:2]
    names = [name for name in steps.model.controls if name in INPUTS]
    if data.changes is None or not data.sample:
        return np.zeros((K, R, len(active), 0))
    begin = at.path.z[:-1].reshape(K * R, -1).T
    held = data.inputs.reshape(K * R, -1).T
    theta = steps.coefficients(at.theta, at.path.push[:-1].reshape(-1, 3).T)
    columns = []
    for name in names:
        i, small = steps.model.controls.index(name), DIFFERENCE[INPUTS[name][1]]
        ends = []
        for sign in (1, -1):
            moved = held.copy()
            moved[i] += sign * small
            ends.append(steps.advance(begin, moved, theta))
        action = ((ends[0] - ends[1]) / (2 * small))[active].T.reshape(K, R, -1)
        columns.append(action * (data.changes[..., i] * (-TIMING * data.sample / data.h))[..., None])
    return np.stack(columns, axis=-1)

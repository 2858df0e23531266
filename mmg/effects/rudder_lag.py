"""Rudder lag: the real rudder follows the logged one with a first-order lag of time constant T."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mmg.effects.effect import Effect, Parameter
from mmg.motion.flow import RUDDERS, Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory, lagged
from mmg.motion.smooth import Smoothing


class RudderLag(Effect):
    """Late rudder."""

    name, enters, needs = "rudder_lag", "actuator path", ("rudder",)
    form_error = 0.05
    moves = RUDDERS

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        return (Parameter("T", 0.0, 0.6 * k, 0.0, 10.0 * k, "s", "time constant of the rudder behind its record"),)

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        k = time_scale(p.L)
        return flow.actuated(RUDDERS, lambda name, x: lagged(memory, f"rudder_lag.{name}", x, e.T, 0.5 * k, 0.3))

    def acted(self, record: np.ndarray, step: float, time: float) -> np.ndarray:
        from scipy.linalg import solve_banded  # slow to import, and only a diagnosis needs it

        # position at the end of each part, e_k = decay e_(k-1) + (1 - decay) record_k: a bidiagonal system
        decay = np.exp(-step / time)
        bands = np.ones((2, len(record)))
        bands[1] = -decay
        driven = (1 - decay) * record
        driven[0] = record[0]  # settled
        ends = solve_banded((1, 0), bands, driven.reshape(len(record), -1), check_finite=False).reshape(record.shape)
        starts = np.concatenate([record[:1], ends[:-1]])
        return record + (starts - record) * (time / step) * (1 - decay)  # mean over the part of an exponential

"""Velocity lag: logged u and v come from a velocity over ground that is late; position, heading and turn rate are not.

As of a velocity that is differenced and smoothed from satellite positions: an earth-fixed vector of ``tau`` ago, turned
into body axes by the present heading. Inside the model the delay is an all-pass (``gnss_delay``); the synthetic
generator delays the columns themselves.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.effects.gnss_delay import late_samples, late_velocity
from mmg.motion.flow import Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory


class VelocityLag(Effect):
    """Late u and v."""

    name, enters = "velocity_lag", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        return (Parameter("tau", 0.0, 0.5 * k, 0.0, 5.0 * k, "s", "time by which logged u and v are late"),)

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        u, v, _ = late_velocity(y, memory, self.name, e.tau, p)
        return [y[0], y[1], y[2], u, v, y[5]]

    def samples(self, t: np.ndarray, y: Columns, flow: Flow, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        return [*y[:3], *late_samples(t, y, e.tau)[3:5], y[5]]

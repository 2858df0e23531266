"""Velocity filter: logged u and v lag the motion by ``tau``; position, heading and turn rate do not.

In the earth frame (``body_axes`` 0) as of a velocity that is differenced and smoothed from satellite positions: an
earth-fixed vector of ``tau`` ago, turned into body axes by the present heading. In body axes (1) as of the filter of a
receiver, an inertial unit or a speed log: u and v each behind a first-order low pass, tau y' + y = u, which leaves a
steady turn as it is. Inside the model the delay is an all-pass (``gnss_delay``), and neither has a time constant
shorter than an explicit integrator bears (``mmg.motion.memory``); the synthetic generator filters the columns
themselves.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.effects.gnss_delay import late_samples, less_low_pass
from mmg.effects.gyro import low_passed_samples
from mmg.motion.flow import Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory


class VelocityFilter(Effect):
    """Late or low-passed u and v."""

    name, enters = "velocity_filter", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k, axes = time_scale(p.L), "0: the velocity over ground is late, 1: u and v are low-passed in body axes"
        return (
            Parameter("tau", 0.0, 0.5 * k, 0.0, 5.0 * k, "s", "time by which logged u and v are late"),
            Parameter("body_axes", 0.0, 1.0, 0.0, 1.0, "", axes, held=True, choice=True),
        )

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        order = 2 - e.body_axes  # the lag of an all-pass is twice its time constant, that of a low pass is its own
        time = ca.sqrt((e.tau / order) ** 2 + (0.5 * time_scale(p.L)) ** 2)
        # heading 0 where body_axes is 1: the low pass turns with the ship
        behind, _ = less_low_pass(y, memory, self.name, time, p, (1 - e.body_axes) * y[2])
        u, v = (component - e.tau / time * part for component, part in zip(y[3:5], behind, strict=True))
        return [y[0], y[1], y[2], u, v, y[5]]

    def samples(self, t: np.ndarray, y: Columns, flow: Flow, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        if e.body_axes > 0.5:
            return [*y[:3], *(low_passed_samples(t, x, e.tau) for x in y[3:5]), y[5]]
        return [*y[:3], *late_samples(t, y, e.tau)[3:5], y[5]]

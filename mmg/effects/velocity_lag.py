"""Velocity lag: logged u and v come from a velocity over ground that is late; position, heading and turn rate are not.

As of a velocity that is differenced and smoothed from satellite positions: an earth-fixed vector of ``tau`` ago, turned
into body axes by the present heading. Inside the model the delay is an all-pass (``gnss_delay``); the synthetic
generator delays the columns themselves.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.effects.effect import Effect, Parameter
from mmg.flow import Flow
from mmg.frames import body_to_earth, earth_to_body
from mmg.memory import Memory, scale
from mmg.smooth import GRAVITY


class VelocityLag(Effect):
    """Late u and v."""

    name, enters = "velocity_lag", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = scale(p)
        return (Parameter("tau", 0.0, 0.5 * k, 0.0, 5.0 * k, "s", "time by which logged u and v are late"),)

    def columns(self, y: list[Any], flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> list[Any]:
        tau = ca.sqrt(e.tau**2 + scale(p) ** 2)
        size = 0.1 * float((GRAVITY * p.L) ** 0.5)
        velocity = body_to_earth(y[3], y[4], y[2])
        followed = [
            memory.low_pass(f"velocity_lag.{axis}", value, 0.5 * tau, size)
            for axis, value in zip(("north", "east"), velocity, strict=True)
        ]
        behind = earth_to_body(velocity[0] - followed[0], velocity[1] - followed[1], y[2])
        u, v = (component - 2 * e.tau / tau * part for component, part in zip(y[3:5], behind, strict=True))
        return [y[0], y[1], y[2], u, v, y[5]]


EFFECT = VelocityLag()

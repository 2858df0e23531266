"""Rudder backlash: the real rudder stays where it is until the logged one has moved by the dead band.

The play operator (``played``): the real angle is never further than b from the logged one, and rests
while that moves within 2 b.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter
from mmg.motion.flow import RUDDERS, Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory, played
from mmg.motion.smooth import Smoothing

# Angle [rad] that keeps the play smooth at zero dead band. Set by hand: 0.1 deg, less than a rudder is read to.
SOFTEST = 2e-3


class RudderBacklash(Effect):
    """Dead band of the steering gear."""

    name, enters, needs = "rudder_backlash", "actuator path", ("rudder",)
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (Parameter("b", 0.0, 0.05, 0.0, 0.5, "rad", "half of the dead band between logged and real rudder"),)

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        time = 0.5 * time_scale(
            p.L
        )  # in which the remembered position follows, as the least time constant of ``rudder_lag``
        return flow.actuated(
            RUDDERS, lambda name, x: played(memory, f"rudder_backlash.{name}", x, e.b, time, SOFTEST, 0.3)
        )

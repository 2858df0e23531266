"""Rudder offset: the real rudder angle is the logged one plus a constant."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter
from mmg.motion.flow import RUDDERS, Flow
from mmg.motion.memory import Memory
from mmg.motion.smooth import Smoothing


class RudderOffset(Effect):
    """Zero error of the rudder indicator."""

    name, enters, needs = "rudder_offset", "actuator path", ("rudder",)

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (Parameter("delta", 0.0, 0.05, -0.5, 0.5, "rad", "real rudder angle less the logged one"),)

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        return flow.actuated(RUDDERS, lambda _, angle: angle + e.delta)

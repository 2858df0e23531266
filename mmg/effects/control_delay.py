"""Control delay: rudder and revolutions act later than they are logged, by a fixed time.

Inside the model the delay is its all-pass approximation (``delayed`` of mmg/motion/memory.py). The synthetic generator
delays the inputs themselves, so a trial made with this effect holds the true delay.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter
from mmg.motion.flow import PROPELLERS, RUDDERS, Flow
from mmg.motion.froude import reference_speed, time_scale
from mmg.motion.memory import Memory, delayed
from mmg.motion.smooth import Smoothing


class ControlDelay(Effect):
    """Late inputs."""

    name, enters = "control_delay", "actuator path"
    form_error = 0.2

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        return (Parameter("tau", 0.0, 0.4 * k, 0.0, 5.0 * k, "s", "time by which rudder and revolutions act late"),)

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        k, size = time_scale(p.L), 0.1 * reference_speed(p.L) / (0.03 * p.L)
        flow = flow.moved(RUDDERS, lambda name, x: delayed(memory, f"control_delay.{name}", x, e.tau, k, 0.3))
        return flow.moved(PROPELLERS, lambda name, x: delayed(memory, f"control_delay.{name}", x, e.tau, k, size))

    def input_delay(self, e: SimpleNamespace) -> float:
        return float(e.tau)

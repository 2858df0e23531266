"""Control delay: rudder and revolutions act later than they are logged, by a fixed time.

Inside the model the delay is its all-pass approximation (``delayed`` of mmg/memory.py). The synthetic generator
delays the inputs themselves, so a trial made with this effect holds the true delay.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter
from mmg.effects.rudder_lag import RUDDERS
from mmg.flow import Flow
from mmg.memory import Memory, delayed, scale
from mmg.smooth import GRAVITY, Smoothing


class ControlDelay(Effect):
    """Late inputs."""

    name, enters = "control_delay", "actuator path"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = scale(p)
        return (Parameter("tau", 0.0, 0.4 * k, 0.0, 5.0 * k, "s", "time by which rudder and revolutions act late"),)

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        revolutions = 0.1 * float((GRAVITY * p.L) ** 0.5) / (0.03 * p.L)
        moved = {}
        for name in (*RUDDERS, "n", "n_2"):
            value = getattr(flow, name)
            if not isinstance(value, float):
                size = 0.3 if name in RUDDERS else revolutions
                moved[name] = delayed(memory, f"control_delay.{name}", value, e.tau, scale(p), size)
        return flow.with_(**moved)


EFFECT = ControlDelay()

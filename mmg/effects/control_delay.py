"""Control delay: rudder and revolutions act later than they are logged, by a fixed time.

In a fit and a prediction the delay is its all-pass approximation (``delayed`` of mmg/motion/memory.py). The synthetic
generator and the diagnosis delay the inputs themselves.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mmg.effects.effect import Effect, Parameter
from mmg.motion.flow import PROPELLERS, RUDDERS, Flow
from mmg.motion.froude import reference_speed, time_scale
from mmg.motion.memory import Memory, delayed
from mmg.motion.smooth import Smoothing


class ControlDelay(Effect):
    """Late inputs."""

    name, enters = "control_delay", "actuator path"
    moves, acts_before = (*RUDDERS, *PROPELLERS), True

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        return (Parameter("tau", 0.0, 0.4 * k, 0.0, 5.0 * k, "s", "time by which rudder and revolutions act late"),)

    def actuators(self, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace, s: Smoothing) -> Flow:
        # typical revolutions: those of a propeller of 3 % of the length at Froude number 0.1 and J = 1
        k, size = time_scale(p.L), 0.1 * reference_speed(p.L) / (0.03 * p.L)
        flow = flow.actuated(RUDDERS, lambda name, x: delayed(memory, f"control_delay.{name}", x, e.tau, k, 0.3))
        return flow.actuated(PROPELLERS, lambda name, x: delayed(memory, f"control_delay.{name}", x, e.tau, k, size))

    def acted(self, record: np.ndarray, step: float, time: float) -> np.ndarray:
        at = np.clip(np.arange(len(record)) - time / step, 0.0, len(record) - 1.0)  # place in the record, in parts
        low = np.minimum(at.astype(int), len(record) - 2)
        share = (at - low).reshape(-1, *(1,) * (record.ndim - 1))
        return (1 - share) * record[low] + share * record[low + 1]

    def input_delay(self, e: SimpleNamespace) -> float:
        return float(e.tau)

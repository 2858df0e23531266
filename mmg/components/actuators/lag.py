"""Actuators that follow their orders as first-order lags: y' = (y_c - y) / T, for rudders and propellers.

For large ships' main engines T_n is 5 to 50 s; for rudders a lag is the simplest stand-in for a rate limit.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import PROPELLERS, RUDDERS, Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L",)


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Time constants for a ship of length L: 1 s for the rudder and 1 s for the propeller of a 3 m model. p:
    particulars."""
    k = time_scale(p.L)
    return table(
        "1 s at 3 m by Froude's law",
        ("T_delta", 1.0 * k, 0.5 * k, 0.4 * k, 10.0 * k, "s", "time constant of the rudder"),
        ("T_n", 1.0 * k, 0.5 * k, 0.4 * k, 30.0 * k, "s", "time constant of the propeller"),
    )


def actuators(flow: Flow, memory: Memory, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Flow:
    """Positions of rudders and propellers whose orders the flow holds. memory takes their states; p, c, s: as in
    mmg/motion/flow.py."""
    # typical sizes of the states: 0.3 rad of a rudder, 10 rev/s of the propeller of a 3 m model
    flow = flow.actuated(RUDDERS, lambda name, order: memory.low_pass(name, order, c.T_delta, 0.3))
    return flow.actuated(PROPELLERS, lambda name, order: memory.low_pass(name, order, c.T_n, 10.0 / time_scale(p.L)))

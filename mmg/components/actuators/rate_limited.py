"""Actuators with a limited rate: y' = K tanh((y_c - y) / (K T)), the smooth form of a sloped step.

For rudders (K_delta, T_delta) and propellers (K_n, T_n); thrusters and pitch follow at once. Far from the order the
rate is K, near it the position follows as a lag of time constant T. (Sloped step: Wakita et al. 2025, Eqs. 39-40;
20 deg/s and 20 rps/s for 3 m models, there with T = 0.1 s.) Defaults by Froude's law, 1.9 deg/s at 320 m; T is at
least 0.4 s of a 3 m model, because steps of calibrations are about 1 s.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import PROPELLERS, RUDDERS, Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory, rate_limited
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L",)


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Rates and time constants for a ship of length L, with its own ``rudder_rate`` where the file gives one. p:
    particulars."""
    k = time_scale(p.L)
    swift = getattr(p, "rudder_rate", math.radians(20.0) / k)
    turns, time = 20.0 / k**2, 0.4 * k  # revolutions go with 1 / sqrt(L), their rates with 1 / L
    return table(
        "20 deg/s and 20 rps/s of 3 m models by Froude's law",
        ("K_delta", swift, 0.2 * swift, 0.05 * swift, 5 * swift, "rad/s", "greatest rate of the rudder"),
        ("T_delta", time, 0.3 * time, 0.8 * time, 10 * time, "s", "lag of the rudder near its order"),
        ("K_n", turns, 0.3 * turns, 0.01 * turns, 5 * turns, "1/s^2", "greatest rate of the propeller"),
        ("T_n", time, 0.3 * time, 0.8 * time, 30 * time, "s", "lag of the propeller near its order"),
    )


def actuators(flow: Flow, memory: Memory, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Flow:
    """Positions of rudders and propellers whose orders the flow holds. memory takes their states; p, c, s: as in
    mmg/motion/flow.py."""
    size = 10.0 / time_scale(p.L)  # of the state: 10 rev/s of a 3 m model; of a rudder 0.3 rad
    flow = flow.actuated(RUDDERS, lambda name, order: rate_limited(memory, name, order, c.K_delta, c.T_delta, 0.3))
    return flow.actuated(PROPELLERS, lambda name, order: rate_limited(memory, name, order, c.K_n, c.T_n, size))

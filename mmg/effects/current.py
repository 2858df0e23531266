"""Current: uniform water velocity over ground, steady or changing slowly with time.

The water moves with (x + x_rate t, y + y_rate t) over ground, t since the start of the run. All forces and the
equations of motion are those of the velocity through the water (relative-velocity formulation, Fossen 2021); positions
and logged velocities are over ground. Froude-Krylov force included, so an unsteady current adds no other term.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.effects.effect import Effect, Parameter
from mmg.motion.flow import Flow
from mmg.motion.froude import time_scale


class Current(Effect):
    """Uniform current, direction *going to*."""

    name, enters = "current", "inflow"
    surroundings = True
    needs_time = True

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        size, most = 0.02 * k, 0.5 * k
        return (
            Parameter("x", 0.0, size, -most, most, "m/s", "water velocity over ground to the north"),
            Parameter("y", 0.0, size, -most, most, "m/s", "water velocity over ground to the east"),
            Parameter("x_rate", 0.0, 1e-4, -0.01, 0.01, "m/s^2", "change of x with time", held=True),
            Parameter("y_rate", 0.0, 1e-4, -0.01, 0.01, "m/s^2", "change of y with time", held=True),
        )

    def water(self, flow: Flow, e: SimpleNamespace) -> tuple[Any, Any, Any, Any]:
        return e.x + e.x_rate * flow.time, e.y + e.y_rate * flow.time, e.x_rate, e.y_rate

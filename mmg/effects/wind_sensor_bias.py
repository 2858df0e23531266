"""Wind sensor bias: the air moves with the logged wind plus a velocity that is constant in the earth frame."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.effects.effect import Effect, Parameter
from mmg.motion.froude import time_scale


class WindSensorBias(Effect):
    """Air velocity minus logged wind, constant in the earth frame. Needs a wind model to have a force."""

    name, enters, needs = "wind_sensor_bias", "inflow", ("wind",)
    surroundings = True

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        size, most = 0.3 * time_scale(p.L), 5.0 * time_scale(p.L)
        return (
            Parameter("x", 0.0, size, -most, most, "m/s", "air velocity to the north less the logged one"),
            Parameter("y", 0.0, size, -most, most, "m/s", "air velocity to the east less the logged one"),
        )

    def air(self, north: Any, east: Any, e: SimpleNamespace) -> tuple[Any, Any]:
        return north + e.x, east + e.y

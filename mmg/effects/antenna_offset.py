"""Antenna offset: satellite position and velocity belong to a point off midship.

That point is x ahead and y to starboard of midship: its velocity is (u - r y, v + r x) in body axes. Where a log of
the ship's own measures u and v, the position alone belongs to it.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.motion.flow import Flow
from mmg.motion.frames import body_to_earth
from mmg.motion.memory import Memory


class AntennaOffset(Effect):
    """Lever arm of the position."""

    name, enters = "antenna_offset", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        size, most, alone = 0.07 * p.L, p.L, "the same while u and v are midship's"
        aboard = {"least": -0.5 * p.L, "most": 0.5 * p.L}  # no antenna lies beyond bow or stern
        return (
            Parameter("x", 0.0, size, -most, most, "m", "antenna ahead of midship", **aboard),
            Parameter("y", 0.0, size, -most, most, "m", "antenna to starboard of midship", **aboard),
            Parameter("alone_x", 0.0, size, -most, most, "m", alone, held=True, form="alone", **aboard),
            Parameter("alone_y", 0.0, size, -most, most, "m", alone, held=True, form="alone", **aboard),
        )

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        north, east = body_to_earth(e.x + e.alone_x, e.y + e.alone_y, flow.psi)
        # velocity of the point: v + r x (x, y), the true rate of turn; ``alone`` leaves it to the ship's own log
        return [y[0] + north, y[1] + east, y[2], y[3] - flow.r * e.y, y[4] + flow.r * e.x, y[5]]

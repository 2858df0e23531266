"""Heading bias: the logged heading is off by a constant, and u and v are turned with it.

u and v of a record come from the velocity over ground, turned by the logged heading. Where a log of the ship's own
measures them, the heading alone is off.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.motion.flow import Flow
from mmg.motion.frames import earth_to_body
from mmg.motion.memory import Memory


class HeadingBias(Effect):
    """Constant error of the compass."""

    name, enters = "heading_bias", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        return (
            Parameter("psi", 0.0, 0.01, -0.5, 0.5, "rad", "logged heading less the true one"),
            Parameter("alone", 0.0, 0.01, -0.5, 0.5, "rad", "the same while u and v are right", True, "alone"),
        )

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        u, v = earth_to_body(y[3], y[4], e.psi)  # body axes turned by psi: the same rotation as from earth to body
        return [y[0], y[1], y[2] + e.psi + e.alone, u, v, y[5]]

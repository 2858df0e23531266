"""Wave drift: a force that is constant in the earth frame, larger on the side of the ship than on the bow.

The drift force of waves from abeam is several times that from ahead (second-order theory; short form, UNVERIFIED
ratio): the component along the ship is multiplied by BOW.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force
from mmg.motion.frames import earth_to_body
from mmg.motion.froude import force_scale

BOW = 0.3  # Share [-] of the drift force beam on that acts along the ship; UNVERIFIED. Set by hand.


class WaveDrift(Effect):
    """Mean wave drift force from one direction."""

    name, enters = "wave_drift", "force"
    surroundings = True
    form_error = 0.05

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        size = 0.08 * force_scale(p.L)
        most = 500 * size
        return (
            Parameter("x", 0.0, size, -most, most, "N", "drift force to the north on a ship beam on"),
            Parameter("y", 0.0, size, -most, most, "N", "drift force to the east on a ship beam on"),
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        along, across = earth_to_body(e.x, e.y, flow.psi)
        return {**parts, "wave_drift": Force(BOW * along, across, 0.0)}

"""Bank: suction towards a bank line and a moment that turns the bow away from it, decaying with the distance.

Y = 1/2 rho L d u^2 suction w sin(bearing - psi), N = -1/2 rho L^2 d u^2 moment w sin(bearing - psi), with
w = 1 / (1 + exp(e / decay)) of the distance e [m] from midship to the bank line (structure after Norrbin 1974, the
coefficients are UNVERIFIED and to be identified). The line lies ``distance`` from the origin in direction ``bearing``.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca

from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force


class Bank(Effect):
    """Bank suction and bank moment of one straight bank."""

    name, enters = "bank", "force"
    surroundings = True
    form_error = 0.6

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        half = math.pi / 2
        return (
            Parameter("suction", 0.0, 0.03, -1.0, 2.0, "", "sway force towards the bank, by 1/2 rho L d u^2"),
            Parameter("moment", 0.0, 0.01, -1.0, 1.0, "", "yaw moment away from the bank, by 1/2 rho L^2 d u^2"),
            Parameter("distance", 2 * p.L, p.L, -1e6, 1e6, "m", "bank line from the origin", held=True),
            Parameter("bearing", -half, 0.1, -7.0, 7.0, "rad", "direction from the water to the bank", held=True),
            Parameter("decay", 0.5 * p.L, 0.2 * p.L, 0.01 * p.L, 100 * p.L, "m", "length of the decay", held=True),
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        # distance from midship to the line, positive on the water's side of it
        away = e.distance - flow.x * ca.cos(e.bearing) - flow.y * ca.sin(e.bearing)
        weight = 0.5 * (1 - ca.tanh(0.5 * away / e.decay))  # 1 / (1 + exp(e / decay)), which does not overflow
        unit = 0.5 * at.p.rho * at.p.L * at.p.d * flow.u**2 * weight * ca.sin(e.bearing - flow.psi)
        return {**parts, "bank": Force(0.0, e.suction * unit, -e.moment * at.p.L * unit)}

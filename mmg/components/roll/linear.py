"""Roll driven by the motion in the horizontal plane, without acting back on it.

(I_x + J_x) p' + 2 zeta sqrt((I_x + J_x) m g GM) p + m g GM sin(phi) = K, phi' = p, phi > 0 to starboard, with
K = -(z_H Y_H + z_R Y_R + z_A Y_A) + m z_G (v' + u r) (general rigid body about midship, z down; Son & Nomoto 1981 and
Fossen 2011 in short form): hull, rudder and wind force act z below the waterline (z_A < 0), the centre of gravity lies
z_G below it. Weak coupling: Y_phi and N_phi, which matter for container ships at high speed, are left out. UNVERIFIED
as a whole against roll tests; steady heel and period follow from GM by statics.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import GRAVITY
from mmg.motion.memory import Memory

PARTICULARS = ("B", "d", "m", "GM")


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Levers [m] and inertia for a ship of these particulars. p: particulars."""
    d, B = p.d, p.B
    return table(
        "usual for merchant ships",
        ("k_x_roll", 0.40 * B, 0.05 * B, 0.2 * B, 0.7 * B, "m", "radius of gyration in roll with added inertia"),
        ("zeta_roll", 0.08, 0.04, 0.0, 1.0, "", "damping ratio of roll"),
        ("z_H", 0.5 * d, 0.2 * d, -d, 2 * d, "m", "hull sway force below the waterline"),
        ("z_R", 0.6 * d, 0.2 * d, -d, 2 * d, "m", "rudder force below the waterline"),
        ("z_A", -0.3 * d, 0.3 * d, -5 * d, 0.0, "m", "wind force below the waterline (negative: above)"),
        ("z_G", 0.0, 0.3 * d, -2 * d, d, "m", "centre of gravity below the waterline"),
    )


def roll(flow: Flow, parts: dict[str, Force], dv: Any, memory: Memory, p: SimpleNamespace, c: SimpleNamespace) -> None:
    """Adds the states phi [rad] and p [rad/s] to the memory; dv: rate of v at midship [m/s^2]. flow, p, c: as in
    mmg/motion/flow.py; parts: forces by role."""
    levers = {"hull": c.z_H, "rudder": c.z_R, "wind": c.z_A}
    K = p.m * c.z_G * (dv + flow.u * flow.r)
    for role, lever in levers.items():
        if role in parts:
            K = K - lever * parts[role].Y
    inertia, stiffness = p.m * c.k_x_roll**2, p.m * GRAVITY * p.GM
    phi = memory.state("phi", 0.0, 0.1)
    # typical size: 0.1 rad at the natural frequency sqrt(g GM) / k_x, k_x = 0.4 B
    rate = memory.state("p", 0.0, 0.1 * float((GRAVITY * p.GM) ** 0.5 / (0.4 * p.B)))
    damping = 2 * c.zeta_roll * ca.sqrt(inertia * stiffness)  # of an oscillator of damping ratio zeta
    memory.moves(rate, (K - damping * rate - stiffness * ca.sin(phi)) / inertia)

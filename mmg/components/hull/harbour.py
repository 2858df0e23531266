"""Unified low-speed hull with linear damping, for craft that spend their time at harbour speeds and at rest.

The force of ``unified`` and, with u' = u / sqrt(g L), v' = v / sqrt(g L), r' = r sqrt(L / g):
X = -1/2 rho g L^2 d D_u u', Y = -1/2 rho g L^2 d D_v v', N = -1/2 rho g L^3 d D_r r'.

All damping of ``unified`` is quadratic and vanishes with the square of the speed; laminar skin friction and the waves
that a ship makes as she starts and turns are linear (Fossen 2011, 6.4). Made dimensionless by sqrt(g L) in place of the
speed, the coefficients are the same for similar ships of any size.
Defaults: the supply vessel of Fossen, Sagatun & Sorensen (1996), identified from tests at rest, L = 76.2 m, 6000 t:
0.0358, 0.1183, 0.0308 by m sqrt(g/L) and m L^2 sqrt(g/L), as in the public MSS toolbox, times her m' = 0.32 (at a
draught of 6.25 m, which is UNVERIFIED). One ship: the standard deviation is as large as the value.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components.coefficients import table
from mmg.components.hull import unified
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import reference_speed
from mmg.motion.smooth import Smoothing

PARTICULARS = unified.PARTICULARS

COEFFICIENTS = (
    *unified.COEFFICIENTS,
    *table(
        "a supply vessel at rest (Fossen et al. 1996)",
        ("D_u", 0.0115, 0.0115, 0.0, 0.2, "", "linear damping of surge, by 1/2 rho L d sqrt(g L)"),
        ("D_v", 0.038, 0.038, 0.0, 0.6, "", "linear damping of sway, by 1/2 rho L d sqrt(g L)"),
        ("D_r", 0.0099, 0.0099, 0.0, 0.2, "", "linear damping of yaw, by 1/2 rho L^3 d sqrt(g L)"),
    ),
)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Hull force [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    unit = 0.5 * p.rho * p.L * p.d * reference_speed(p.L)  # by a speed [m/s] a force, sqrt(g L) stands for the other U
    damping = Force(-unit * c.D_u * flow.u, -unit * c.D_v * flow.v, -unit * p.L**2 * c.D_r * flow.r)
    return unified.force(flow, p, c, s) + damping

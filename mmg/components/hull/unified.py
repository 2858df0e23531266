"""Unified low-speed hull (Yoshimura, Nakao & Ishibashi 2009): valid for every drift angle, at rest too.

X_H = 1/2 rho L d { [X_0F' + (X_0A' - X_0F') |beta|/pi] u U + X_vr' L v r },  |beta| = |atan2(v, u)|
Y_H = 1/2 rho L d { Y_v' v |u| + Y_r' L r u - C_D I_Y(v, C_rY r L) }
N_H = 1/2 rho L^2 d { N_v' v u + N_r' L r |u| - C_D I_N(v, C_rN r L) }
with the cross-flow integrals I_Y = int |v + b xi| (v + b xi) d xi and I_N = int |v + b xi| (v + b xi) xi d xi
over xi in (-1/2, 1/2). Verified against two independent public codes of one lineage.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import table
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "d", "rho")

# Standard deviations of about half the value: what the regressions of ``empirical`` differ by between ships.
COEFFICIENTS = table(
    "default of the unified low-speed hull model",
    ("X_0F", -0.022, 0.011, -0.1, 0.0, "mmg", "resistance coefficient going ahead (negative: a drag)"),
    ("X_0A", -0.030, 0.015, -0.1, 0.0, "mmg", "resistance coefficient going astern (negative: a drag)"),
    ("X_vr", 0.0, 0.1, -0.5, 0.8, "mmg", "surge force due to sway and yaw"),
    ("Y_v", -0.37, 0.18, -1.0, 0.0, "mmg", "sway force due to sway velocity"),
    ("Y_r", 0.10, 0.07, -0.5, 0.5, "mmg", "sway force due to yaw rate"),
    ("N_v", -0.14, 0.07, -0.5, 0.0, "mmg", "yaw moment due to sway velocity"),
    ("N_r", -0.05, 0.025, -0.3, 0.0, "mmg", "yaw moment due to yaw rate"),
    ("C_D", 0.80, 0.3, 0.2, 1.8, "", "cross-flow drag coefficient"),
    ("C_rY", 1.5, 0.6, 0.3, 3.5, "", "correction of yaw in the cross-flow sway force"),
    ("C_rN", 0.80, 0.4, 0.3, 2.0, "", "correction of yaw in the cross-flow yaw moment"),
)


def cross_flow(a: Any, b: Any, width: float) -> tuple[Any, Any]:
    """Closed form of the two cross-flow integrals, smooth for ``width`` > 0 and exact as it tends to 0.

    a, b: speeds [m/s]: sway speed, and yaw speed over the length; returns (I_Y, I_N) [m^2/s^2]. No branch and no
    division by zero: the roots of the two cases |a| >= |b|/2 and |a| < |b|/2 are merged by
    R = sqrt((a^2 - h^2)^2 + width^4), h = b/2.
    """
    h = 0.5 * b  # of the section at either end: v + b xi changes its sign along the hull where |a| < |h|
    a2, h2 = a * a, h * h
    R = ca.sqrt((a2 - h2) ** 2 + width**4)  # |a^2 - h^2| rounded
    larger, smaller = 0.5 * (a2 + h2 + R), 0.5 * (a2 + h2 - R)  # max and min of a^2 and h^2
    excess = 0.5 * (h2 - a2 + R)  # max(h^2 - a^2, 0)
    M = ca.sqrt(larger)
    I_Y = a * (M + smaller / (3 * M))
    I_N = b * (M / 6 - excess * (5 * larger - smaller) / (48 * larger * M))
    return I_Y, I_N


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Hull force [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    u, v, r = flow.u, flow.v, flow.r
    small = 0.1 * s.speed
    U = s.root(u * u + v * v, small)
    abs_u = s.absolute(u, small)
    astern_share = s.angle(u, v, small) / ca.pi  # |beta| / pi: 0 ahead, 1 astern
    I_Y, _ = cross_flow(v, c.C_rY * r * p.L, small)  # force and moment have corrections of yaw of their own
    _, I_N = cross_flow(v, c.C_rN * r * p.L, small)
    X = (c.X_0F + (c.X_0A - c.X_0F) * astern_share) * u * U + c.X_vr * p.L * v * r
    # |u| in Y_v and N_r, u in Y_r and N_v: going astern the hull is the ship mirrored fore and aft
    Y = c.Y_v * v * abs_u + c.Y_r * p.L * r * u - c.C_D * I_Y
    N = c.N_v * v * u + c.N_r * p.L * r * abs_u - c.C_D * I_N
    unit = 0.5 * p.rho * p.L * p.d
    return Force(unit * X, unit * Y, unit * p.L * N)

"""Standard MMG hull polynomial (Yasukawa & Yoshimura 2015, J Mar Sci Technol 20:37-52), written dimensionally.

X_H = 1/2 rho L d U^2 ( -R_0' + X_vv' v'^2 + X_vr' v'r' + X_rr' r'^2 + X_vvvv' v'^4 )
Y_H = 1/2 rho L d U^2 ( Y_v' v' + Y_r' r' + Y_vvv' v'^3 + Y_vvr' v'^2 r' + Y_vrr' v' r'^2 + Y_rrr' r'^3 )
N_H = 1/2 rho L^2 d U^2 ( the same with N ),  v' = v/U, r' = r L/U
Valid for u > 0, |beta| up to 20..30 degrees, |r'| up to about 1, merchant hulls at low Froude number. X_vr and Y_r are
pure: m_y v r and m_x u r are in the equations of motion.

Outside of that it is a continuation that is smooth and takes energy out of the ship, and no more: for slow, drifting
or sternway motion take the unified model. Astern the hull is that of the ship mirrored fore and aft, so that the terms
R_0, X_vv, X_rr, X_vvvv, Y_r, Y_vvr, Y_rrr, N_v, N_vvv, N_vrr change sign with u, by tanh(u/(0.15 U)): 1 - 2e-5 at 30
degrees of drift. In the terms with 1/U the speed is held above r L/2: they see |r'| < 2 and vanish at rest.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import table
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "d", "rho")

# Drift angle [rad] up to which a polynomial of this kind is fitted to tests; beyond, it extrapolates. Captive tests end
# at 20 to 30 degrees (Yasukawa & Yoshimura 2015).
LARGEST_DRIFT = math.radians(30.0)

COEFFICIENTS = table(
    "default of the MMG hull polynomial: of the size met in captive tests of full ships",
    ("R_0", 0.020, 0.004, 0.0, 0.1, "mmg", "resistance coefficient (positive: a drag)"),
    ("X_vv", -0.04, 0.06, -0.5, 0.5, "mmg", "surge force, quadratic in sway"),
    ("X_vr", 0.0, 0.06, -0.5, 0.8, "mmg", "surge force due to sway and yaw"),
    ("X_rr", 0.0, 0.03, -0.3, 0.3, "mmg", "surge force, quadratic in yaw"),
    ("X_vvvv", 0.5, 0.4, -1.0, 3.0, "mmg", "surge force, fourth power of sway"),
    ("Y_v", -0.32, 0.1, -1.0, 0.0, "mmg", "sway force due to sway velocity"),
    ("Y_r", 0.08, 0.05, -0.5, 0.5, "mmg", "sway force due to yaw rate"),
    ("Y_vvv", -1.5, 0.6, -5.0, 0.5, "mmg", "sway force, sway cubed"),
    ("Y_vvr", 0.3, 0.4, -3.0, 3.0, "mmg", "sway force, sway squared and yaw"),
    ("Y_vrr", -0.4, 0.3, -3.0, 3.0, "mmg", "sway force, sway and yaw squared"),
    ("Y_rrr", 0.0, 0.04, -0.5, 0.5, "mmg", "sway force, yaw cubed"),
    ("N_v", -0.13, 0.04, -0.5, 0.0, "mmg", "yaw moment due to sway velocity"),
    ("N_r", -0.05, 0.015, -0.3, 0.0, "mmg", "yaw moment due to yaw rate"),
    ("N_vvv", -0.05, 0.15, -1.0, 1.0, "mmg", "yaw moment, sway cubed"),
    ("N_vvr", -0.3, 0.2, -2.0, 1.0, "mmg", "yaw moment, sway squared and yaw"),
    ("N_vrr", 0.0, 0.1, -1.0, 1.0, "mmg", "yaw moment, sway and yaw squared"),
    ("N_rrr", -0.02, 0.02, -0.3, 0.1, "mmg", "yaw moment, yaw cubed"),
)

# Width [-, by U] of the change of sign across u = 0: what is asymmetric fore and aft fades beyond 70 degrees of drift,
# far outside of captive tests (20 to 30 degrees, Yasukawa & Yoshimura 2015).
ABEAM = 0.15

LARGEST_YAW = 2.0  # Largest r' = r L/U [-] in terms with 1/U: twice that of captive tests (Yasukawa & Yoshimura 2015)


def rates(v: Any, yaw: Any, U2: Any, s: Smoothing) -> tuple[Any, Any]:
    """v' and r' with the speed held above |yaw|/2, zero at rest; v, yaw = r L [m/s], U2 = u^2 + v^2 [m^2/s^2].

    Smooth: r' is 1.5e-4 of itself too small at r' = 0.87, the steady turn of a full tanker.
    """
    small = 0.1 * s.speed
    bound = (yaw / LARGEST_YAW) ** 2  # U^2 at which r' = r L/U is LARGEST_YAW
    lack = s.positive(bound - U2, 0.03 * (bound + U2 + small**2))
    U, hold = s.root(U2, small), ca.sqrt(lack + small**2)
    return s.divide(v, U, hold), s.divide(yaw, U, hold)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Hull force [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    u, v, yaw = flow.u, flow.v, flow.r * p.L
    U2, small = u * u + v * v, 0.1 * s.speed
    U, width = s.root(U2, small), ABEAM * ca.sqrt(U2 + s.speed**2)
    way = s.step(u, width) - s.step(-u, width)  # tanh(u / width): 1 ahead, -1 astern
    v1, r1 = rates(v, yaw, U2, s)
    # U^2 of the published form is multiplied out as far as a term has v' and r'; v1, r1 are those that remain
    X = way * (-c.R_0 * U2 + c.X_vv * v * v + c.X_rr * yaw * yaw + c.X_vvvv * (v * v1) ** 2) + c.X_vr * v * yaw
    Y = c.Y_v * U * v + way * c.Y_r * U * yaw
    Y += c.Y_vvv * v * v * v1 + way * c.Y_vvr * v * v * r1 + c.Y_vrr * v * yaw * r1 + way * c.Y_rrr * yaw * yaw * r1
    N = way * c.N_v * U * v + c.N_r * U * yaw
    N += way * c.N_vvv * v * v * v1 + c.N_vvr * v * v * r1 + way * c.N_vrr * v * yaw * r1 + c.N_rrr * yaw * yaw * r1
    unit = 0.5 * p.rho * p.L * p.d
    return Force(unit * X, unit * Y, unit * p.L * N)

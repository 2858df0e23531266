"""Controllable-pitch propeller: thrust in pieces of the ship's advance ratio (after Koike, as in a public NAOE code).

Blade angle th [deg], zero thrust at th_0 = 10, th_max = 40, th_min = -20; J_s = u/(n D);
J_x0 = 0.7 pi tan(th - th_0), alpha = C_1/J_x0(th_max), X_1 = alpha J_x0, X_0 = C_0 (th - th_0)/(th_max - th_0):
  th > th_0:  K_X = -alpha (J_s + J_sx) + X_0 for J_s <= -J_sx; X_1 + (X_1 - X_0) J_s/J_sx up to 0; -alpha (J_s - J_x0)
  th <= th_0: K_X = -alpha (J_s - J_sx) + X_0 for J_s >= J_sx; X_1 - (X_1 - X_0) J_s/J_sx down to 0; -alpha (J_s - J_x0)
  K_Y = K_Y_max ((th_0 - th)/(th_0 - th_min))^2 for th < th_0, else 0; K_N = K_N_Y K_Y (0.178 and -0.5)
X = rho n^2 D^4 K_X, Y = rho n^2 D^4 K_Y [N], N = rho n^2 D^4 L K_N [N m]. Single public lineage (UNVERIFIED).

The pieces join in J_s; at th_0 the two laws do not (K_X jumps by up to alpha J_sx = 0.24 at J_s = +-J_sx): blended
over 1 deg. Multiplied out, nothing divides by n. K_X is of the thrust on the ship, so there is no thrust deduction;
t_P and w_P0 serve the slipstream alone. For n < 0, outside the source, the force X is that of (-u, -n) with the other
sign. A stopped propeller has no drag.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import table
from mmg.motion.flow import Flow, Force, Slipstream
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P")
INPUTS = ("n", "pitch")
SIDE_FORCE = True  # The model has a side force of its own (the effect propeller_side_force takes a factor on it)

COEFFICIENTS = (
    *table(
        "default of the controllable-pitch model: 3 m model of a car carrier, single public lineage",
        ("C_0", 0.4, 0.1, 0.05, 1.2, "", "thrust at full pitch where the inner piece ends, J_s = -J_sx"),
        ("C_1", 0.6, 0.1, 0.1, 1.5, "", "thrust at full pitch and zero speed"),
        ("J_sx", 0.5, 0.1, 0.1, 1.5, "", "advance ratio at which the inner piece ends"),
        ("K_Y_max", 0.178, 0.09, 0.0, 0.6, "", "side force at full astern pitch"),
        ("K_N_Y", -0.5, 0.15, -1.0, 0.5, "", "moment by side force and length"),
        ("theta_0", math.radians(10), math.radians(1), math.radians(-5), math.radians(20), "rad", "zero-thrust pitch"),
    ),
    *table(
        "default of the controllable-pitch model",
        ("theta_max", math.radians(40), 0.0, 0.4, 1.0, "rad", "full ahead pitch, scale of the thrust law"),
        ("theta_min", math.radians(-20), 0.0, -1.0, 0.0, "rad", "full astern pitch, scale of the side force"),
        fixed=True,
    ),
    *table(
        "default of the controllable-pitch model",
        ("t_P", 0.20, 0.05, 0.0, 0.5, "", "thrust deduction: open-water thrust in the slipstream is K_X/(1 - t_P)"),
        ("w_P0", 0.40, 0.08, 0.0, 0.85, "", "wake fraction in the slipstream, with headway"),
    ),
)

# Width [rad] of the blend between the laws above and below zero-thrust pitch: it rounds a corner. Set by hand.
PITCH_WIDTH = math.radians(1.0)


def _ahead_law(u: Any, m: Any, X_0: Any, X_1: Any, alpha: Any, c: SimpleNamespace, s: Smoothing) -> Any:
    """m^2 K_X [m^2/s^2] above the zero-thrust pitch; u is positive where positive pitch pushes, m = |n D|."""
    width = s.magnitude(0.02 * m, 0.2 * s.speed)  # of the blends in u: 0.02 in J_s
    outer, inner = 1 - s.step(u + c.J_sx * m, width), 1 - s.step(u, width)
    # u / m is J_s; K_X of the three pieces times m^2
    far = -alpha * m * (u + c.J_sx * m) + X_0 * m * m
    middle = X_1 * m * m + (X_1 - X_0) * m * u / c.J_sx
    near = m * (X_1 * m - alpha * u)
    return outer * far + (inner - outer) * middle + (1 - inner) * near


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Propeller force [N, N, N m] and slipstream; ``flow.pitch`` in rad. flow, p, c, s: as in mmg/motion/flow.py."""
    u, nD = flow.u, flow.n * p.D_P
    small = 0.1 * s.speed
    sense, m = s.sign(nD, small), s.absolute(nD, small)
    angle, span = flow.pitch - c.theta_0, c.theta_max - c.theta_0
    alpha = c.C_1 / (0.7 * math.pi * ca.tan(span))
    X_1, X_0 = alpha * 0.7 * math.pi * ca.tan(angle), c.C_0 * angle / span
    along = sense * u
    above = _ahead_law(along, m, X_0, X_1, alpha, c, s)
    # the law below the zero-thrust pitch is that above it with -J_s, -X_0, -X_1, and the other sign
    below = -_ahead_law(-along, m, -X_0, -X_1, alpha, c, s)
    positive = s.step(angle, PITCH_WIDTH)
    loading = sense * (positive * above + (1 - positive) * below)
    K_Y = c.K_Y_max * (s.positive(-angle, PITCH_WIDTH) / (c.theta_0 - c.theta_min)) ** 2
    area = p.rho * p.D_P**2
    Y = area * nD**2 * K_Y
    one_minus_w = 1 - s.step(u, s.speed) * c.w_P0
    aft = s.sign(loading, s.speed**2)  # by the thrust: n > 0 may push either way here
    wash = Slipstream(one_minus_w, u * one_minus_w, loading / (1 - c.t_P), s.step_or_zero(nD, s.speed), aft)
    return Force(area * loading, Y, c.K_N_Y * p.L * Y, wash)

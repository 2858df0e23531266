"""Propeller of a VecTwin ship: wake, thrust deduction and thrust by polynomials of advance ratio (Kang et al. 2008).

J_s = u/(n D), v_P' = v' + x_P' r', J = u_P/(n D), u_P = u (1 - w_P):
  1 - w_P = a_0 + a_1 J_s + a_2 J_s^2 + b_0 [b_1 v_P' + (v_P' + b_2 v_P'|v_P'|)^2], clipped to (0, 1]; 1 for u <= 0,
  1 - t_P = c_0 + c_1 J + c_2 J^2 + d_0 [d_1 v_P' + (v_P' + d_2 v_P'|v_P'|)^2], clipped to (0, 1]; 1 for u <= 0,
  X_P = (1 - t_P) rho n^2 D^4 K_T, K_T = k_0 + k_1 J + k_2 J^2 for J >= 0, k2_0 + k2_1 J + k2_2 J^2 for J < 0.
Single public lineage. The public code has v_P' = v' - x_P' r' with x_P' = -0.498, against the geometry; here the sign
belongs to the coefficient x_P: -0.498 is the geometry, +0.498 reproduces that code.

Not in the source, for use in all quadrants (UNVERIFIED): where smooth, J_s and J are limited to +-1.5 in the
polynomials of wake and thrust deduction (they grow without bound as n tends to 0; at n = 0 they are 0); a reversed
propeller gives -k_rev times the thrust of the mirrored motion (-u, -n), where the published K_T would push ahead:
k_rev = 0.78 is the ratio of the bollard thrusts of B4-70, 0.3471/0.4451. Thrust is multiplied out: nothing divides by
n.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import table
from mmg.motion.flow import Flow, Force, Slipstream
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P")
INPUTS = ("n",)

# Largest advance ratio [-] for which smooth wake, thrust deduction and rudder polynomials are evaluated.
LIMIT = 1.5  # set by hand

COEFFICIENTS = table(
    "default of Kang's propeller model: cement carrier with VecTwin rudders, single public lineage",
    ("a_0", 0.652, 0.1, 0.1, 1.2, "", "1 - w_P, constant"),
    ("a_1", -0.112, 0.1, -1.0, 1.0, "", "1 - w_P, linear in J_s"),
    ("a_2", 0.0, 0.1, -1.0, 1.0, "", "1 - w_P, quadratic in J_s"),
    ("b_0", 2.227, 0.7, 0.0, 8.0, "", "change of wake with the inflow angle"),
    ("b_1", 0.006, 0.05, -0.5, 0.5, "", "asymmetry of the change of wake"),
    ("b_2", -0.85, 0.3, -3.0, 1.0, "", "levelling off of the change of wake"),
    ("c_0", 0.972, 0.1, 0.4, 1.3, "", "1 - t_P, constant"),
    ("c_1", -1.04, 0.3, -3.0, 1.0, "", "1 - t_P, linear in J"),
    ("c_2", 0.845, 0.3, -2.0, 3.0, "", "1 - t_P, quadratic in J"),
    ("d_0", 0.776, 0.3, -2.0, 5.0, "", "change of thrust deduction with the inflow angle"),
    ("d_1", -0.024, 0.05, -0.5, 0.5, "", "asymmetry of the change of thrust deduction"),
    ("d_2", 1.558, 0.5, -3.0, 5.0, "", "growth of the change of thrust deduction"),
    ("k_0", 0.2794, 0.03, 0.05, 0.8, "", "open-water thrust, constant"),
    ("k_1", -0.1279, 0.05, -1.0, 0.2, "", "open-water thrust, linear in J"),
    ("k_2", -0.285, 0.05, -1.0, 0.5, "", "open-water thrust, quadratic in J"),
    ("k2_0", 0.2869, 0.03, 0.05, 0.8, "", "thrust at negative advance ratio, constant"),
    ("k2_1", 0.2109, 0.1, -1.0, 1.5, "", "thrust at negative advance ratio, linear in J"),
    ("k2_2", 0.4338, 0.15, 0.0, 2.0, "", "thrust at negative advance ratio, quadratic in J"),
    ("k_rev", 0.78, 0.1, 0.3, 1.2, "", "thrust of the reversed propeller by that of the mirrored motion"),
    ("x_P", -0.498, 0.05, -0.7, 0.7, "mmg", "effective longitudinal position of the propeller, by L"),
)


def advance_ratio(speed: Any, nD: Any, s: Smoothing) -> Any:
    """speed/(n D), 0 at n = 0; smooth: J/sqrt(1 + (J/LIMIT)^4/4), which is largest, LIMIT, at J = 2^(1/2) LIMIT.

    It falls off beyond and changes sign over n D of the size of the speed, not in a jump at n = 0. At J = 0.3 it is
    2e-4 below the ratio, at 0.6 0.3 %, at 0.9 1.6 %. nD: n D [m/s]; s: smoothing.
    """
    square = s.root(nD**4, 0.5 * speed**2 / LIMIT**2 + s.speed**2)  # (n D)^2, never below the speed's own share
    return s.divide(nD * speed, square, 0.0)


def clip(x: Any, lower: Any, upper: Any, width: float, s: Smoothing) -> Any:
    """x held between lower and upper. width: of the blend; s: smoothing."""
    return lower + s.positive(upper - lower - s.positive(upper - x, width), width)


def _cross(v_P: Any, size: Any, linear: Any, growth: Any, s: Smoothing) -> Any:
    """What an inflow v_P' [-] across the propeller adds to 1 - w_P or 1 - t_P."""
    return size * (linear * v_P + (v_P + growth * v_P * s.absolute(v_P, 0.01)) ** 2)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Propeller force [N, N, N m] and slipstream. flow, p, c, s: as in mmg/motion/flow.py."""
    u, nD = flow.u, flow.n * p.D_P
    # held above 3 % of r L: turning about midship has no v' and r' without bound
    U = s.root(u**2 + flow.v**2, s.magnitude(0.03 * p.L * flow.r, s.speed))
    v_P = s.divide(flow.v + c.x_P * p.L * flow.r, U, 0.0)
    J_s = advance_ratio(u, nD, s)
    headway = s.step(u, s.speed)
    open_wake = c.a_0 + c.a_1 * J_s + c.a_2 * J_s**2 + _cross(v_P, c.b_0, c.b_1, c.b_2, s)
    one_minus_w = 1 + headway * (clip(open_wake, 0.0, 1.0, 0.01, s) - 1)
    u_P = u * one_minus_w
    J = J_s * one_minus_w
    deduction = c.c_0 + c.c_1 * J + c.c_2 * J**2 + _cross(v_P, c.d_0, c.d_1, c.d_2, s)
    one_minus_t = 1 + headway * (clip(deduction, 0.0, 1.0, 0.01, s) - 1)
    along = c.k_0 * nD**2 + c.k_1 * nD * u_P + c.k_2 * u_P**2
    against = c.k2_0 * nD**2 + c.k2_1 * nD * u_P + c.k2_2 * u_P**2
    ahead, forward = s.step_or_zero(nD, s.speed), s.step_or_zero(u, s.speed)
    turning_ahead = forward * along + (1 - forward) * against
    turning_astern = -c.k_rev * ((1 - headway) * along + headway * against)  # of the mirrored motion (-u, -n)
    loading = ahead * turning_ahead + (1 - ahead) * turning_astern
    X = p.rho * p.D_P**2 * one_minus_t * loading
    return Force(X, slipstream=Slipstream(one_minus_w, u_P, loading, ahead))

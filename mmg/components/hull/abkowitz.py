"""Abkowitz polynomial about a service speed, propeller and rudder inside: defaults are the Mariner.

Delta u' = (u - U_0)/U, v' = v/U, r' = r L/U, delta; X = 1/2 rho L^2 U^2 X', Y alike, N = 1/2 rho L^3 U^2 N':
X' = X_u u' + X_uu u'^2 + X_uuu u'^3 + X_vv v'^2 + X_rr r'^2 + X_rv r'v' + X_dd delta^2 + X_udd u' delta^2
     + X_vd v' delta + X_uvd u'v' delta                                    (u' written for Delta u')
Y' = Y_v v' + Y_r r' + Y_vvv v'^3 + Y_vvr v'^2 r' + Y_vu v'u' + Y_ru r'u' + Y_d delta + Y_ddd delta^3 + Y_ud u' delta
     + Y_uud u'^2 delta + Y_vdd v' delta^2 + Y_vvd v'^2 delta + Y_0 + Y_0u u' + Y_0uu u'^2,  N' alike.
(Chislett & Stroem-Tejsen 1965, Hy-A report Hy-5, as published with the Marine Systems Simulator of Fossen & Perez;
single lineage of numbers.) Conventions: origin midship; system 1/2 rho L^2 (no draught); the rudder angle is positive
to starboard as everywhere here, so every term odd in delta has the other sign than in print. As in print, m v r, m u r,
m x_G r^2 and m x_G u r are inside X_rv, Y_r, Y_ru, X_rr, N_r, N_ru (Y_r stands for Y_r - m U_0): what the MMG
equations have on the left is added here, so the force is hydrodynamic and the motion that of the printed equations.
m_x, m_y, I_J_z are -X_udot, -Y_vdot and I_z - N_rdot - m x_G^2 in the MMG system (times L/d); Y_rdot and N_vdot are the
cross terms of the added mass, in the MMG system too; the equations of motion read them.

Worth: as tested, at constant revolutions, about U_0; below half of U_0 it is a continuation. There 1/U is held
below 1/(0.4 U_0), and all vanishes at rest, the propeller's push too: take another model to stop or to start.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import Coefficient, table
from mmg.components.hull import polynomial
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "d", "rho", "m", "x_G", "U_0")
INPUTS = ("delta",)
HOLDS = ("propeller", "rudder")  # Roles whose forces are inside the polynomial

LARGEST_DRIFT = polynomial.LARGEST_DRIFT
SOURCE = "Mariner, Chislett & Stroem-Tejsen (1965) Hy-5, as published in MSS; single lineage"
# Share [-] of U_0 below which the speed in 1/U stays constant: this library's choice, as the tests are about U_0.
LOWEST = 0.4  # set by hand

# Derivatives times 1e5, terms odd in delta with the sign of a rudder angle positive to starboard.
_X = {
    "u": -184, "uu": -110, "uuu": -215, "vv": -899, "rr": 18, "rv": 798, "dd": -95, "udd": -190, "vd": -93, "uvd": -93,
}  # fmt: skip
_Y = {
    "v": -1160, "r": -499, "vvv": -8078, "vvr": 15356, "vu": -1160, "ru": -499, "d": -278, "ddd": 90, "ud": -556,
    "uud": -278, "vdd": -4, "vvd": -1190, "0": -4, "0u": -8, "0uu": -4,
}  # fmt: skip
_N = {
    "v": -264, "r": -166, "vvv": 1636, "vvr": -5483, "vu": -264, "ru": -166, "d": 139, "ddd": -45, "ud": 278,
    "uud": 139, "vdd": 13, "vvd": 489, "0": 3, "0u": 6, "0uu": 3,
}  # fmt: skip

_WORDS = {"u": "change of speed", "v": "sway", "r": "yaw", "d": "rudder"}


def _rows(letter: str, what: str, values: dict[str, int]) -> list[tuple]:
    rows = []
    for term, number in values.items():
        value = 1e-5 * number
        words = " x ".join(_WORDS[factor] for factor in term if factor in _WORDS) or "none: asymmetry of one screw"
        size = max(abs(value), 1e-4)  # no prior is narrower than that of a derivative of 10e-5
        row = (f"{letter}_{term}", value, 0.3 * size, value - 3 * size, value + 3 * size, "")
        rows.append((*row, f"{what}, term in {words}; by 1/2 rho L^2 U^2"))
    return rows


COEFFICIENTS: tuple[Coefficient, ...] = table(
    SOURCE,
    *_rows("X", "surge force", _X),
    *_rows("Y", "sway force", _Y),
    *_rows("N", "yaw moment (by L more)", _N),
    ("Y_rdot", 0.0, 0.002, -0.05, 0.05, "mmg", "sway force due to yaw acceleration, by 1/2 rho L^3 d"),
    ("N_vdot", 0.0, 0.002, -0.05, 0.05, "mmg", "yaw moment due to sway acceleration, by 1/2 rho L^3 d"),
)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Force of hull, propeller and rudder together [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    u, v, r, d = flow.u, flow.v, flow.r, flow.delta
    small, U2 = 0.1 * s.speed, u * u + v * v
    lowest = (LOWEST * p.U_0) ** 2
    lack = s.positive(lowest - U2, 0.03 * lowest)
    # 1/U becomes 1/sqrt(U^2 + hold^2): below LOWEST U_0 the sum is (LOWEST U_0)^2
    U, hold = s.root(U2, small), ca.sqrt(lack + small**2)
    U1, v1, r1 = (s.divide(part, U, hold) for part in (u - p.U_0, v, r * p.L))

    factors = {"u": U1, "v": v1, "r": r1, "d": d, "0": 1.0}

    def series(letter: str, terms: Iterable[str]) -> Any:
        return sum(math.prod((factors[f] for f in t), start=getattr(c, f"{letter}_{t}")) for t in terms)

    unit, mass = 0.5 * p.rho * p.L**2, 0.5 * p.rho * p.L**2 * p.d
    # minus what the equations of motion have on the left and the printed derivatives inside: see above
    X = unit * U2 * series("X", _X) - (p.m + c.m_y * mass) * v * r - p.x_G * p.m * r * r
    Y = unit * U2 * series("Y", _Y) + (p.m + c.m_x * mass) * u * r
    N = unit * p.L * U2 * series("N", _N) + p.x_G * p.m * u * r
    return Force(X, Y, N)

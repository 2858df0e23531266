"""Single screw in four quadrants: open-water polynomial ahead, Hachii's effective thrust and side force reversed.

Ahead (n >= 0): X_P = (1 - t_P) rho n^2 D^4 K_T(J), K_T = k_0 + k_1 J + k_2 J^2, with the wake in manoeuvring
  w_P = w_P0 - tau |a| - tau_a a - C_P a^2, a = v' + x_P' r'  (Hirano type), 1 - w_P clipped to (0, 1], 1 for u <= 0.
Reversed (n < 0), J_s = u/(n D): X_P = rho n^2 D^4 (C_6 + C_7 J_s) for J_s >= C_10, else rho n^2 D^4 C_3;
  Y_P = 1/2 rho L d (n D)^2 {A_5 | A_1 + A_2 J_s | A_3 + A_4 J_s} for J_s > -0.06 | between | < -0.35, N_P alike.
Ahead with sternway (n >= 0, u < 0): Y_P = 1/2 rho L d (n P)^2 (A_6 J_s^2 + A_7 J_s + A_8), N_P alike with B.
(Hachii 2004; Ueno's data of a training ship for the second quadrant; as in the public ESSO OSAKA code. A_6..A_8 and
B_6..B_8 are of a single public lineage.) All products with n^2 are multiplied out, so nothing divides by n.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import table
from mmg.components.propeller.wake import ASYMMETRY, HIRANO
from mmg.components.propeller.wake import hirano as wake
from mmg.motion.flow import Flow, Force, Slipstream
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "d", "rho", "D_P", "pitch_ratio")
INPUTS = ("n",)
SIDE_FORCE = True  # The model has a side force of its own (the effect propeller_side_force takes a factor on it)

# Advance ratios J_s [-] of the middle branch of the reversing propeller's side force (Hachii 2004).
ADVANCE_LOW, ADVANCE_HIGH = -0.35, -0.06

# A_1 to A_8 of the side force [-] (Hachii 2004; the last three single lineage).
_A = (-7.90e-5, 7.99e-3, -4.93e-3, -5.87e-3, -5.58e-4, 5.08e-3, 1.70e-3, 9.16e-4)
# B_1 to B_8 of the yaw moment [-], as A.
_B = (3.50e-5, -3.17e-3, 1.96e-3, 2.33e-3, 2.25e-4, -2.16e-3, 6.27e-5, 6.25e-5)


def _side(letter: str, values: tuple[float, ...], bound: float, what: str) -> list[tuple]:
    return [
        (f"{letter}_{i}", value, max(0.3 * abs(value), 2e-4), -bound, bound, "", f"{what}, term {i}")
        for i, value in enumerate(values, start=1)
    ]


COEFFICIENTS = (
    table(
        "default of the four-quadrant propeller model",
        ("k_0", 0.32, 0.032, 0.05, 0.8, "", "open-water thrust, constant"),
        ("k_1", -0.33, 0.05, -1.0, 0.2, "", "open-water thrust, linear in J"),
        ("k_2", -0.15, 0.045, -1.0, 0.5, "", "open-water thrust, quadratic in J"),
        ("t_P", 0.20, 0.05, 0.0, 0.5, "", "thrust deduction fraction"),
        *HIRANO,
        ("C_3", -0.251, 0.05, -1.0, 0.0, "", "effective reverse thrust at strongly negative advance ratio"),
        ("C_6", -0.175, 0.04, -1.0, 0.0, "", "effective reverse thrust at zero speed"),
        ("C_7", 0.330, 0.10, 0.0, 1.0, "", "slope of the effective reverse thrust with J_s"),
        ("C_10", -0.233, 0.05, -0.6, -0.05, "", "advance ratio at which the reverse thrust levels off"),
        *_side("A", _A, 0.05, "side force of the reversing propeller or in sternway"),
        *_side("B", _B, 0.02, "yaw moment of the reversing propeller or in sternway"),
    )
    + ASYMMETRY
)


def _below(u: Any, nD: Any, advance: Any, s: Smoothing) -> Any:
    """Weight of J_s < ``advance`` (negative) for a reversing propeller, without dividing by n.

    For n < 0, J_s = u/(nD) < J* is the same as u - J* nD > 0, linear in u and n. Blended over 0.02 in J_s.
    """
    return s.step(u - advance * nD, s.magnitude(0.02 * nD, 0.2 * s.speed))


def _side_force(u: Any, nD: Any, k: tuple[Any, ...], p: SimpleNamespace, ahead: Any, s: Smoothing) -> Any:
    """(n D)^2 times the side-force or moment polynomial [m^2/s^2]."""
    n2, n1 = nD * nD, nD * u  # (n D)^2, and J_s (n D)^2
    low, high = _below(u, nD, ADVANCE_LOW, s), _below(u, nD, ADVANCE_HIGH, s)
    middle = k[0] * n2 + k[1] * n1
    reversed_ = (1 - high) * k[4] * n2 + (high - low) * middle + low * (k[2] * n2 + k[3] * n1)
    # (n P)^2 (A_6 J_s^2 + A_7 J_s + A_8) with P = pitch_ratio D
    sternway = p.pitch_ratio**2 * (k[5] * u * u + k[6] * n1 + k[7] * n2)
    headway = s.step_or_zero(u, s.speed)
    return ahead * (1 - headway) * sternway + (1 - ahead) * reversed_


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Propeller force [N, N, N m] and slipstream. flow, p, c, s: as in mmg/motion/flow.py."""
    u, nD = flow.u, flow.n * p.D_P
    ahead = s.step_or_zero(nD, s.speed)
    one_minus_w = wake(flow, p, c, s)
    u_P = u * one_minus_w
    loading_ahead = c.k_0 * nD**2 + c.k_1 * nD * u_P + c.k_2 * u_P**2
    weak = 1 - _below(u, nD, c.C_10, s)
    loading_reversed = weak * (c.C_6 * nD**2 + c.C_7 * nD * u) + (1 - weak) * c.C_3 * nD**2
    area = p.rho * p.D_P**2  # rho n^2 D^4 K is area times (n D)^2 K
    X = area * (
        ahead * (1 - c.t_P) * loading_ahead + (1 - ahead) * loading_reversed
    )  # reversed t_P is inside C_3 to C_7
    A, B = (tuple(getattr(c, f"{letter}_{i}") for i in range(1, 9)) for letter in "AB")
    unit = 0.5 * p.rho * p.L * p.d
    Y = unit * _side_force(u, nD, A, p, ahead, s)
    N = unit * p.L * _side_force(u, nD, B, p, ahead, s)
    loading = ahead * loading_ahead + (1 - ahead) * loading_reversed
    return Force(X, Y, N, Slipstream(one_minus_w, u_P, loading, ahead))

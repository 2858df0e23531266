"""Propeller and VecTwin rudders read branch by branch in plain Python, for n > 0 and headway: an independent check.

Written from the description in words (Kang et al. 2008 as in a public code, x_H' put right), not from the model.
"""

from __future__ import annotations

import math
from types import SimpleNamespace


def _quadratic(c: SimpleNamespace, name: str, slip: float) -> float:
    return getattr(c, f"{name}_0") + getattr(c, f"{name}_1") * slip + getattr(c, f"{name}_2") * slip**2


def _clip(x: float, lower: float, upper: float) -> float:
    return min(max(x, lower), upper)


def propeller(u: float, v: float, r: float, n: float, p: SimpleNamespace, c: SimpleNamespace) -> tuple[float, ...]:
    """X_P [N], 1 - w_P, J and K_T."""
    U = math.hypot(u, v)
    across = v / U + c.x_P * r * p.L / U
    J_s = u / (n * p.D_P)
    wake = c.a_0 + c.a_1 * J_s + c.a_2 * J_s**2
    wake += c.b_0 * (c.b_1 * across + (across + c.b_2 * across * abs(across)) ** 2)
    wake = _clip(wake, 0.0, 1.0)
    J = J_s * wake
    deduction = c.c_0 + c.c_1 * J + c.c_2 * J**2
    deduction += c.d_0 * (c.d_1 * across + (across + c.d_2 * across * abs(across)) ** 2)
    deduction = _clip(deduction, 0.0, 1.0)
    K_T = c.k_0 + c.k_1 * J + c.k_2 * J**2
    return deduction * p.rho * n**2 * p.D_P**4 * K_T, wake, J, K_T


def rudders(
    motion: tuple[float, float, float, float], deltas: dict[str, float], p: SimpleNamespace, c: SimpleNamespace
) -> tuple[float, float, float]:
    """X_R, Y_R [N], N_R [N m]; deltas by "s" and "p" [rad]; needs K_T > 0."""
    u, v, r, n = motion
    _, wake, J, K_T = propeller(u, v, r, n, p, c)
    u_P = u * wake
    slip = _clip(1 - u_P / (n * p.D_P * p.pitch_ratio), 0.0, 1.2)
    beta = math.atan2(-v, u)
    eta = p.D_P / math.sqrt(p.A_R * p.aspect_ratio)
    X = lateral = 0.0
    for side, other in (("s", "p"), ("p", "s")):
        delta, opposite = deltas[side], deltas[other]
        first = delta - (getattr(c, f"b{side}_0") + getattr(c, f"b{side}_1") * slip)
        turn = _quadratic(c, "d" + side, slip) * opposite + _quadratic(c, "e" + side, slip) * opposite**2
        if (first > 0) if side == "s" else (first < 0):
            turn *= abs(math.cos(first))
        angle = first - turn
        a = [getattr(c, f"a{side}_{i}") for i in range(4)]
        rudder_wake = a[0] + a[1] * delta + a[2] * delta**2 + a[3] * delta**3
        eps = rudder_wake / wake
        kappa = c.k_x / eps
        jet = math.sqrt(u_P**2 + 8 * K_T * n**2 * p.D_P**2 / math.pi) - u_P
        u_R = eps * math.sqrt(eta * (u_P + kappa * jet) ** 2 + (1 - eta) * u_P**2)
        if (angle > 0) if side == "s" else (angle < 0):
            g, h, k = (_quadratic(c, letter + side, slip) for letter in "ghk")
            u_R *= min(1.0, g + h * angle + k * angle**2)
        i = {(True, True): 0, (True, False): 8, (False, True): 4, (False, False): 12}[beta >= 0, angle < 0]
        r_ = [getattr(c, f"r{side}_{i + j}") for j in range(4)]
        gamma = (r_[0] + r_[1] * abs(beta) + (r_[2] + r_[3] * abs(beta)) * angle) * abs(beta)
        gamma = _clip(gamma, 0.0, 1.0 if (side, i) in (("s", 12), ("p", 0)) else 0.8)
        j = {(True, True): 0, (True, False): 1, (False, True): 2, (False, False): 3}[r >= 0, angle >= 0]
        v_R = -gamma * v - getattr(c, f"C{side}_{j}") * p.x_R * r
        attack = angle - math.atan2(v_R, u_R)
        if abs(attack) <= 0.65450:
            C_N = 2.6252 * math.sin(attack)
        else:
            C_N = math.copysign(-0.8449 * attack**2 + 2.0621 * abs(attack) + 0.6387, attack)
        F_N = 0.5 * p.rho * p.A_R * C_N * (u_R**2 + v_R**2)
        X -= F_N * math.sin(delta)
        lateral += F_N * math.cos(delta)
    t_R = c.e_0 + c.e_1 * J + c.e_2 * J**2
    a_H = _clip(c.f_0 + c.f_1 * J + c.f_2 * J**2, 0.016, 0.60556)
    x_H = _clip(c.g_0 + c.g_1 * J + c.g_2 * J**2, -0.4344, -0.159)
    return (1 - t_R) * X, -(1 + a_H) * lateral, -(p.x_R + a_H * x_H * p.L) * lateral

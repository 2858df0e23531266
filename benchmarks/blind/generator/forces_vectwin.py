"""Forces of a ship with one propeller, two VecTwin rudders and a bow thruster; the third force model.

Hull: the unified low-speed model with its cross-flow integrals in closed form; propeller and rudders: Kang et al.
(2008) and Hasegawa et al. (2006); bow thruster: Kobayashi (1988). As published the flow straightening jumps where the
effective rudder angle changes sign; it may instead pass over some angle (particular ``soft``, 0: jump).
The same signatures as ``forces``; the rudder angles are m.delta (starboard) and m.port, the inflow of the rudders is
that of starboard and port together.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.forces import Array, Force, Moment, Numbers, wind, wind_series

__all__ = ["hull", "propeller", "rudder", "rudder_inflow", "thruster", "wake", "wind", "wind_series"]

GRAVITY = 9.80665
STALL = 0.6545
"""Angle of attack [rad] from which the normal force is a parabola of it, up to the same angle from astern."""
Inflow = tuple[Array, Array, Array]


def _integrals(v: Array, b: Array) -> tuple[Array, Array]:
    """Integrals of |w| w and |w| w xi, w = v + b xi, over xi from -1/2 to 1/2, from their antiderivatives."""
    turning = np.abs(b) > 1e-7 * np.abs(v) + 1e-12
    safe = np.where(turning, b, 1.0)
    ends = v + 0.5 * safe, v - 0.5 * safe
    cubic, quartic = (np.abs(w) ** 3 / 3 for w in ends), (np.sign(w) * w**4 / 4 - v * np.abs(w) ** 3 / 3 for w in ends)
    (a_1, a_0), (b_1, b_0) = cubic, quartic
    return (
        np.where(turning, (a_1 - a_0) / safe, v * np.abs(v)),
        np.where(turning, (b_1 - b_0) / safe**2, np.abs(v) * b / 6),
    )


def hull(m: Moment, p: Numbers, c: Numbers) -> Force:
    """Hull force of Yoshimura, Nakao & Ishibashi (2009)."""
    u, v, rL = m.u, m.v, m.r * p["L"]
    unit = 0.5 * p["rho"] * p["L"] * p["d"]
    astern = np.abs(np.arctan2(v, u)) / np.pi
    X = (c["X_0F"] + (c["X_0A"] - c["X_0F"]) * astern) * u * np.hypot(u, v) + c["X_vr"] * v * rL
    I_Y, _ = _integrals(v, c["C_rY"] * rL)
    _, I_N = _integrals(v, c["C_rN"] * rL)
    Y = c["Y_v"] * v * np.abs(u) + c["Y_r"] * rL * u - c["C_D"] * I_Y
    N = c["N_v"] * v * u + c["N_r"] * rL * np.abs(u) - c["C_D"] * I_N
    return unit * X, unit * Y, unit * p["L"] * N


def _ratio(speed: Array, nD: Array) -> Array:
    """speed / (n D), 0 at n = 0."""
    return np.where(nD != 0, speed / np.where(nD != 0, nD, 1.0), 0.0)


def _quadratic(c: Numbers, name: str, x: Array) -> Array:
    return c[f"{name}_0"] + c[f"{name}_1"] * x + c[f"{name}_2"] * x * x


def _inflow_part(m: Moment, letter: str, p: Numbers, c: Numbers) -> Array:
    """Change of wake (b) or thrust deduction (d) with the inflow angle at the propeller."""
    U = np.hypot(m.u, m.v)
    angle = np.where(U > 0, (m.v + c["x_P"] * p["L"] * m.r) / np.where(U > 0, U, 1.0), 0.0)
    bent = angle + c[f"{letter}_2"] * angle * np.abs(angle)
    return c[f"{letter}_0"] * (c[f"{letter}_1"] * angle + bent**2)


def wake(m: Moment, p: Numbers, c: Numbers) -> Array:
    """1 - w_P, within [0, 1]; 1 with sternway."""
    open_ = _quadratic(c, "a", _ratio(m.u, m.n * p["D_P"])) + _inflow_part(m, "b", p, c)
    return np.where(m.u > 0, np.clip(open_, 0.0, 1.0), 1.0)


def propeller(m: Moment, one_minus_w: Array, p: Numbers, c: Numbers) -> tuple[Force, Array]:
    """Thrust less its deduction, and n^2 D^2 K_T [m^2/s^2]; reversed as the mirrored motion, less by k_rev."""
    nD, u_P = m.n * p["D_P"], m.u * one_minus_w
    share = _quadratic(c, "c", _ratio(u_P, nD)) + _inflow_part(m, "d", p, c)
    one_minus_t = np.where(m.u > 0, np.clip(share, 0.0, 1.0), 1.0)
    along, against = (c[f"{k}_0"] * nD**2 + c[f"{k}_1"] * nD * u_P + c[f"{k}_2"] * u_P**2 for k in ("k", "k2"))
    reversed_ = -c["k_rev"] * np.where(m.u > 0, against, along)
    loading = np.where(nD >= 0, np.where(m.u >= 0, along, against), reversed_)
    X = p["rho"] * p["D_P"] ** 2 * one_minus_t * loading
    return (X, 0.0 * X, 0.0 * X), loading


def rudder_inflow(m: Moment, one_minus_w: Array, loading: Array, p: Numbers, c: Numbers) -> tuple[Inflow, Inflow]:
    """u_R, v_R [m/s] and the effective angle [rad] of the starboard rudder, and of the port one."""
    u_P = m.u * one_minus_w
    slip = np.clip(1 - _ratio(u_P, m.n * p["D_P"]) / p["pitch_ratio"], 0.0, 1.2)
    jet = np.sqrt(u_P**2 + 8 / np.pi * np.maximum(loading, 0.0)) - np.abs(u_P)
    eta = p["D_P"] / np.sqrt(p["A_R"] * p["aspect_ratio"])
    port = np.asarray(m.port)
    return (
        _one_inflow("s", 1.0, m.delta, port, (slip, jet, eta), m, p, c),
        _one_inflow("p", -1.0, port, m.delta, (slip, jet, eta), m, p, c),
    )


def _positive(angle: Array, soft: float) -> Array:
    """1 from zero on and 0 below; with ``soft`` [rad] a smooth ramp of that length below zero."""
    if soft == 0:
        return (angle >= 0).astype(float)
    s = np.clip(1 + angle / soft, 0.0, 1.0)
    return s * s * (3 - 2 * s)


def _one_inflow(
    side: str, outward: float, own: Array, other: Array, wash: tuple[Array, Array, Any], m: Moment, p: Numbers, c: Any
) -> Inflow:
    slip, jet, eta = wash
    own_turned = own - (c[f"b{side}_0"] + c[f"b{side}_1"] * slip)
    across = _quadratic(c, f"d{side}", slip) * other + _quadratic(c, f"e{side}", slip) * other**2
    angle = own_turned - across * np.where(outward * own_turned > 0, np.abs(np.cos(own_turned)), 1.0)
    free = m.u * sum(c[f"a{side}_{i}"] * own**i for i in range(4))
    washed = free + c["k_x"] * jet
    q = eta * washed * np.abs(washed) + (1 - eta) * free * np.abs(free)
    kept = sum(_quadratic(c, f"{letter}{side}", slip) * angle**i for i, letter in enumerate("ghk"))
    slowed = np.where(outward * angle > 0, np.minimum(kept, 1.0), 1.0)
    u_R = slowed * np.sign(q) * np.sqrt(np.abs(q))
    beta, starboard, positive = np.abs(np.arctan2(m.v, m.u)), m.v > 0, _positive(angle, p["soft"])
    gamma = np.zeros_like(angle)
    for i, (to_starboard, turned) in zip((0, 4, 8, 12), ((0, 0), (1, 0), (0, 1), (1, 1)), strict=True):
        r = [c[f"r{side}_{i + j}"] for j in range(4)]
        found = c["k_gamma"] * (r[0] + r[1] * beta + (r[2] + r[3] * beta) * angle) * beta
        most = 1.0 if i == (12 if side == "s" else 0) else 0.8
        share = positive if turned else 1 - positive
        gamma = gamma + (starboard == to_starboard) * share * np.clip(found, 0.0, most)
    C = [c[f"C{side}_{j}"] for j in range(4)]
    one, other = (positive * C[j] + (1 - positive) * C[j + 1] for j in (0, 2))
    lever = np.where(m.r >= 0, one, other) * p["x_R"]
    return u_R, -gamma * m.v - lever * m.r, angle


def _normal(alpha: Array) -> Array:
    """C_N of the fish-tail section by the angle of attack (-pi, pi]: sine, parabola, and a smaller sine from astern."""
    size = np.abs(alpha)

    def parabola(x: Any) -> Any:
        return 0.6387 + 2.0621 * x - 0.8449 * x * x

    back = parabola(np.pi - STALL) / np.sin(STALL)
    outer = np.where(size > np.pi - STALL, back * np.sin(size), parabola(size))
    return np.sign(alpha) * np.where(size < STALL, 2.6252 * np.sin(size), outer)


def rudder(m: Moment, inflow: tuple[Inflow, Inflow], p: Numbers, c: Numbers) -> tuple[Force, Array]:
    """Force of both rudders with its effect on the hull, and the inflow angle of the starboard one [rad]."""
    J = _ratio(m.u_P, m.n * p["D_P"])
    t_R = _quadratic(c, "e", J)
    a_H = np.clip(_quadratic(c, "f", J), 0.016, 0.60556)
    x_H = np.clip(_quadratic(c, "g", J), -0.4344, -0.159)
    strength = 0.5 * p["rho"] * p["A_R"] * c["k_N"] * np.where(m.u >= 0, 1.0, c["k_A"])
    along, across, angles = 0.0, 0.0, []
    for (u_R, v_R, angle), delta in zip(inflow, (m.delta, m.port), strict=True):
        alpha = np.angle(np.exp(1j * (angle - np.arctan2(v_R, u_R))))
        F_N = strength * (u_R**2 + v_R**2) * _normal(alpha)
        along, across = along + F_N * np.sin(delta), across + F_N * np.cos(delta)
        angles.append(alpha)
    lever = p["x_R"] + a_H * x_H * p["L"]
    return (-(1 - t_R) * along, -(1 + a_H) * across, -lever * across), angles[0]


def thruster(m: Moment, p: Numbers, c: Numbers) -> Force:
    """Side force and moment of the bow thruster, which lose with speed up to the minimum of their parabolas."""
    K_T = np.where(m.bow >= 0, c["K_TP_BT"], c["K_TN_BT"])
    T = p["rho"] * p["D_BT"] ** 4 * m.bow**2 * K_T * (np.abs(m.u) < c["u_max_BT"])
    Fr = np.abs(m.u) / np.sqrt(GRAVITY * p["L"])
    left = []
    for axis in "YN":
        a = [c[f"a_{axis}{i}_BT"] for i in range(3)]
        at = np.minimum(Fr, np.where(a[2] > 0, -0.5 * a[1] / np.where(a[2] > 0, a[2], 1.0), np.inf))
        left.append(1 + a[0] + a[1] * at + a[2] * at * at)
    return 0.0 * T, left[0] * T, left[1] * p["x_BT"] * T

"""Forces of the ESSO OSAKA 3 m ship in numpy, with the published branches, for a batch of runs at once.

Hull: unified low-speed model (Yoshimura, Nakao & Ishibashi 2009); propeller: open-water polynomial ahead, Hachii (2004)
reversed; rudder: Yasukawa & Yoshimura (2015) with Yoshimura's low-speed inflow and Kitagawa's (2015) reversed flow;
wind: Fujiwara, Ueno & Nimura (1998). All arrays have one entry per run; forces are X, Y [N] and N [N m] about midship.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray
Force = tuple[Any, Any, Any]
Numbers = Mapping[str, Any]

POINTS = 32
"""Stations of the cross-flow quadrature along the ship."""
_GAUSS = np.polynomial.legendre.leggauss(POINTS)
_XI: Array = 0.5 * np.asarray(_GAUSS[0])[:, None]
_WEIGHT: Array = 0.5 * np.asarray(_GAUSS[1])


@dataclass
class Moment:
    """Where the runs are and what acts on them at one instant.

    u, v, r: velocity through the water [m/s, rad/s]; x, y, psi: place and heading [m, rad]; n, delta: real revolutions
    [1/s] and rudder angle [rad]; a_x, a_y: air relative to the ship [m/s]; t: time since the start of the run [s];
    alpha: inflow angle at the rudder [rad], once the rudder has been evaluated; u_P: inflow speed of the propeller;
    port: angle of the port rudder of two [rad], delta being the starboard one; bow: revolutions of a bow thruster.
    """

    x: Array
    y: Array
    psi: Array
    u: Array
    v: Array
    r: Array
    n: Array
    delta: Array
    a_x: Array
    a_y: Array
    t: Array
    alpha: Any = 0.0
    u_P: Any = 0.0
    port: Any = 0.0
    bow: Any = 0.0


def hull(m: Moment, p: Numbers, c: Numbers) -> Force:
    """Hull force; the cross-flow integrals by Gauss-Legendre quadrature of their kinked integrand."""
    u, v, r, L = m.u, m.v, m.r, p["L"]
    unit = 0.5 * p["rho"] * L * p["d"]
    astern = np.abs(np.arctan2(v, u)) / np.pi
    X = (c["X_0F"] + (c["X_0A"] - c["X_0F"]) * astern) * u * np.hypot(u, v) + c["X_vr"] * L * v * r
    across_Y = v + _XI * (c["C_rY"] * r * L)
    across_N = v + _XI * (c["C_rN"] * r * L)
    I_Y = _WEIGHT @ (np.abs(across_Y) * across_Y)
    I_N = (_WEIGHT * _XI[:, 0]) @ (np.abs(across_N) * across_N)
    Y = c["Y_v"] * v * np.abs(u) + c["Y_r"] * L * r * u - c["C_D"] * I_Y
    N = c["N_v"] * v * u + c["N_r"] * L * r * np.abs(u) - c["C_D"] * I_N
    return unit * X, unit * Y, unit * L * N


def wake(m: Moment, p: Numbers, c: Numbers) -> Array:
    """1 - w_P of Hirano's type, within (0, 1]; 1 with sternway."""
    U = np.hypot(m.u, m.v)
    angle = np.where(U > 0, (m.v + c["x_P"] * p["L"] * m.r) / np.maximum(U, 1e-12), 0.0)
    ahead = 1 - c["w_P0"] + c["tau"] * np.abs(angle) + c["C_P"] * angle * angle
    return np.where(m.u > 0, np.clip(ahead, 1e-9, 1.0), 1.0)


def _side(m: Moment, nD: Array, letter: str, p: Numbers, c: Numbers) -> Array:
    """Side force or moment of the propeller, by (1/2 rho L d) or (1/2 rho L^2 d) [m^2/s^2]."""
    k = [c[f"{letter}_{i}"] for i in range(1, 9)]
    n2, n1 = nD * nD, nD * m.u
    low, high = m.u > -0.35 * nD, m.u > -0.06 * nD
    middle = np.where(high, k[0] * n2 + k[1] * n1, k[4] * n2)
    reversed_ = np.where(low, k[2] * n2 + k[3] * n1, middle)
    sternway = p["pitch_ratio"] ** 2 * (k[5] * m.u**2 + k[6] * n1 + k[7] * n2)
    return np.where(nD >= 0, np.where(m.u < 0, sternway, 0.0), reversed_)


def propeller(m: Moment, one_minus_w: Array, p: Numbers, c: Numbers) -> tuple[Force, Array]:
    """Propeller force, and n^2 D^2 K_T [m^2/s^2] (open water ahead, effective reversed)."""
    D = p["D_P"]
    nD, u_P = m.n * D, m.u * one_minus_w
    ahead = c["k_0"] * nD**2 + c["k_1"] * nD * u_P + c["k_2"] * u_P**2
    weak = m.u <= c["C_10"] * nD
    reversed_ = np.where(weak, c["C_6"] * nD**2 + c["C_7"] * nD * m.u, c["C_3"] * nD**2)
    loading = np.where(m.n >= 0, ahead, reversed_)
    X = p["rho"] * D**2 * np.where(m.n >= 0, 1 - c["t_P"], 1.0) * loading
    unit = 0.5 * p["rho"] * p["L"] * p["d"]
    return (X, unit * _side(m, nD, "A", p, c), unit * p["L"] * _side(m, nD, "B", p, c)), loading


def rudder_inflow(m: Moment, one_minus_w: Array, loading: Array, p: Numbers, c: Numbers) -> Array:
    """Longitudinal inflow speed u_R at the rudder [m/s]."""
    u_P, eps = m.u * one_minus_w, c["epsilon"]
    eta = p["D_P"] / np.sqrt(p["A_R"] * p["aspect_ratio"])
    jet = np.sqrt(u_P**2 + 8 / np.pi * np.maximum(loading, 0.0)) - u_P
    pulled = eps * np.sqrt(eta * (u_P + c["k_x"] / eps * jet) ** 2 + (1 - eta) * u_P**2)
    u_2 = u_P * eps
    u_1 = u_2 + np.sign(m.n) * c["k_xR"] * np.sqrt(8 / np.pi * np.abs(loading))
    q = eta * np.sign(u_1) * u_1**2 + (1 - eta) * u_2**2 + c["C_PR"] * m.u**2
    otherwise = np.where(m.u >= 0, np.sign(q) * np.sqrt(np.abs(q)), m.u)
    return np.where((m.n >= 0) & (loading > 0), pulled, otherwise)


def rudder(m: Moment, u_R: Array, p: Numbers, c: Numbers) -> tuple[Force, Array]:
    """Rudder force with its effect on the hull, and the inflow angle alpha_R [rad]."""
    to_starboard: Array = m.v + p["x_R"] * m.r > 0
    gamma = np.where(to_starboard, np.asarray(c["gamma_P"]), c["gamma_N"])
    v_R = -gamma * (m.v + c["ell_R"] * p["L"] * m.r)
    sine, cosine = np.sin(m.delta), np.cos(m.delta)
    along, across = u_R * cosine + v_R * sine, u_R * sine - v_R * cosine
    f_alpha = 6.13 * p["aspect_ratio"] / (p["aspect_ratio"] + 2.25)
    F_N = 0.5 * p["rho"] * p["A_R"] * f_alpha * np.hypot(u_R, v_R) * across
    N = -(p["x_R"] + c["a_H"] * c["x_H"] * p["L"]) * F_N * cosine
    return (-(1 - c["t_R"]) * F_N * sine, -(1 + c["a_H"]) * F_N * cosine, N), np.arctan2(across, along)


def wind_series(p: Mapping[str, float]) -> dict[str, float]:
    """The ten coefficients of Fujiwara et al. (1998) from the particulars of the upper works."""
    L, B, A_T, A_L, A_OD = p["L"], p["B"], p["A_T"], p["A_L"], p["A_OD"]
    C, C_BR, H_BR, H_C = p["C"], p["C_BR"], p["H_BR"], p["H_C"]
    X_1 = -1.353 + 1.7 * A_L / (L * B) + 2.87 * L * H_C / A_L - 0.463 * L * H_BR / A_L - 0.57 * A_OD / A_L
    X_3 = 0.83 - 0.413 * A_L / (L * H_BR) - 0.0827 * A_L / A_T - 0.563 * L * H_C / A_L + 0.804 * A_OD / A_L
    Y_1 = 0.684 + 0.717 * C_BR / L - 3.22 * C / L + 0.0281 * A_L / A_OD + 0.0661 * C / H_C
    Y_3 = -0.4 + 0.282 * A_L / (L * B) + 0.307 * L * H_C / A_L + 0.0519 * C_BR / L + 0.0526 * B / H_BR
    Y_5 = 0.122 - 0.166 * A_L / (L * B) - 0.0054 * L / H_BR - 0.0481 * C_BR / L - 0.0136 * B**2 / A_T
    N_1 = 0.299 + 1.71 * C / L + 0.183 * L * H_C / A_L - 1.09 * A_T / A_L - 0.0442 * C / H_C
    N_2 = 0.117 + 0.123 * C_BR / L - 0.323 * C / L + 0.0041 * A_L / A_OD - 0.166 * A_T / B**2
    return {
        "X_0": -0.33 + 0.293 * B * H_BR / A_T + 0.0193 * C / H_C + 0.682 * A_OD / L**2,
        "X_1": X_1 - 6.64 * A_T / (L * B) - 0.0123 * L**2 / A_T + 0.0202 * L / H_C,
        "X_3": X_3 - 5.67 * A_OD / L**2 + 0.0401 * C / H_C - 0.132 * C_BR / L,
        "X_5": 0.0372 - 0.0075 * A_L / A_OD - 0.103 * C_BR / L + 0.0921 * A_L / (L * B),
        "Y_1": Y_1 + 0.298 * A_T / (B * H_BR),
        "Y_3": Y_3 - 0.0814 * A_OD / A_L + 0.0582 * A_T / (B * H_BR),
        "Y_5": Y_5 + 0.0864 * C / L - 0.0297 * C * H_C / A_L,
        "N_1": N_1 - 0.289 * A_L / (L * B) + 4.24 * A_T / L**2 - 0.0646 * B**2 / A_T + 0.0306 * C_BR / L,
        "N_2": N_2 - 0.0109 * L / H_BR + 0.174 * A_T / (B * H_BR) + 0.214 * A_L / (L * B) - 1.06 * A_L / L**2,
        "N_3": 0.023 + 0.0385 * C_BR / L - 0.0339 * A_T / (B * H_BR) + 0.0023 * A_L / A_T,
    }


def wind(m: Moment, p: Numbers, k: Mapping[str, float]) -> Force:
    """Wind force of the air relative to the ship; k: coefficients of ``wind_series``."""
    angle = np.arctan2(m.a_y, -m.a_x)
    pressure = 0.5 * p["rho_a"] * (m.a_x**2 + m.a_y**2)
    C_X = k["X_0"] + k["X_1"] * np.cos(angle) + k["X_3"] * np.cos(3 * angle) + k["X_5"] * np.cos(5 * angle)
    C_Y = k["Y_1"] * np.sin(angle) + k["Y_3"] * np.sin(3 * angle) + k["Y_5"] * np.sin(5 * angle)
    C_N = k["N_1"] * np.sin(angle) + k["N_2"] * np.sin(2 * angle) + k["N_3"] * np.sin(3 * angle)
    return pressure * p["A_T"] * C_X, pressure * p["A_L"] * C_Y, pressure * p["A_L"] * p["L"] * C_N

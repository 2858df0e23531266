"""Forces of a ship by the standard method of Yasukawa & Yoshimura (2015), ahead only; the second force model.

The same signatures as ``forces``, so that the effects act on either.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.blind.generator.forces import Array, Force, Moment, Numbers


def hull(m: Moment, p: Numbers, c: Numbers) -> Force:
    """Third-order polynomials of v' and r' (Eq. 7), R_0' in straight motion."""
    U = np.maximum(np.hypot(m.u, m.v), 1e-6)
    v, r = m.v / U, m.r * p["L"] / U
    unit = 0.5 * p["rho"] * p["L"] * p["d"] * U * U
    X = -c["R_0"] + c["X_vv"] * v**2 + c["X_vr"] * v * r + c["X_rr"] * r**2 + c["X_vvvv"] * v**4
    cubic = [v, r, v**3, v * v * r, v * r * r, r**3]
    Y, N = (
        sum(c[f"{axis}_{s}"] * term for s, term in zip(("v", "r", "vvv", "vvr", "vrr", "rrr"), cubic, strict=True))
        for axis in "YN"
    )
    return unit * X, unit * Y, unit * p["L"] * N


def wake(m: Moment, p: Numbers, c: Numbers) -> Array:
    """1 - w_P (Eq. 16), by the drift angle at the propeller."""
    U = np.maximum(np.hypot(m.u, m.v), 1e-6)
    beta = np.arctan2(-m.v, m.u) - c["x_P"] * m.r * p["L"] / U
    C_2: Array = np.where(beta > 0, np.asarray(c["C_2_plus"]), c["C_2_minus"])
    return (1 - c["w_P0"]) * (1 + (1 - np.exp(-c["C_1"] * np.abs(beta))) * (C_2 - 1))


def propeller(m: Moment, one_minus_w: Array, p: Numbers, c: Numbers) -> tuple[Force, Array]:
    """Thrust less its deduction (Eq. 9 to 11), and n^2 D^2 K_T [m^2/s^2]."""
    nD, u_P = m.n * p["D_P"], m.u * one_minus_w
    loading = c["k_0"] * nD**2 + c["k_1"] * nD * u_P + c["k_2"] * u_P**2
    X = (1 - c["t_P"]) * p["rho"] * p["D_P"] ** 2 * loading
    return (X, 0.0 * X, 0.0 * X), loading


def rudder_inflow(m: Moment, one_minus_w: Array, loading: Array, p: Numbers, c: Numbers) -> Array:
    """Longitudinal inflow speed u_R [m/s] (Eq. 23), the jet from the momentum of the thrust."""
    u_P = np.maximum(m.u * one_minus_w, 1e-6)
    eta = p["D_P"] / np.sqrt(p["A_R"] * p["aspect_ratio"])
    jet = np.sqrt(np.maximum(u_P**2 + 8 / np.pi * loading, 0.0)) / u_P - 1
    return c["epsilon"] * u_P * np.sqrt(eta * (1 + c["kappa"] * jet) ** 2 + 1 - eta)


def rudder(m: Moment, u_R: Array, p: Numbers, c: Numbers) -> tuple[Force, Array]:
    """Rudder force with its effect on the hull (Eq. 18 to 22), and the inflow angle alpha_R [rad]."""
    side = m.v + c["ell_R"] * p["L"] * m.r
    gamma: Array = np.where(side < 0, np.asarray(c["gamma_R_plus"]), c["gamma_R_minus"])  # beta_R = -side / U
    v_R = -gamma * side
    alpha = m.delta - np.arctan2(v_R, u_R)
    F_N = 0.5 * p["rho"] * p["A_R"] * (u_R**2 + v_R**2) * c["f_alpha"] * np.sin(alpha)
    lever = p["x_R"] + c["a_H"] * c["x_H"] * p["L"]
    X, Y = -(1 - c["t_R"]) * F_N * np.sin(m.delta), -(1 + c["a_H"]) * F_N * np.cos(m.delta)
    return (X, Y, -lever * F_N * np.cos(m.delta)), alpha


def wind_series(p: Mapping[str, float]) -> dict[str, float]:
    """No wind force is known of this ship."""
    return {}


def wind(m: Moment, p: Numbers, k: Mapping[str, float]) -> Force:
    """None."""
    zero = 0.0 * m.u
    return zero, zero, zero

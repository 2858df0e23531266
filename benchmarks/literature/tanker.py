"""Esso tanker of 190 000 tdw, L = 304.8 m, in deep water: van Berlekom & Goddard (1972), SNAME Transactions 80:264-298.

Equations and coefficients (appendix A, bis system: forces by mass, lengths by L) as published with the Marine Systems
Simulator (Fossen & Perez); single lineage. The rudder is positive to starboard here, to port in
print. The shallow-water terms are in ``SHALLOW``.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from benchmarks.literature.plants import Plant

LENGTH, DRAUGHT = 304.8, 18.46
C = SimpleNamespace(
    t=0.22, c_un=0.605, c_nn=38.2, T_uu=-0.00695, T_un=-0.00063, T_nn=0.0000354,
    m_u=1.050, m_v=2.020, m_r=0.1232, X_vr=2.020, Y_ur=-0.752, N_ur=-0.231,
    X_uu=-0.0377, X_vv=0.3, X_ccdd=-0.093, X_ccbd=0.152,
    Y_T=0.04, Y_vv=-2.400, Y_uv=-1.205, Y_ccd=0.208, Y_ccbbd=-2.16,
    N_T=-0.02, N_vr=-0.300, N_uv=-0.451, N_ccd=-0.098, N_ccbbd=0.688,
)  # fmt: skip
"""Coefficients in deep water."""

SHALLOW = {"Y_vdot": (1.020, 0.387), "N_uv": (0.451, 0.241), "N_ur": (0.231, 0.047), "Y_vv": (2.4, 1.5)}
"""Size in deep water, and its growth by zeta = d / (h - d). Y_uv: -1.205, and -0.85 (zeta - 0.8) beyond zeta = 0.8."""


def growth(ratio: float) -> dict[str, float]:
    """Factors on the tanker's coefficients at a depth of ``ratio`` draughts."""
    zeta = 1 / (ratio - 1)
    factors = {name: 1 + more * zeta / deep for name, (deep, more) in SHALLOW.items()}
    return factors | {"Y_uv": 1 + 0.85 * max(zeta - 0.8, 0.0) / 1.205}


def rates(z: np.ndarray, delta: float, n: float) -> np.ndarray:
    """Rates of x, y, psi, u, v, r. z (6,): state; delta [rad, to starboard], n [1/s]."""
    _, _, psi, u, v, r = z
    d, L = -delta, LENGTH
    beta = math.atan2(v, u)
    thrust = C.T_uu * u**2 / L + C.T_un * u * n + L * C.T_nn * abs(n) * n
    c2 = max(C.c_un * u * n + C.c_nn * n * n, 0.0)
    surge = (C.X_uu * u**2 + C.X_vv * v**2 + c2 * d * (C.X_ccdd * d + C.X_ccbd * beta)) / L
    surge += C.X_vr * v * r + thrust * (1 - C.t)
    bend = c2 * abs(beta) * beta * abs(d)
    sway = (C.Y_uv * u * v + C.Y_vv * abs(v) * v + C.Y_ccd * c2 * d + C.Y_ccbbd * bend) / L
    sway += C.Y_ur * u * r + C.Y_T * thrust
    yaw = (C.N_uv * u * v + C.N_ccd * c2 * d + C.N_ccbbd * bend) / L + C.N_vr * abs(v) * r + C.N_ur * u * r
    yaw += C.N_T * thrust
    path = (u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi), r)
    return np.array([*path, surge / C.m_u, sway / C.m_v, yaw / (L * C.m_r)])


PLANT = Plant(LENGTH, 8.23, math.radians(2.33), rates, revolutions=(0.1, 5.0))

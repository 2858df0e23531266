"""Container ship SR 108, L = 175 m, with roll: Son & Nomoto (1982), Naval Architecture and Ocean Engineering 20:73-83.

Equations and coefficients (by 1/2 rho L^2 U^2) as published with the Marine Systems Simulator (Fossen & Perez); single
lineage. GM = 0.3 m as there.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from benchmarks.literature.plants import Plant

LENGTH, GRAVITY, VOLUME, GM, DIAMETER = 175.0, 9.81, 21222.0, 0.3, 6.533
RUDDER_AREA, ASPECT = 33.0376, 1.8219
M = SimpleNamespace(
    m=0.00792, m_x=0.000238, m_y=0.007049, I_x=0.0000176, J_x=0.0000034, I_z=0.000456, J_z=0.000419,
    alpha_y=0.05, l_x=0.0313, l_y=0.0313,
)  # fmt: skip
X = SimpleNamespace(uu=-0.0004226, vr=-0.00311, rr=0.00020, ff=-0.00020, vv=-0.00386)
TERMS = ("v", "r", "p", "f", "vvv", "rrr", "vvr", "vrr", "vvf", "vff", "rrf", "rff")
Y = (-0.0116, 0.00242, 0.0, -0.000063, -0.109, 0.00177, 0.0214, -0.0405, 0.04605, 0.00304, 0.009325, -0.001368)
N = (-0.0038545, -0.00222, 0.000213, -0.0001424, 0.001492, -0.00229, -0.0424, 0.00156, -0.019058, -0.0053766,
     -0.0038592, 0.0024195)  # fmt: skip
K = (0.0003026, -0.000063, -0.0000075, -0.000021, 0.002843, -0.0000462, -0.000588, 0.0010565, -0.0012012, -0.0000793,
     -0.000243, 0.00003569)  # fmt: skip
R = SimpleNamespace(
    k=0.631, epsilon=0.921, x_R=-0.5, w=0.184, tau=1.09, x_P=-0.526, gamma=0.088, c_r=-0.156, c_rrr=-0.275,
    c_rrv=1.96, c_X=0.71, a_H=0.237, z_R=0.033, x_H=-0.48, t=0.175,
)  # fmt: skip


def rates(z: np.ndarray, delta: float, n: float) -> np.ndarray:
    """Rates of x, y, psi, u, v, r, p, phi. z (8,): state; delta [rad, to starboard], n [1/s]."""
    U, L = math.hypot(z[3], z[4]), LENGTH
    psi, phi = z[2], z[7]
    u, v, r, p = z[3] / U, z[4] / U, z[5] * L / U, z[6] * L / U
    products = (v, r, p, phi, v**3, r**3, v * v * r, v * r * r, v * v * phi, v * phi**2, r * r * phi, r * phi**2)
    v_R = R.gamma * v + R.c_r * r + R.c_rrr * r**3 + R.c_rrv * r * r * v
    u_P = u * (1 - R.w + R.tau * (v + R.x_P * r) ** 2)
    J = u_P * U / (n * DIAMETER)
    K_T = 0.527 - 0.455 * J
    u_R = u_P * R.epsilon * math.sqrt(1 + 8 * R.k * max(K_T, 0.0) / (math.pi * J * J))
    slope = 6.13 * ASPECT / (ASPECT + 2.25)
    F_N = -slope * RUDDER_AREA / L**2 * (u_R**2 + v_R**2) * math.sin(delta + math.atan2(v_R, u_R))
    thrust = 2 * DIAMETER**4 / (U * L) ** 2 * K_T * n * abs(n)
    surge = X.uu * u * u + (1 - R.t) * thrust + X.vr * v * r + X.vv * v * v + X.rr * r * r + X.ff * phi**2
    surge += R.c_X * F_N * math.sin(delta) + (M.m + M.m_y) * v * r
    side = F_N * math.cos(delta)
    sway = float(np.dot(Y, products)) + (1 + R.a_H) * side - (M.m + M.m_x) * u * r
    weight = GRAVITY * VOLUME / (0.5 * L**2 * U**2)
    roll = float(np.dot(K, products)) - (1 + R.a_H) * R.z_R * side + M.m_x * M.l_x * u * r - weight * GM / L * phi
    yaw = float(np.dot(N, products)) + (R.x_R + R.a_H * R.x_H) * side
    mass = np.array([
        [M.m + M.m_y, -M.m_y * M.l_y, M.m_y * M.alpha_y],
        [-M.m_y * M.l_y, M.I_x + M.J_x, 0.0],
        [M.m_y * M.alpha_y, 0.0, M.I_z + M.J_z],
    ])  # fmt: skip
    v_dot, p_dot, r_dot = np.linalg.solve(mass, (sway, roll, yaw))
    across = z[4] * math.cos(phi)
    path = (z[3] * math.cos(psi) - across * math.sin(psi), z[3] * math.sin(psi) + across * math.cos(psi))
    motion = (surge / (M.m + M.m_x) * U**2 / L, v_dot * U**2 / L, r_dot * U**2 / L**2)
    return np.array([*path, z[5] * math.cos(phi), *motion, p_dot * U**2 / L**2, z[6]])


PLANT = Plant(LENGTH, 7.0, math.radians(5.0), rates, size=8, revolutions=(0.5, 3.0))

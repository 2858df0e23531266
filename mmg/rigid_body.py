"""Equations of motion in surge, sway and yaw about midship."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.coefficients import table
from mmg.flow import Force

INERTIA = table(
    "empirical default: Motora's charts give about these for full ships",
    ("m_x", 0.03, 0.0015, 0.0, 0.15, "mmg", "added mass in surge, by 1/2 rho L^2 d"),
    ("m_y", 0.24, 0.012, 0.02, 0.6, "mmg", "added mass in sway, by 1/2 rho L^2 d"),
    (
        "I_J_z",
        0.027,
        0.0014,
        0.002,
        0.1,
        "mmg",
        "yaw inertia about the centre of gravity plus added inertia, by 1/2 rho L^4 d",
    ),
)
"""Mass coefficients that every ship has, whatever its force models."""


def accelerations(u: Any, v: Any, r: Any, force: Force, p: SimpleNamespace, c: SimpleNamespace) -> tuple[Any, Any, Any]:
    """Accelerations (du/dt, dv/dt, dr/dt) about midship.

    (m + m_x) u' - (m + m_y) v r - x_G m r^2 = X
    (m + m_y) v' + (m + m_x) u r + x_G m r'  = Y
    (I_zG + x_G^2 m + J_z) r' + x_G m (v' + u r) = N
    (Yasukawa & Yoshimura 2015, Eq. 4.) The 2 x 2 block of sway and yaw is solved in closed form; its
    determinant is positive for every physical ship. N holds no Munk moment: in MMG it is part of N_v'.
    """
    mass_unit = 0.5 * p.rho * p.L**2 * p.d
    m, m_x, m_y = p.m, c.m_x * mass_unit, c.m_y * mass_unit
    moment = p.x_G * m
    inertia = c.I_J_z * mass_unit * p.L**2 + p.x_G**2 * m
    surge = (force.X + (m + m_y) * v * r + moment * r * r) / (m + m_x)
    f_y = force.Y - (m + m_x) * u * r
    f_n = force.N - moment * u * r
    determinant = (m + m_y) * inertia - moment * moment
    sway = (f_y * inertia - moment * f_n) / determinant
    yaw = (f_n * (m + m_y) - moment * f_y) / determinant
    return surge, sway, yaw

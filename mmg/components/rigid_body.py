"""Equations of motion in surge, sway and yaw about midship."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import table
from mmg.motion.flow import Force

# Mass coefficients that every ship has, whatever its force models. A ship file that leaves them out knows nothing of
# them: the charts give half to one and a half of these to ships from slender to full.
INERTIA = table(
    "empirical default: Motora's charts give about these for full ships",
    ("m_x", 0.03, 0.015, 0.0, 0.15, "mmg", "added mass in surge, by 1/2 rho L^2 d"),
    ("m_y", 0.24, 0.1, 0.02, 0.6, "mmg", "added mass in sway, by 1/2 rho L^2 d"),
    ("I_J_z", 0.027, 0.01, 0.002, 0.1, "mmg", "yaw inertia about the centre of gravity plus added inertia, by "
     "1/2 rho L^4 d"),
)  # fmt: skip


@dataclass(frozen=True)
class Inertia:
    """Masses about midship: m, m_x, m_y [kg]; moment x_G m [kg m]; I_z about midship with J_z [kg m^2].

    y_r, n_v: added masses of sway in yaw and yaw in sway, -Y_rdot and -N_vdot [kg m], absent in most MMG models.
    """

    m: Any
    m_x: Any
    m_y: Any
    moment: Any
    I_z: Any
    y_r: Any = 0.0
    n_v: Any = 0.0

    def force_of(self, rates: Sequence[Any]) -> Force:
        """The force that adds ``rates`` du/dt, dv/dt, dr/dt to those of any others (``accelerations``)."""
        du, dv, dr = rates
        Y = (self.m + self.m_y) * dv + (self.moment + self.y_r) * dr
        return Force((self.m + self.m_x) * du, Y, self.I_z * dr + (self.moment + self.n_v) * dv)

    def net_force(self, velocity: Any, rates: Any) -> tuple[Any, Any, Any]:
        """X, Y [N], N [N m] with which a body of these masses, without y_r and n_v, moves at ``velocity`` u, v, r with
        the ``rates`` du/dt, dv/dt, dr/dt: the equations of ``accelerations`` the other way."""
        (u, v, r), (du, dv, dr) = velocity, rates
        X = (self.m + self.m_x) * du - (self.m + self.m_y) * v * r - self.moment * r * r
        Y = (self.m + self.m_y) * dv + (self.m + self.m_x) * u * r + self.moment * dr
        return X, Y, self.I_z * dr + self.moment * (dv + u * r)


def inertia(p: SimpleNamespace, c: SimpleNamespace) -> Inertia:
    """Masses of a ship from its particulars (m, x_G, L, d, rho) and the coefficients of INERTIA.

    Coefficients Y_rdot and N_vdot (MMG primes) are taken into account where a hull model has them.
    p, c: particulars and coefficients by attribute.
    """
    unit = 0.5 * p.rho * p.L**2 * p.d  # of a mass in the MMG system; of an inertia by L^2 more
    return Inertia(
        m=p.m,
        m_x=c.m_x * unit,
        m_y=c.m_y * unit,
        moment=p.x_G * p.m,
        I_z=c.I_J_z * unit * p.L**2 + p.x_G**2 * p.m,  # Steiner: I_J_z is about the centre of gravity
        y_r=-c.Y_rdot * unit * p.L if hasattr(c, "Y_rdot") else 0.0,
        n_v=-c.N_vdot * unit * p.L if hasattr(c, "N_vdot") else 0.0,
    )


def accelerations(u: Any, v: Any, r: Any, force: Force, mass: Inertia) -> tuple[Any, Any, Any]:
    """Accelerations (du/dt, dv/dt, dr/dt) about midship.

    (m + m_x) u' - (m + m_y) v r - x_G m r^2 = X
    (m + m_y) v' + (m + m_x) u r + x_G m r'  = Y
    (I_zG + x_G^2 m + J_z) r' + x_G m (v' + u r) = N
    (Yasukawa & Yoshimura 2015, Eq. 4.) The 2 x 2 block of sway and yaw is solved in closed form; its
    determinant is positive for every physical ship. N holds no Munk moment: in MMG it is part of N_v'.
    u, v, r [m/s, m/s, rad/s]; force [N, N, N m]; mass: about midship.
    """
    m, m_x, m_y, moment = mass.m, mass.m_x, mass.m_y, mass.moment
    surge = (force.X + (m + m_y) * v * r + moment * r * r) / (m + m_x)
    f_y = force.Y - (m + m_x) * u * r
    f_n = force.N - moment * u * r
    y_r, n_v = moment + mass.y_r, moment + mass.n_v  # off the diagonal: x_G m with the added masses of sway and yaw
    determinant = (m + m_y) * mass.I_z - y_r * n_v
    sway = (f_y * mass.I_z - y_r * f_n) / determinant
    yaw = (f_n * (m + m_y) - n_v * f_y) / determinant
    return surge, sway, yaw

"""Standard MMG rudder (Yasukawa & Yoshimura 2015, J Mar Sci Technol 20:37-52), continued to all quadrants.

F_N = 1/2 rho A_R f_alpha U_R^2 sin(alpha_R), alpha_R = delta - atan2(v_R, u_R),
v_R = U gamma_R beta_R, beta_R = beta - ell_R' r', gamma_R by the sign of beta_R,
u_R = eps u_P sqrt{ eta [1 + kappa (sqrt(1 + 8 K_T/(pi J^2)) - 1)]^2 + 1 - eta } ahead, in the other quadrants that of
the model single (mmg/components/rudder/inflow.py). f_alpha defaults to 6.13 Lambda/(Lambda + 2.25).
X_R = -(1 - t_R) F_N sin delta, Y_R = -(1 + a_H) F_N cos delta, N_R = -(x_R + a_H x_H) F_N cos delta.
With beta the acute drift angle, v_R = gamma_R (U beta - ell_R r) needs no division and is defined at rest; U beta is
the published form and exceeds -v by 2 % at 20 degrees.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import Coefficient, table
from mmg.components.rudder import inflow as shared
from mmg.motion.flow import Flow, Force
from mmg.motion.frames import drift_angle
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P", "A_R", "aspect_ratio", "x_R")
INPUTS = ("delta",)

# Rows of the coefficient table but for the normal force.
INFLOW = (
    ("t_R", 0.39, 0.1, 0.0, 0.7, "", "steering resistance deduction"),
    ("a_H", 0.31, 0.1, 0.0, 1.0, "", "rudder force increase on the hull"),
    ("x_H", -0.46, 0.05, -0.6, -0.3, "mmg", "position of the additional lateral force, by L"),
    ("ell_R", -0.71, 0.2, -1.5, -0.4, "mmg", "effective lever of yaw in the rudder inflow, by L"),
    ("kappa", 0.50, 0.12, 0.05, 1.2, "", "propeller acceleration at the rudder"),
    ("epsilon", 1.09, 0.25, 0.7, 1.6, "", "ratio of wake at rudder and propeller"),
    *shared.REVERSED,
    ("gamma_R_plus", 0.5, 0.13, 0.05, 1.0, "", "flow straightening, beta_R > 0 (water from port)"),
    ("gamma_R_minus", 0.5, 0.13, 0.05, 1.0, "", "flow straightening, beta_R < 0 (water from starboard)"),
)


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Coefficients with their defaults; f_alpha by Fujii's formula from the aspect ratio. p: particulars."""
    slope = shared.fujii(p.aspect_ratio)
    return table("default of the standard rudder model", *INFLOW) + table(
        "Fujii's formula on the aspect ratio",
        ("f_alpha", slope, 0.1 * slope, 0.3 * slope, 2.0 * slope, "", "slope of the rudder's normal force"),
    )


def inflow(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> tuple[Any, Any]:
    """Longitudinal and lateral inflow velocity at the rudder (u_R, v_R) [m/s]. flow, p, c: as in mmg/motion/flow.py."""
    U = s.root(flow.u**2 + flow.v**2, 0.1 * s.speed)
    across = (
        U * drift_angle(flow.u, flow.v, s) - c.ell_R * p.L * flow.r
    )  # U beta_R [m/s], which has its sign at rest too
    from_port = s.step(across, 0.5 * s.speed)
    gamma = from_port * c.gamma_R_plus + (1 - from_port) * c.gamma_R_minus
    return shared.longitudinal(flow, p, c.kappa, c, s), gamma * across


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Rudder force including its effect on the hull [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    u_R, v_R = inflow(flow, p, c, s)
    return shared.by_sine_law(u_R, v_R, c.f_alpha, flow, p, c, s)

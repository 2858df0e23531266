"""Single rudder behind a propeller: slipstream ahead, reversed flow and sternway.

X_R = -(1 - t_R) F_N sin delta, Y_R = -(1 + a_H) F_N cos delta, N_R = -(x_R + a_H x_H) F_N cos delta,
F_N = 1/2 rho A_R f_alpha U_R^2 sin(delta - atan2(v_R, u_R)), f_alpha = 6.13 Lambda / (Lambda + 2.25) (Fujii),
v_R = -gamma_R (v + ell_R r), gamma_P for v + x_R r >= 0, else gamma_N (Yasukawa & Yoshimura 2015).
Inflow u_R with kappa = k_x / eps (Yoshimura ahead, Kitagawa 2015 reversed; see mmg/components/rudder/inflow.py):
  n >= 0 and K_T > 0: u_R = eps sqrt{ eta [u_P + kappa (sqrt(u_P^2 + 8 K_T n^2 D^2/pi) - u_P)]^2 + (1 - eta) u_P^2 }
  else with headway:  u_R = sgn(q) sqrt|q|, q = eta sgn(u_1) u_1^2 + (1 - eta) u_2^2 + C_PR u^2,
                      u_2 = u eps (1 - w_P), u_1 = u_2 + n D k_xR sqrt(8 |K_T|/pi)
  else (sternway):    u_R = u.
The angle of attack is never formed: U_R^2 sin(delta - phi) = U_R (u_R sin delta - v_R cos delta).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import table
from mmg.components.rudder import inflow as shared
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P", "A_R", "aspect_ratio", "x_R")
INPUTS = ("delta",)

COEFFICIENTS = table(
    "default of the single-rudder model",
    ("t_R", 0.30, 0.1, 0.0, 0.7, "", "steering resistance deduction"),
    ("a_H", 0.30, 0.1, 0.0, 1.0, "", "rudder force increase on the hull"),
    ("x_H", -0.45, 0.05, -0.6, -0.3, "mmg", "position of the additional lateral force, by L"),
    ("ell_R", -0.9, 0.2, -1.5, -0.4, "mmg", "effective lever of yaw in the rudder inflow, by L"),
    ("k_x", 0.35, 0.1, 0.05, 1.0, "", "propeller acceleration at the rudder, kappa = k_x / epsilon"),
    ("epsilon", 1.1, 0.25, 0.7, 1.6, "", "ratio of wake at rudder and propeller"),
    *shared.REVERSED,
    ("gamma_P", 0.40, 0.1, 0.05, 1.0, "", "flow straightening, sway at the rudder to starboard"),
    ("gamma_N", 0.40, 0.1, 0.05, 1.0, "", "flow straightening, sway at the rudder to port"),
)


def inflow(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> tuple[Any, Any]:
    """Longitudinal and lateral inflow velocity at the rudder (u_R, v_R) [m/s]. flow, p, c: as in mmg/motion/flow.py."""
    u_R = shared.longitudinal(flow, p, c.k_x / c.epsilon, c, s)
    to_starboard = s.step(flow.v + p.x_R * flow.r, 0.5 * s.speed)  # sway at the rudder, of the other sign than beta_R
    gamma = to_starboard * c.gamma_P + (1 - to_starboard) * c.gamma_N
    v_R = -gamma * (flow.v + c.ell_R * p.L * flow.r)
    return u_R, v_R


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Rudder force including its effect on the hull [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    u_R, v_R = inflow(flow, p, c, s)
    return shared.by_sine_law(u_R, v_R, shared.fujii(p.aspect_ratio), flow, p, c, s)

"""Single rudder behind a propeller: slipstream ahead, reversed flow and sternway.

X_R = -(1 - t_R) F_N sin delta, Y_R = -(1 + a_H) F_N cos delta, N_R = -(x_R + a_H x_H) F_N cos delta,
F_N = 1/2 rho A_R f_alpha U_R^2 sin(delta - atan2(v_R, u_R)), f_alpha = 6.13 Lambda / (Lambda + 2.25) (Fujii),
v_R = -gamma_R (v + ell_R r), gamma_P for v + x_R r >= 0, else gamma_N (Yasukawa & Yoshimura 2015).
Inflow u_R (Yoshimura's low-speed form ahead; Kitagawa 2015 in reversed flow, single public lineage):
  n >= 0 and K_T > 0: u_R = eps sqrt{ eta [u_P + kappa (sqrt(u_P^2 + 8 K_T n^2 D^2/pi) - u_P)]^2 + (1 - eta) u_P^2 }
  else with headway:  u_R = sgn(q) sqrt|q|, q = eta sgn(u_1) u_1^2 + (1 - eta) u_2^2 + C_PR u^2,
                      u_2 = u eps (1 - w_P), u_1 = u_2 + n D k_xR sqrt(8 |K_T|/pi)
  else (sternway):    u_R = u.
The angle of attack is never formed: U_R^2 sin(delta - phi) = U_R (u_R sin delta - v_R cos delta).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.coefficients import table
from mmg.flow import Flow, Force
from mmg.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_P", "A_R", "aspect_ratio", "x_R")

COEFFICIENTS = table(
    "default of the single-rudder model",
    ("t_R", 0.30, 0.1, 0.0, 0.7, "", "steering resistance deduction"),
    ("a_H", 0.30, 0.1, 0.0, 1.0, "", "rudder force increase on the hull"),
    ("x_H", -0.45, 0.05, -0.6, -0.3, "mmg", "position of the additional lateral force, by L"),
    ("ell_R", -0.9, 0.2, -1.5, -0.4, "mmg", "effective lever of yaw in the rudder inflow, by L"),
    ("k_x", 0.35, 0.1, 0.05, 1.0, "", "propeller acceleration at the rudder, kappa = k_x / epsilon"),
    ("epsilon", 1.1, 0.25, 0.5, 2.0, "", "ratio of wake at rudder and propeller"),
    ("k_xR", 0.15, 0.05, 0.0, 0.6, "", "propeller acceleration at the rudder when reversed"),
    ("C_PR", -0.176, 0.08, -1.0, 0.3, "", "inflow correction in reversed flow"),
    ("gamma_P", 0.40, 0.1, 0.05, 1.0, "", "flow straightening, sway at the rudder to starboard"),
    ("gamma_N", 0.40, 0.1, 0.05, 1.0, "", "flow straightening, sway at the rudder to port"),
)


def inflow(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> tuple[Any, Any]:
    """Longitudinal and lateral inflow velocity at the rudder (u_R, v_R) [m/s]."""
    wash = flow.slipstream
    if wash is None:
        raise ValueError("the rudder needs the slipstream of a propeller")
    u, nD = flow.u, flow.n * p.D_P
    eta = p.D_P / (p.A_R * p.aspect_ratio) ** 0.5
    small = 0.1 * s.speed
    pull = s.positive(wash.loading, s.speed * small)
    jet = s.root(wash.u_P**2 + 8 * pull / ca.pi, small) - wash.u_P
    ahead = c.epsilon * s.root(eta * (wash.u_P + c.k_x / c.epsilon * jet) ** 2 + (1 - eta) * wash.u_P**2, small)
    u_2 = u * c.epsilon * wash.one_minus_w
    u_1 = u_2 + s.sign(nD, s.speed) * c.k_xR * s.root(8 * s.absolute(wash.loading, small**2) / ca.pi, small)
    q = eta * u_1 * s.absolute(u_1, small) + (1 - eta) * u_2**2 + c.C_PR * u * u
    headway = s.step_or_zero(u, s.speed)
    otherwise = headway * s.signed_root(q, s.speed) + (1 - headway) * u
    # K_T > 0, with a width of 0.01 in K_T (0.02 in J) and a scale that is positive at rest
    scale = nD**2 + u**2 + small**2
    pulling = wash.ahead * s.step(wash.loading, 0.01 * scale)
    u_R = pulling * ahead + (1 - pulling) * otherwise
    to_starboard = s.step(flow.v + p.x_R * flow.r, 0.5 * s.speed)
    gamma = to_starboard * c.gamma_P + (1 - to_starboard) * c.gamma_N
    v_R = -gamma * (flow.v + c.ell_R * p.L * flow.r)
    return u_R, v_R


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Rudder force including its effect on the hull [N, N, N m]."""
    u_R, v_R = inflow(flow, p, c, s)
    sine, cosine = ca.sin(flow.delta), ca.cos(flow.delta)
    f_alpha = 6.13 * p.aspect_ratio / (p.aspect_ratio + 2.25)
    U_R = s.root(u_R**2 + v_R**2, 0.1 * s.speed)
    F_N = 0.5 * p.rho * p.A_R * f_alpha * U_R * (u_R * sine - v_R * cosine)
    X = -(1 - c.t_R) * F_N * sine
    Y = -(1 + c.a_H) * F_N * cosine
    N = -(p.x_R + c.a_H * c.x_H * p.L) * F_N * cosine
    return Force(X, Y, N)

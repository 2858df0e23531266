"""Wake fraction in manoeuvring: 1 - w_P as a function of the flow. In sternway 1 - w_P = 1 for all of them.

beta_P = beta - x_P' r' is the geometric inflow angle at the propeller, v' = v/U, r' = r L/U, and
  hirano         w_P = w_P0 - tau |a| - tau_a a - C_P a^2 with a = v' + x_P' r', 1 - w_P clipped to (0, 1]
  kijima         w_P = w_P0 exp(-4 beta_P^2)
  yasukawa_2015  (1 - w_P)/(1 - w_P0) = 1 + [1 - exp(-C_1 |beta_P|)] (C_2 - 1), C_2 by the sign of beta_P
The wake of a single screw changes more with flow from one side than from the other: tau_a as C_2 by its sign.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import table
from mmg.motion.flow import Flow
from mmg.motion.frames import drift_angle
from mmg.motion.smooth import Smoothing

W_P0 = ("w_P0", 0.40, 0.08, 0.0, 0.85, "", "wake fraction in straight running")
X_P = ("x_P", -0.48, 0.05, -0.7, -0.3, "mmg", "effective longitudinal position of the propeller, by L")

HIRANO = (
    W_P0,
    ("tau", 0.8, 0.25, 0.0, 2.0, "", "change of wake linear in the geometric inflow angle"),
    ("C_P", -0.35, 0.15, -1.5, 0.5, "", "change of wake quadratic in the geometric inflow angle"),
    ("x_P", -0.5, 0.05, -0.7, -0.3, "mmg", "effective longitudinal position of the propeller, by L"),
)
KIJIMA = (W_P0, X_P)
# Rows of the coefficient tables of each wake model.
YASUKAWA_2015 = (
    W_P0,
    ("C_1", 2.0, 0.6, 0.0, 10.0, "", "rate at which the wake changes with the inflow angle"),
    ("C_2_plus", 1.6, 0.3, 0.5, 2.5, "", "largest change of 1 - w_P, inflow angle beta_P > 0 (flow from port)"),
    ("C_2_minus", 1.1, 0.3, 0.5, 2.5, "", "largest change of 1 - w_P, inflow angle beta_P < 0"),
    X_P,
)
# Further coefficient of the Hirano type. Its deviation is its size for KVLCC2, half the difference of the slopes (1 -
# w_P0) C_1 (C_2 - 1) in flow from port and from starboard. Fixed: ship files of earlier releases lack it, and a
# starting ship frees it.
ASYMMETRY = table(
    "Yasukawa & Yoshimura (2015): that of KVLCC2 is 0.3",
    ("tau_a", 0.0, 0.3, -1.5, 1.5, "", "by how much tau is larger in flow from starboard, smaller from port"),
    fixed=True,
)

# Width [rad] within which |beta_P| and its sign are rounded. Set by hand: it rounds a corner of the published law.
BLEND = 0.01


def hirano(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Any:
    """1 - w_P [-], in (0, 1]; 1 with sternway. Hirano type, as in the public ESSO OSAKA code, which has
    no tau_a. flow, p, c, s: as in mmg/motion/flow.py."""
    U = s.root(flow.u**2 + flow.v**2, s.speed)
    angle = s.divide(flow.v + c.x_P * p.L * flow.r, U, 0.0)  # a, of the other sign than beta_P for small angles
    one_minus = 1 - c.w_P0 + c.tau * s.absolute(angle, 0.01) + c.tau_a * angle + c.C_P * angle**2
    clipped = s.positive(1 - s.positive(1 - one_minus, 0.01), 0.01)  # at most 1, then at least 0
    return 1 + s.step(flow.u, s.speed) * (clipped - 1)


def inflow_angle(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Any:
    """beta_P = beta - x_P' r L / U [rad] (Yasukawa & Yoshimura 2015), finite at rest. flow, p, c, s: as in
    mmg/motion/flow.py."""
    U = s.root(flow.u**2 + flow.v**2, s.speed)
    return drift_angle(flow.u, flow.v, s) - s.divide(c.x_P * p.L * flow.r, U, 0.0)


def kijima(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Any:
    """1 - w_P [-] = 1 - w_P0 exp(-4 beta_P^2) (Kijima et al. 1990); 1 with sternway. No coefficient beyond w_P0. flow,
    p, c, s: as in mmg/motion/flow.py."""
    angle = inflow_angle(flow, p, c, s)
    return 1 - s.step(flow.u, s.speed) * c.w_P0 * ca.exp(-4 * angle**2)


def yasukawa_2015(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Any:
    """1 - w_P [-] after Yasukawa & Yoshimura (2015), J Mar Sci Technol 20:37-52; 1 with sternway.

    Not clipped, as published: with C_2 = 1.6 and w_P0 = 0.35 it reaches 1.04 at large angles. Exactly 1 - w_P0
    at beta_P = 0, smoothed or not. flow, p, c, s: as in mmg/motion/flow.py.
    """
    angle = inflow_angle(flow, p, c, s)
    from_port = s.step(angle, BLEND)
    C_2 = from_port * c.C_2_plus + (1 - from_port) * c.C_2_minus
    # the modulus is exactly 0 at 0 and the bracket with it: the blend of C_2 leaves straight running as it is
    one_minus = (1 - c.w_P0) * (1 + (1 - ca.exp(-c.C_1 * s.absolute(angle, BLEND))) * (C_2 - 1))
    return 1 + s.step(flow.u, s.speed) * (one_minus - 1)

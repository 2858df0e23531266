"""What the rudder models share: longitudinal inflow in all quadrants, aspect ratio, and the force on the ship.

Longitudinal inflow u_R (Yoshimura's low-speed form ahead; Kitagawa 2015 in reversed flow, single public lineage): the
three equations of the model ``single``, where kappa = k_x / eps. The first of them is that of Yasukawa & Yoshimura
(2015), u_R = eps u_P sqrt{ eta [1 + kappa (sqrt(1 + 8 K_T/(pi J^2)) - 1)]^2 + 1 - eta }, for u_P > 0, multiplied out by
u_P; eta = D_P/H_R, at most 1.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.motion.flow import Blade, Flow, Force, Slipstream
from mmg.motion.smooth import Smoothing

# Rows of the coefficient table that reversed flow needs.
REVERSED = (
    ("k_xR", 0.15, 0.05, 0.0, 0.6, "", "propeller acceleration at the rudder when reversed"),
    ("C_PR", -0.176, 0.08, -1.0, 0.3, "", "inflow correction in reversed flow"),
)

# Width in K_T, by 1 + J^2, of the blends where the thrust changes its sign, as in a run that slows down: a tenth of
# that from ahead to reversed flow. It changes u_R of a propeller that pushes (K_T = 0.2) by 1e-5. Of the width of a
# ship at rest a fit sees a corner there, at which IPOPT never comes to its tolerance. Set by hand.
THRUST_WIDTH = 1e-3


def slipstream(flow: Flow) -> Slipstream:
    """The propeller's slipstream; ValueError when there is none. flow: behind the propeller."""
    if flow.slipstream is None:
        raise ValueError("the rudder needs the slipstream of a propeller")
    return flow.slipstream


def share_in_slipstream(p: SimpleNamespace) -> float:
    """eta = D_P / H_R [-], share of the rudder's height H_R = sqrt(A_R Lambda) in the slipstream: at most all of it.
    p: particulars.

    Above 1 the share 1 - eta outside would count negatively under the root of u_R, which is no number then.
    """
    return min(1.0, p.D_P / (p.A_R * p.aspect_ratio) ** 0.5)


def thrust_scale(flow: Flow, p: SimpleNamespace, s: Smoothing) -> Any:
    """(n D)^2 + u^2 [m^2/s^2], positive at rest: what thrust by rho D^2 is small against. flow, p, s: as in
    mmg/motion/flow.py."""
    return (flow.n * p.D_P) ** 2 + flow.u**2 + (0.1 * s.speed) ** 2


def longitudinal(flow: Flow, p: SimpleNamespace, kappa: Any, c: SimpleNamespace, s: Smoothing) -> Any:
    """u_R [m/s]; ``kappa`` [-] the acceleration of the slipstream ahead; uses c.epsilon, c.k_xR, c.C_PR. flow, p: as in
    mmg/motion/flow.py."""
    wash = slipstream(flow)
    u, nD = flow.u, flow.n * p.D_P
    eta = share_in_slipstream(p)
    small = 0.1 * s.speed
    scale = thrust_scale(flow, p, s)
    width = THRUST_WIDTH * scale
    pull = s.positive(wash.loading, width)  # momentum theory of the slipstream asks for K_T > 0
    jet = s.root(wash.u_P**2 + 8 * pull / ca.pi, small) - wash.u_P
    ahead = c.epsilon * s.root(eta * (wash.u_P + kappa * jet) ** 2 + (1 - eta) * wash.u_P**2, small)
    u_2 = u * c.epsilon * wash.one_minus_w
    aft = s.sign(nD, s.speed) if wash.aft is None else wash.aft  # where the jet goes, in the sense of sgn(n)
    # sqrt(8 |K_T| / pi) n D, whose slope has no bound where the thrust changes its sign
    reversed_jet = s.absolute(wash.loading, width) / ca.sqrt(s.magnitude(wash.loading, width))
    u_1 = u_2 + aft * c.k_xR * (8 / ca.pi) ** 0.5 * reversed_jet
    q = eta * u_1 * s.absolute(u_1, small) + (1 - eta) * u_2**2 + c.C_PR * u * u
    headway = s.step_or_zero(u, s.speed)
    otherwise = headway * s.signed_root(q, s.speed) + (1 - headway) * u
    # K_T > 0, with a width of 0.01 in K_T (0.02 in J)
    pulling = wash.ahead * s.step(wash.loading, 0.01 * scale)
    return pulling * ahead + (1 - pulling) * otherwise


def fujii(aspect_ratio: float) -> float:
    """Slope of the rudder's normal force f_alpha = 6.13 Lambda / (Lambda + 2.25) [-] (Fujii). aspect_ratio: Lambda
    [-]."""
    return 6.13 * aspect_ratio / (aspect_ratio + 2.25)


def across(u_R: Any, v_R: Any, delta: Any) -> Any:
    """U_R sin(alpha_R) = u_R sin(delta) - v_R cos(delta) [m/s]: the angle itself is never formed."""
    return u_R * ca.sin(delta) - v_R * ca.cos(delta)


def resultant(u_R: Any, v_R: Any, s: Smoothing) -> Any:
    """U_R = sqrt(u_R^2 + v_R^2) [m/s]."""
    return s.root(u_R**2 + v_R**2, 0.1 * s.speed)


def on_the_ship(F_N: Any, sin2_alpha: Any, delta: Any, p: SimpleNamespace, c: SimpleNamespace) -> Force:
    """Force [N, N, N m] of a rudder of normal force F_N [N] with its effect on the hull, and the rudder itself.

    X_R = -(1 - t_R) F_N sin(delta), Y_R = -(1 + a_H) F_N cos(delta), N_R = -(x_R + a_H x_H) F_N cos(delta).
    sin2_alpha: sin^2 of the angle of attack; p, c: as in mmg/motion/flow.py.
    """
    sine, cosine = ca.sin(delta), ca.cos(delta)
    X = -(1 - c.t_R) * F_N * sine  # delta > 0 with F_N > 0: a drag, to port at the stern, bow to starboard
    Y = -(1 + c.a_H) * F_N * cosine
    N = -(p.x_R + c.a_H * c.x_H * p.L) * F_N * cosine
    return Force(X, Y, N, blades=(Blade(X, Y, N, sin2_alpha),))


def by_sine_law(
    u_R: Any, v_R: Any, f_alpha: Any, flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing
) -> Force:
    """Force with F_N = 1/2 rho A_R f_alpha U_R^2 sin(delta - atan2(v_R, u_R)). flow, p, c, s: as in
    mmg/motion/flow.py."""
    U_R, cross = resultant(u_R, v_R, s), across(u_R, v_R, flow.delta)
    F_N = 0.5 * p.rho * p.A_R * f_alpha * U_R * cross  # one U_R of the square is inside ``cross``
    return on_the_ship(F_N, s.divide(cross**2, U_R**2, 0.0), flow.delta, p, c)

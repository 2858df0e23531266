"""Azimuth thrusters or pods at (x_az, y_az) that push into the direction a = azimuth, clockwise from ahead.

Up to four alike: the second is at (x_az_2, y_az_2) and listens to n_azimuth_2 and azimuth_2, and so on.

u_i = u - y r, v_i = v + x r; V_A = (1 - w_az) (u_i cos a + v_i sin a);
T = (1 - t_az) k_T_az k_i T_4Q(V_A/k_J_az, n) with the four-quadrant thrust of B4-70, P/D = 1.0
(propeller/four_quadrant.py), valid for every sign of V_A and n; k_1 = 1, k_i = k_T_az_i the thrust of a further pod by
that of the first, as hull and wakes of other pods take more from one than from another;
X = T cos a + Z sin a - D_x, Y = T sin a - Z cos a - D_y [N], N = x Y - y X [N m],
pod drag (D_x, D_y) = 1/2 rho D_az^2 C_pod sqrt(u_i^2 + v_i^2) (u_i, v_i).
The screw turns the water that crosses its axis with V_N = v_i cos a - u_i sin a into its own direction. Against V_N
acts Z = k_N_az rho (pi/4) D_az^2 W V_N, with W = V/2 + sqrt(V^2/4 + |T|/(rho pi D_az^2/2)), V^2 = u_i^2 + v_i^2, the
speed through its disc by momentum theory. k_N_az is 1 for a long duct, and less for a screw without one, whose wake
keeps some of V_N (R/V Gunnerus: 1.1 +- 0.3). It is the lift of a pod turned by a small angle, and damps sway and yaw.
Standard composition; the Coanda effect and the interaction of thrusters are left out (UNVERIFIED: no source with
numbers was found; calibrate k_T_az, t_az, w_az, k_N_az).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import Coefficient, table
from mmg.components.propeller.four_quadrant import thrust
from mmg.motion.flow import Flow, Force, pods
from mmg.motion.smooth import Smoothing

PARTICULARS = ("rho", "D_az", "x_az", "y_az")
INPUTS = ("n_azimuth", "azimuth")

GUESS = "default of the azimuth thruster: a guess"
# The pitch is not said: by the B-series the thrust at rest is 0.68 to 1.32 of the series' for P/D of 0.7 to 1.3.
COEFFICIENTS = table(
    GUESS,
    ("k_T_az", 1.0, 0.3, 0.3, 2.0, "", "factor on the thrust of the azimuth thruster's series"),
    ("k_J_az", 1.0, 0.2, 0.4, 1.6, "", "factor on the advance ratios of the azimuth thruster's series (pitch)"),
    ("t_az", 0.05, 0.05, -0.1, 0.5, "", "thrust lost to the hull"),
    ("w_az", 0.1, 0.1, -0.2, 0.7, "", "wake fraction at the azimuth thruster"),
    ("k_N_az", 0.0, 1.0, 0.0, 4.0, "", "force across the azimuth thruster by the momentum through its disc"),
    ("C_pod", 0.3, 0.2, 0.0, 3.0, "", "drag coefficient of the pod, by D_az^2"),
)


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """COEFFICIENTS, and the thrust of each pod after the first of a ship with particulars ``p``."""
    rows = [
        (f"k_T_az{i}", 1.0, 0.2, 0.2, 3.0, "", f"thrust of azimuth thruster {i[1:]} by that of the first")
        for i in pods(vars(p))
    ]
    return (*COEFFICIENTS, *table(GUESS, *rows))


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Force of all azimuth thrusters [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py."""
    return sum((_one(flow, i, getattr(c, f"k_T_az{i}"), p, c, s) for i in pods(vars(p))), _one(flow, "", 1.0, p, c, s))


def _one(flow: Flow, ending: str, factor: Any, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    x, y = getattr(p, f"x_az{ending}"), getattr(p, f"y_az{ending}")
    n, direction = getattr(flow, f"n_azimuth{ending}"), getattr(flow, f"azimuth{ending}")
    u, v = flow.u - y * flow.r, flow.v + x * flow.r
    cosine, sine = ca.cos(direction), ca.sin(direction)
    V_A = (1 - c.w_az) * (u * cosine + v * sine)
    T = factor * (1 - c.t_az) * c.k_T_az * thrust(V_A / c.k_J_az, n, p.D_az, p.rho, s)
    V = s.root(u**2 + v**2, 0.1 * s.speed)
    drag = 0.5 * p.rho * p.D_az**2 * c.C_pod * V
    disc = 0.25 * ca.pi * p.rho * p.D_az**2
    # momentum theory: W (W - V) = |T| / (2 rho A), A the disc; of its two roots the one that is not negative
    # |T| with a width of a hundredth of the dynamic pressure: of that of a ship at rest a fit sees a corner where a pod
    # stops pushing
    loading = s.absolute(T / disc, 0.01 * V**2 + (0.1 * s.speed) ** 2)
    W = 0.5 * V + s.root(0.25 * V**2 + 0.5 * loading, 0.1 * s.speed)
    Z = c.k_N_az * disc * W * (v * cosine - u * sine)
    X, Y = T * cosine + Z * sine - drag * u, T * sine - Z * cosine - drag * v
    return Force(X, Y, x * Y - y * X)

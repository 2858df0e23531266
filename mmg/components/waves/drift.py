"""Mean second-order wave drift in short form: three coefficients times the square of the wave height.

X_W = -rho g H_s^2 L C_XW cos g,  Y_W = -rho g H_s^2 L C_YW sin g,  N_W = -rho g H_s^2 L^2 C_NW sin 2g,
with g = wave direction - heading, the direction *coming from*, clockwise from the bow: waves from ahead push aft, waves
from starboard push to port; a positive C_NW turns the ship beam on to the waves.

UNVERIFIED: the form is that of irregular-wave drift coefficients (as in Yasukawa et al. 2019), reduced to
the lowest harmonic of each component; wave length, speed and short-crestedness are inside the coefficients. The
defaults are orders of magnitude from total reflection of short waves: 1/2 rho g zeta_a^2 with zeta_a^2 = H_s^2 / 8 on
a flat side gives C_YW = 1/16 (Faltinsen 1980), on a bow of B / L = 1/6 about a tenth of it. First-order motions are
left out.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import GRAVITY
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho")

COEFFICIENTS: tuple[Coefficient, ...] = (
    *table(
        "of the day: give it; 0 is a calm sea",
        ("H_s", 0.0, 0.1, 0.0, 20.0, "m", "significant wave height"),
        ("chi_W", 0.0, 0.3, -6.3, 6.3, "rad", "direction the waves come from, clockwise from north"),
        fixed=True,
    ),
    *table(
        "order of magnitude, total reflection of short waves, UNVERIFIED",
        ("C_XW", 0.008, 0.008, -0.02, 0.06, "", "mean wave drift, surge: X / (rho g H_s^2 L) in head waves"),
        ("C_YW", 0.06, 0.03, -0.05, 0.25, "", "mean wave drift, sway: Y / (rho g H_s^2 L) in beam waves"),
        ("C_NW", 0.0, 0.01, -0.05, 0.05, "", "mean wave drift, yaw: N / (rho g H_s^2 L^2) in bow-quartering waves"),
    ),
)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Mean wave drift X, Y [N], N [N m] about midship; needs the heading ``flow.psi`` [rad]. flow, p, c, s: as in
    mmg/motion/flow.py."""
    angle = c.chi_W - flow.psi  # coming from, clockwise from the bow
    scale = p.rho * GRAVITY * c.H_s**2 * p.L
    X, Y = -scale * c.C_XW * ca.cos(angle), -scale * c.C_YW * ca.sin(angle)
    return Force(X, Y, -scale * p.L * c.C_NW * ca.sin(2 * angle))

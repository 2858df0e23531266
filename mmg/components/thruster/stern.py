"""Stern thruster: Kobayashi's tunnel thruster at x_ST < 0, revolutions n_stern."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components.thruster.kobayashi import coefficient_table, side_thruster
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_ST", "x_ST")
INPUTS = ("n_stern",)

COEFFICIENTS = coefficient_table(
    "ST", "stern thruster", {"K_TP": 0.17, "K_TN": -0.21, "a_Y1": -2.56, "a_N1": -7.46, "u_max": 0.24765}
)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Stern thruster force [N, N, N m]; n_stern > 0 pushes the stern to starboard. flow, p, c, s: as in
    mmg/motion/flow.py."""
    return side_thruster(flow.u, flow.n_stern, p.D_ST, p.x_ST, "ST", p, c, s)

"""Bow thruster: Kobayashi's tunnel thruster at x_BT, revolutions n_bow."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components.thruster.kobayashi import coefficient_table, side_thruster
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "rho", "D_BT", "x_BT")
INPUTS = ("n_bow",)

COEFFICIENTS = coefficient_table(
    "BT", "bow thruster", {"K_TP": 0.360, "K_TN": -0.450, "a_Y1": -5.83, "a_N1": -3.44, "u_max": 0.24765}
)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Bow thruster force [N, N, N m]; n_bow > 0 pushes the bow to starboard. flow, p, c, s: as in
    mmg/motion/flow.py."""
    return side_thruster(flow.u, flow.n_bow, p.D_BT, p.x_BT, "BT", p, c, s)

"""Bow thruster: Kobayashi's tunnel thruster at x_BT, revolutions n_bow."""

from functools import partial

from mmg.components.thruster.kobayashi import coefficient_table, side_thruster

PARTICULARS = ("L", "rho", "D_BT", "x_BT")
INPUTS = ("n_bow",)

COEFFICIENTS = coefficient_table(
    "BT", "bow thruster", {"K_TP": 0.360, "K_TN": -0.450, "a_Y1": -5.83, "a_N1": -3.44, "u_max": 0.24765}
)

force = partial(side_thruster, "BT", "n_bow")

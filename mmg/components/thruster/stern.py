"""Stern thruster: Kobayashi's tunnel thruster at x_ST < 0, revolutions n_stern."""

from functools import partial

from mmg.components.thruster.kobayashi import coefficient_table, side_thruster

PARTICULARS = ("L", "rho", "D_ST", "x_ST")
INPUTS = ("n_stern",)

COEFFICIENTS = coefficient_table(
    "ST", "stern thruster", {"K_TP": 0.17, "K_TN": -0.21, "a_Y1": -2.56, "a_N1": -7.46, "u_max": 0.24765}
)

force = partial(side_thruster, "ST", "n_stern")

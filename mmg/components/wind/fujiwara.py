"""Wind force by Fujiwara, Ueno & Nimura (1998): coefficients from the particulars, a short trigonometric series.

X_A = 1/2 rho_a U_A^2 A_T (X_0 + X_1 cos a + X_3 cos 3a + X_5 cos 5a)
Y_A = 1/2 rho_a U_A^2 A_L (Y_1 sin a + Y_3 sin 3a + Y_5 sin 5a)
N_A = 1/2 rho_a U_A^2 A_L L (N_1 sin a + N_2 sin 2a + N_3 sin 3a)
with a the apparent wind angle counter-clockwise from the bow: U_A cos a = -a_x, U_A sin a = a_y. Multiple angles are
polynomials of cos a and sin a, so no arccos and no kink. X, Y, N constants verified in two independent codes; the last
term of Y_5 differs between them (C H_C / A_L here).
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "B", "A_T", "A_L", "A_OD", "C", "C_BR", "H_BR", "H_C", "rho_a")


def regression(p: SimpleNamespace) -> dict[str, float]:
    """The ten series coefficients from the particulars (Fujiwara et al. 1998).

    p: L, B [m]; A_T, A_L frontal and lateral projected area, A_OD lateral area of superstructures on deck [m^2];
    C, C_BR distance from midship of the centres of A_L and of the superstructure, forward positive [m]; H_BR height
    of the superstructure top, H_C of the centre of A_L above water [m].
    """
    L, B, A_T, A_L, A_OD = p.L, p.B, p.A_T, p.A_L, p.A_OD
    C, C_BR, H_BR, H_C = p.C, p.C_BR, p.H_BR, p.H_C
    side, front = A_L / (L * B), A_T / (L * B)
    return {
        "X_A0": -0.330 + 0.293 * B * H_BR / A_T + 0.0193 * C / H_C + 0.6820 * A_OD / L**2,
        "X_A1": -1.353 + 1.700 * side + 2.870 * L * H_C / A_L - 0.463 * L * H_BR / A_L
        - 0.570 * A_OD / A_L - 6.640 * front - 0.0123 * L**2 / A_T + 0.0202 * L / H_C,
        "X_A3": 0.830 - 0.413 * A_L / (L * H_BR) - 0.0827 * A_L / A_T - 0.563 * L * H_C / A_L
        + 0.804 * A_OD / A_L - 5.670 * A_OD / L**2 + 0.0401 * C / H_C - 0.132 * C_BR / L,
        "X_A5": 0.0372 - 0.0075 * A_L / A_OD - 0.103 * C_BR / L + 0.0921 * side,
        "Y_A1": 0.684 + 0.717 * C_BR / L - 3.220 * C / L + 0.0281 * A_L / A_OD + 0.0661 * C / H_C
        + 0.298 * A_T / (B * H_BR),
        "Y_A3": -0.400 + 0.282 * side + 0.307 * L * H_C / A_L + 0.0519 * C_BR / L + 0.0526 * B / H_BR
        - 0.0814 * A_OD / A_L + 0.0582 * A_T / (B * H_BR),
        "Y_A5": 0.122 - 0.166 * side - 0.0054 * L / H_BR - 0.0481 * C_BR / L - 0.0136 * B**2 / A_T
        + 0.0864 * C / L - 0.0297 * C * H_C / A_L,
        "N_A1": 0.2990 + 1.710 * C / L + 0.183 * L * H_C / A_L - 1.09 * A_T / A_L - 0.0442 * C / H_C
        - 0.289 * side + 4.24 * A_T / L**2 - 0.0646 * B**2 / A_T + 0.0306 * C_BR / L,
        "N_A2": 0.1170 + 0.123 * C_BR / L - 0.323 * C / L + 0.0041 * A_L / A_OD - 0.166 * A_T / B**2
        - 0.0109 * L / H_BR + 0.174 * A_T / (B * H_BR) + 0.214 * side - 1.06 * A_L / L**2,
        "N_A3": 0.0230 + 0.0385 * C_BR / L - 0.0339 * A_T / (B * H_BR) + 0.0023 * A_L / A_T,
    }  # fmt: skip


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Coefficient table for a ship of these particulars; prior std 30 % of the main term of each series. p:
    particulars."""
    values = regression(p)
    size = {"X": abs(values["X_A1"]), "Y": abs(values["Y_A1"]), "N": abs(values["N_A2"])}  # the main term of each
    rows = []
    for name, value in values.items():
        std, reach = (0.3 if name in ("X_A1", "Y_A1", "N_A2", "N_A1") else 0.1) * size[name[0]], 1.5 * size[name[0]]
        words = f"wind {name[0]} coefficient, harmonic {name[-1]} of the apparent wind angle"
        rows.append((name, value, std, value - reach, value + reach, "", words))
    return table("regression of Fujiwara, Ueno & Nimura (1998) on the particulars", *rows)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Wind force [N, N, N m] of the air velocity relative to the ship. flow, p, c, s: as in mmg/motion/flow.py."""
    U_A = s.root(flow.a_x**2 + flow.a_y**2, s.speed)
    cos_a, sin_a = s.divide(-flow.a_x, U_A, 0.0), s.divide(flow.a_y, U_A, 0.0)
    c2, s2 = cos_a**2, sin_a**2  # multiple angles as polynomials of these: de Moivre
    cos_3, cos_5 = cos_a * (4 * c2 - 3), cos_a * (16 * c2**2 - 20 * c2 + 5)
    sin_2, sin_3, sin_5 = 2 * sin_a * cos_a, sin_a * (3 - 4 * s2), sin_a * (16 * s2**2 - 20 * s2 + 5)
    pressure = 0.5 * p.rho_a * U_A**2
    C_X = c.X_A0 + c.X_A1 * cos_a + c.X_A3 * cos_3 + c.X_A5 * cos_5
    C_Y = c.Y_A1 * sin_a + c.Y_A3 * sin_3 + c.Y_A5 * sin_5
    C_N = c.N_A1 * sin_a + c.N_A2 * sin_2 + c.N_A3 * sin_3
    return Force(pressure * p.A_T * C_X, pressure * p.A_L * C_Y, pressure * p.A_L * p.L * C_N)

"""Wind force by Isherwood (1972): regression on wind tunnel tests of merchant ships.

C_X = -(A0 + A1 2 A_L / L^2 + A2 2 A_T / B^2 + A3 L / B + A4 S / L + A5 C / L + A6 M) on A_T,
C_Y =   B0 + B1 2 A_L / L^2 + B2 2 A_T / B^2 + B3 L / B + B4 S / L + B5 C / L + B6 A_SS / A_L on A_L,
C_N =   C0 + C1 2 A_L / L^2 + C2 2 A_T / B^2 + C3 L / B + C4 S / L + C5 C / L on A_L L,
L length over all, C distance of the centre of A_L from the bow, S perimeter of the lateral projection without
waterline, masts and ventilators, M groups of masts, A_SS lateral area of the superstructure. The tables, every 10 deg
from the bow, are refitted by cosines (C_X) and sines (C_Y, C_N) of multiples 1..7 of the wind angle: smooth, periodic,
and symmetric port and starboard. Largest deviation of the refit from the table, by the largest value of the same
coefficient, for a tanker, a container ship and a ferry: C_X 5 to 9 %, C_Y 4 to 5 %, C_N 6 to 9 % (the columns of the
table are regressions angle by angle, and jump from row to row). Table and order of the terms as in the public MSS
toolbox (one source). Fujiwara's model is preferable where its inputs are known.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from mmg.components.coefficients import table
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("B", "A_T", "A_L", "A_SS", "L_OA", "C", "S_A", "rho_a")

COEFFICIENTS = (
    *table(
        "1: Isherwood (1972) as it stands",
        ("k_XA", 1.0, 0.2, 0.0, 3.0, "", "factor on the wind surge force of Isherwood's regression"),
        ("k_YA", 1.0, 0.2, 0.0, 3.0, "", "factor on the wind side force of Isherwood's regression"),
        ("k_NA", 1.0, 0.2, -1.0, 3.0, "", "factor on the wind yaw moment of Isherwood's regression"),
    ),
    *table("merchant ships: 1 to 3", ("M_A", 1.0, 1.0, 0.0, 6.0, "", "groups of masts seen from the side"), fixed=True),
)

ORDER = 7  # Highest multiple of the wind angle in the refit. Set by hand: what it leaves of the table is stated above.

_ROWS = """
0 2.152 -5 0.243 -0.164 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
10 1.714 -3.33 0.145 -0.121 0 0 0 0.096 0.22 0 0 0 0 0 0.0596 0.061 0 0 0 -0.074
20 1.818 -3.97 0.211 -0.143 0 0 0.033 0.176 0.71 0 0 0 0 0 0.1106 0.204 0 0 0 -0.17
30 1.965 -4.81 0.243 -0.154 0 0 0.041 0.225 1.38 0 0.023 0 -0.29 0 0.2258 0.245 0 0 0 -0.38
40 2.333 -5.99 0.247 -0.19 0 0 0.042 0.329 1.82 0 0.043 0 -0.59 0 0.2017 0.457 0 0.0067 0 -0.472
50 1.726 -6.54 0.189 -0.173 0.348 0 0.048 1.164 1.26 0.121 0 -0.242 -0.95 0 0.1759 0.573 0 0.0118 0 -0.523
60 0.913 -4.68 0 -0.104 0.482 0 0.052 1.163 0.96 0.101 0 -0.177 -0.88 0 0.1925 0.48 0 0.0115 0 -0.546
70 0.457 -2.88 0 -0.068 0.346 0 0.043 0.916 0.53 0.069 0 0 -0.65 0 0.2133 0.315 0 0.0081 0 -0.526
80 0.341 -0.91 0 -0.031 0 0 0.032 0.844 0.55 0.082 0 0 -0.54 0 0.1827 0.254 0 0.0053 0 -0.443
90 0.355 0 0 0 -0.247 0 0.018 0.889 0 0.138 0 0 -0.66 0 0.2627 0 0 0 0 -0.508
100 0.601 0 0 0 -0.372 0 -0.02 0.799 0 0.155 0 0 -0.55 0 0.2102 0 -0.0195 0 0.0335 -0.492
110 0.651 1.29 0 0 -0.582 0 -0.031 0.797 0 0.151 0 0 -0.55 0 0.1567 0 -0.0258 0 0.0497 -0.457
120 0.564 2.54 0 0 -0.748 0 -0.024 0.996 0 0.184 0 -0.212 -0.66 0.34 0.0801 0 -0.0311 0 0.074 -0.396
130 -0.142 3.58 0 0.047 -0.7 0 -0.028 1.014 0 0.191 0 -0.28 -0.69 0.44 -0.0189 0 -0.0488 0.0101 0.1128 -0.42
140 -0.677 3.64 0 0.069 -0.529 0 -0.032 0.784 0 0.166 0 -0.209 -0.53 0.38 0.0256 0 -0.0422 0.01 0.0889 -0.463
150 -0.723 3.14 0 0.064 -0.475 0 -0.032 0.536 0 0.176 -0.029 -0.163 0 0.27 0.0552 0 -0.0381 0.0109 0.0689 -0.476
160 -2.148 2.56 0 0.081 0 1.27 -0.027 0.251 0 0.106 -0.022 0 0 0 0.0881 0 -0.0306 0.0091 0.0366 -0.415
170 -2.707 3.97 -0.175 0.126 0 1.81 0 0.125 0 0.046 -0.012 0 0 0 0.0851 0 -0.0122 0.0025 0 -0.22
180 -2.529 3.76 -0.174 0.128 0 1.55 0 0 0 0 0 0 0 0 0 0 0 0 0 0
"""

# Rows: wind angle from the bow [deg], A0..A6, B0..B6, C0..C5; (19, 21).
TABLE = np.array(_ROWS.split(), dtype=float).reshape(19, 21)


def _series(columns: slice, sines: bool) -> np.ndarray:
    """Least-squares series of the columns, (ORDER + 1, number of columns): row k multiplies cos or sin of k a."""
    k, angle = np.arange(ORDER + 1), np.radians(TABLE[:, :1])
    basis = np.sin(k[1:] * angle) if sines else np.cos(k * angle)
    fitted = np.linalg.lstsq(basis, TABLE[:, columns], rcond=None)[0]
    return np.vstack([np.zeros((1, fitted.shape[1])), fitted]) if sines else fitted


SERIES = (_series(slice(1, 8), False), _series(slice(8, 15), True), _series(slice(15, 21), True))  # Of C_X, C_Y and C_N


def features(p: SimpleNamespace, masts: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """What multiplies A0..A6, B0..B6 and C0..C5 of the table.

    p: B, A_T, A_L, A_SS, L_OA, S_A [m, m^2]; C centre of A_L forward of midship [m], taken as L_OA / 2 - C from
    the bow. masts: number of mast groups.
    """
    common = [1.0, 2 * p.A_L / p.L_OA**2, 2 * p.A_T / p.B**2, p.L_OA / p.B, p.S_A / p.L_OA, 0.5 - p.C / p.L_OA]
    return [*common, masts], [*common, p.A_SS / p.A_L], common


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Wind force X, Y [N], N [N m] about midship of the air velocity relative to the ship; zero in still air. flow, p,
    c, s: as in mmg/motion/flow.py."""
    squared = flow.a_x**2 + flow.a_y**2
    U_A = s.root(squared, s.speed)
    cos_a, sin_a = s.divide(-flow.a_x, U_A, 0.0), s.divide(flow.a_y, U_A, 0.0)
    cosines, sines = multiples(cos_a, sin_a)
    # each coefficient: sum over k of (row k of its series . features) times cos k a or sin k a
    C_X, C_Y, C_N = (
        sum(sum(a * b for a, b in zip(row, x, strict=True)) * angle for row, angle in zip(rows, angles, strict=True))
        for rows, x, angles in zip(SERIES, features(p, c.M_A), (cosines, sines, sines), strict=True)
    )
    pressure = 0.5 * p.rho_a * squared
    X, Y = c.k_XA * pressure * p.A_T * -C_X, c.k_YA * pressure * p.A_L * C_Y  # C_X is a head resistance in print
    return Force(X, Y, c.k_NA * pressure * p.A_L * p.L_OA * C_N)


def multiples(cosine: Any, sine: Any) -> tuple[list[Any], list[Any]]:
    """cos k a and sin k a for k = 0..ORDER from cos a and sin a, as polynomials (Chebyshev recurrence). cosine, sine:
    of the angle."""
    cosines, sines = [1.0, cosine], [0.0, sine]
    for _ in range(ORDER - 1):
        cosines.append(2 * cosine * cosines[-1] - cosines[-2])
        sines.append(2 * cosine * sines[-1] - sines[-2])
    return cosines, sines

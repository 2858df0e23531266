"""Four-quadrant propeller: thrust and torque as Fourier series of the advance angle (van Lammeren et al. 1969).

beta = atan2(V_A, 0.7 pi n D), V_r^2 = V_A^2 + (0.7 pi n D)^2,
T = 1/2 rho V_r^2 (pi D^2/4) C_T*(beta) [N], Q = 1/2 rho V_r^2 (pi D^3/4) C_Q*(beta) [N m],
C*(beta) = sum_{k=0}^{20} (A_k cos k beta + B_k sin k beta)  (van Lammeren, van Manen & Oosterveld 1969).
Tables: Wageningen B4-70, P/D = 1.0, as printed by Smogeli (2006); two public codes agree in every digit. That the
tables are of this geometry is UNVERIFIED, supported by bollard values and the B-series polynomials.

Neither n nor speed is divided by: with z = 0.7 pi n D + i V_A and w = z/rho, rho = sqrt(|z|^2 + eps^2), the products
V_r^2 cos k beta and V_r^2 sin k beta are rho^2 Re w^k and rho^2 Im w^k, smooth at rest too. All 20 harmonics are kept:
the first ten (their own least-squares re-fit, as the harmonics are orthogonal) miss C_T* by up to 0.067 and the bollard
K_T by 0.071 ahead and 0.066 reversed, for a largest |d2 C_T*/d beta2| of 8 instead of 21; fifteen miss 0.026 and 0.013.

X_P = (1 - t) T, t = t_P ahead (n >= 0) and t_PA reversed, V_A = u (1 - w_P),
w_P = w_P0 exp(-4 beta_P^2) (Kijima et al. 1990, see ``wake``), zero for u <= 0.
For another screw: thrust times k_T and V_A divided by k_J, so that zero thrust moves to k_J times the advance ratio
of the table (a rule of this library, not published). With k_T = 0.6965, k_J = 0.75 it gives the B-series polynomial of
Z = 4, A_E/A_O = 0.70, P/D = 0.7151 at J = 0, 0.4, 0.8 within 0.003 in K_T.
No side force.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from mmg.components.coefficients import table
from mmg.components.propeller import wake
from mmg.motion.flow import Flow, Force, Slipstream
from mmg.motion.smooth import Exact, Smoothing

PARTICULARS = ("L", "rho", "D_P")
INPUTS = ("n",)

# A_0 to A_20 of C_T* [-] (table of Smogeli 2006, above).
A_T = (
    2.5350e-2, 1.7820e-1, 1.4674e-2, 2.8054e-2, -1.6328e-2, -5.3041e-2, 6.0605e-4, 3.6823e-2, -2.5429e-3, -1.7680e-2,
    2.7331e-3, 2.1436e-2, -2.4782e-3, 1.2317e-3, 5.0980e-3, 7.8076e-3, -3.7816e-3, 3.5353e-3, 5.3014e-3, 2.1940e-3,
    -2.8306e-3,
)  # fmt: skip
# B_0 to B_20 of C_T* [-] (table of Smogeli 2006).
B_T = (
    0.0, -7.4777e-1, -1.3822e-2, 1.0077e-1, -1.1318e-2, 4.7186e-2, 1.0666e-2, -9.0239e-3, -7.8452e-3, 2.3941e-2,
    8.0787e-3, -1.4942e-4, -3.1925e-3, 9.2620e-3, 1.5527e-3, -6.5683e-3, -6.1655e-4, 5.1033e-3, -6.0263e-4, -8.2244e-3,
    -6.3789e-4,
)  # fmt: skip
# A_0 to A_20 of C_Q* [-] (table of Smogeli 2006).
A_Q = (
    2.4645e-3, 2.6718e-2, 1.6056e-3, 6.5822e-3, -2.2497e-3, -7.8062e-3, 2.4126e-4, 6.1475e-3, -1.6065e-3, -3.3291e-3,
    1.2311e-3, 3.1123e-3, -1.2559e-3, 1.3948e-3, 8.8397e-4, 5.0358e-5, -7.9990e-4, 1.3345e-3, 1.1928e-3, -1.3556e-4,
    -7.0825e-4,
)  # fmt: skip
# B_0 to B_20 of C_Q* [-] (table of Smogeli 2006).
B_Q = (
    0.0, -1.1081e-1, 1.5909e-4, 1.6455e-2, -2.0601e-3, 8.5343e-3, 8.7856e-4, -3.1327e-3, -9.6650e-4, 4.3190e-3,
    1.2453e-3, 9.5986e-5, -7.9986e-4, 1.5073e-3, 2.4595e-4, -1.6918e-3, 5.1603e-4, 1.1504e-3, -4.7976e-4, -1.4566e-3,
    2.3280e-4,
)  # fmt: skip

COEFFICIENTS = (
    *table(
        "default of the four-quadrant series model",
        ("k_T", 1.0, 0.1, 0.3, 2.0, "", "factor on the thrust of the series"),
        ("k_J", 1.0, 0.1, 0.4, 1.6, "", "factor on the advance ratios of the series (pitch)"),
        ("t_P", 0.20, 0.05, 0.0, 0.5, "", "thrust deduction fraction ahead"),
        ("t_PA", 0.15, 0.1, -0.1, 0.6, "", "thrust deduction fraction with the propeller reversed (a guess)"),
        *wake.KIJIMA,
    ),
    *table(
        "default of the four-quadrant series model",
        ("k_Q", 1.0, 0.1, 0.3, 2.0, "", "factor on the torque of the series; no effect on the motion"),
        fixed=True,
    ),
)


def series(V_A: Any, tip: Any, A: tuple[float, ...], B: tuple[float, ...], s: Smoothing) -> Any:
    """V_r^2 C*(beta) [m^2/s^2] for V_A and tip = 0.7 pi n D [m/s]. A, B: coefficients A_k, B_k (21,)."""
    rho = s.root(tip * tip + V_A * V_A, 0.1 * s.speed)
    x, y = s.divide(tip, rho, 0.0), s.divide(V_A, rho, 0.0)  # cos beta and sin beta, both 0 at rest
    real, imaginary = 1.0, 0.0
    total = A[0]
    for a, b in zip(A[1:], B[1:], strict=True):  # powers of w = x + i y: cos k beta + i sin k beta
        real, imaginary = real * x - imaginary * y, real * y + imaginary * x
        total = total + a * real + b * imaginary
    return rho * rho * total


def thrust(V_A: Any, n: Any, D: Any, rho: Any, s: Smoothing | None = None) -> Any:
    """Open-water thrust T [N] at advance speed V_A [m/s], n [1/s], diameter D [m], density rho [kg/m^3];
    s: smoothing, None for the exact branches. Returns an expression."""
    return rho * ca.pi / 8 * D**2 * series(V_A, 0.7 * ca.pi * n * D, A_T, B_T, s or Exact())


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Propeller force [N, N, N m] and slipstream; reversed, the loading holds the thrust deduction. flow, p, c, s: as
    in mmg/motion/flow.py."""
    nD = flow.n * p.D_P
    one_minus_w = wake.kijima(flow, p, c, s)
    u_P = flow.u * one_minus_w
    T = c.k_T * thrust(u_P / c.k_J, flow.n, p.D_P, p.rho, s)  # another screw has zero thrust at k_J times the J
    ahead = s.step_or_zero(nD, s.speed)
    X = (1 - ahead * c.t_P - (1 - ahead) * c.t_PA) * T
    loading = (1 - (1 - ahead) * c.t_PA) * T / (p.rho * p.D_P**2)
    return Force(X, slipstream=Slipstream(one_minus_w, u_P, loading, ahead))

"""Tunnel thruster that loses its effect with speed (Kobayashi 1988), shared by bow and stern.

T = rho D^4 n^2 K_T with K_T = K_TP for n >= 0 and K_TN < 0 for n < 0 [N]; Fr = |u|/sqrt(g L);
Y = (1 + a_Y0 + a_Y1 Fr + a_Y2 Fr^2) T [N], N = (1 + a_N0 + a_N1 Fr + a_N2 Fr^2) x T [N m], X = 0;
none for |u| >= u_max.
Kobayashi (1988, Mitsubishi Technical Bulletin 180) as in a public code of one lineage; first order in Fr for ESSO
OSAKA, second order for a cement carrier. The parabolas of the second order rise again beyond their minimum, outside
their data: they stay at the minimum here, which the source does not do.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import reference_speed
from mmg.motion.smooth import Smoothing


def coefficient_table(suffix: str, where: str, values: dict[str, float]) -> tuple[Coefficient, ...]:
    """Coefficients of one thruster; ``suffix`` BT or ST, ``values`` by symbol without suffix. where: in words."""
    v = values
    rows = table(
        "default of Kobayashi's tunnel thruster: ESSO OSAKA, first order, single public lineage",
        ("K_TP", v["K_TP"], 0.1 * abs(v["K_TP"]), 0.02, 1.0, "", f"thrust of the {where} to starboard, n >= 0"),
        ("K_TN", v["K_TN"], 0.1 * abs(v["K_TN"]), -1.0, -0.02, "", f"thrust of the {where} to port, n < 0"),
        ("a_Y0", 0.0, 0.1, -0.6, 0.6, "", f"side force of the {where} by its thrust at rest, less 1"),
        ("a_Y1", v["a_Y1"], 2.0, -25.0, 0.0, "", f"side force of the {where}, linear in Fr"),
        ("a_Y2", 0.0, 20.0, 0.0, 200.0, "", f"side force of the {where}, quadratic in Fr"),
        ("a_N0", 0.0, 0.1, -0.6, 0.6, "", f"moment of the {where} by its thrust at rest, less 1"),
        ("a_N1", v["a_N1"], 2.0, -25.0, 0.0, "", f"moment of the {where}, linear in Fr"),
        ("a_N2", 0.0, 20.0, 0.0, 200.0, "", f"moment of the {where}, quadratic in Fr"),
        ("u_max", v["u_max"], 0.1, 0.05, 10.0, "m/s", f"speed beyond which the {where} has no effect"),
    )
    return tuple(c.with_(symbol=f"{c.symbol}_{suffix}", fixed=c.symbol in ("a_Y2", "a_N2", "u_max")) for c in rows)


def effectiveness(Fr: Any, a: tuple[Any, ...], s: Smoothing) -> Any:
    """1 + a_0 + a_1 Fr + a_2 Fr^2 up to its minimum, then constant; a_1 <= 0, a_2 >= 0.

    What the parabola gains beyond its minimum, (a_1 + 2 a_2 Fr)^2/(4 a_2) there, is taken away.
    a: (a_0, a_1, a_2); s: smoothing.
    """
    a_0, a_1, a_2 = a
    rise = s.positive(a_1 + 2 * a_2 * Fr, 5e-3)  # the slope, 0 up to the minimum
    return 1 + a_0 + a_1 * Fr + a_2 * Fr**2 - s.divide(rise**2, 4 * a_2, 1e-2)


def side_thruster(suffix: str, input_: str, flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Force [N, N, N m] of the tunnel thruster of diameter D_BT or D_ST [m] at x_BT or x_ST [m] forward of midship.

    Positive revolutions push to starboard. suffix: BT or ST; input_: name of the revolutions in ``flow``; flow, p, c,
    s: as in mmg/motion/flow.py.
    """
    u, n, D, x = flow.u, getattr(flow, input_), getattr(p, f"D_{suffix}"), getattr(p, f"x_{suffix}")
    K_P, K_N, u_max = (getattr(c, f"{name}_{suffix}") for name in ("K_TP", "K_TN", "u_max"))
    nD = n * D
    # (n D)^2 K_T without a branch: K_TP for n > 0, K_TN for n < 0
    squared = 0.5 * (K_P - K_N) * nD * s.absolute(nD, 0.1 * s.speed) + 0.5 * (K_P + K_N) * nD**2
    speed = s.absolute(u, 0.1 * s.speed)
    T = p.rho * D**2 * squared * (1 - s.step_or_zero(speed - u_max, s.speed))  # to starboard, at x
    Fr = speed / reference_speed(p.L)
    Y, N = (effectiveness(Fr, tuple(getattr(c, f"a_{k}{i}_{suffix}") for i in range(3)), s) for k in "YN")
    return Force(0.0, Y * T, N * x * T)

"""Wind force: the force of the air is the ship's wind model times a factor per X, Y and N.

A ship without a wind model gets factors on a reference instead: Fujiwara, Ueno & Nimura (1998) with the particulars of
its upper works, or those of a typical tanker of its length and breadth where the ship file does not give them; its
neutral factors are 0.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

from mmg.components.wind import fujiwara
from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force


def upper_works(p: SimpleNamespace) -> SimpleNamespace:
    """The particulars with those of the upper works filled in, by the ratios of the ESSO OSAKA to L and B. p:
    particulars."""
    typical = {
        "A_T": 0.566 * p.B**2, "A_L": 0.0578 * p.L**2, "A_OD": 0.0158 * p.L**2, "C": -0.0043 * p.L,
        "C_BR": -0.0207 * p.L, "H_BR": 0.098 * p.L, "H_C": 0.0345 * p.L, "rho_a": 1.225,
    }  # fmt: skip
    return SimpleNamespace(**{**typical, **vars(p)})


class WindForce(Effect):
    """Wind force by a factor per component."""

    name, enters = "wind_force", "force"
    surroundings = True
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        neutral = 1.0 if "wind" in components else 0.0
        model = "the ship's wind model" if neutral else "Fujiwara's wind force"
        return tuple(
            Parameter(axis, neutral, 0.25, -2.0, 6.0, "", f"factor on {model}, {words}", least=least)
            # X and Y never point against the wind; N, by a small lever, may have either sign
            for axis, words, least in (("X", "surge", 0.0), ("Y", "sway", 0.0), ("N", "yaw", -math.inf))
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        if "wind" in at.components:
            air = parts["wind"]
        else:
            particulars = upper_works(at.p)
            air = fujiwara.force(flow, particulars, SimpleNamespace(**fujiwara.regression(particulars)), at.s)
        return {**parts, "wind": Force(e.X * air.X, e.Y * air.Y, e.N * air.N)}

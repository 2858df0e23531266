"""Rudder stall: the normal force falls short of the model's at large inflow angles.

F_N is smaller by loss w(alpha), w = 1/2 [1 + tanh((sin^2 alpha - sin^2 alpha_s) / width)] (generic smooth stall,
UNVERIFIED shape), for each rudder by itself.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca

from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force


class RudderStall(Effect):
    """Loss of rudder force beyond the stall angle."""

    name, enters, needs = "rudder_stall", "force", ("rudder",)
    form_error = 0.03

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        words = "share of the normal force that is lost beyond stall"
        return (
            Parameter("loss", 0.0, 0.4, -0.5, 1.2, "", words, least=0.0, most=1.0),
            Parameter("alpha_s", math.radians(20), 0.1, 0.1, 1.2, "rad", "inflow angle of stall", held=True),
            Parameter("width", 0.06, 0.02, 0.01, 0.5, "", "width of the change in sin^2 alpha", held=True),
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        X, Y, N = parts["rudder"].X, parts["rudder"].Y, parts["rudder"].N
        for blade in parts["rudder"].blades:
            # sin^2: the same for water from either side and from behind
            lost = e.loss * 0.5 * (1 + ca.tanh((blade.sin2_alpha - ca.sin(e.alpha_s) ** 2) / e.width))
            X, Y, N = X - lost * blade.X, Y - lost * blade.Y, N - lost * blade.N
        return {**parts, "rudder": Force(X, Y, N)}

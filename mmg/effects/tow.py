"""Tow: a constant force and moment in the body frame, as of a tow line, a fender or a lasting asymmetry."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import force_scale


class Tow(Effect):
    """Constant force and moment in the body frame."""

    name, enters = "tow", "force"
    surroundings = True

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        force = 0.05 * force_scale(p.L)  # 0.05 N at 3 m: a size that shows in a trial
        moment = force * p.L / 3
        return (
            Parameter("X", 0.0, force, -500 * force, 500 * force, "N", "constant force ahead"),
            Parameter("Y", 0.0, force, -500 * force, 500 * force, "N", "constant force to starboard"),
            Parameter("N", 0.0, moment, -500 * moment, 500 * moment, "N m", "constant moment, bow to starboard"),
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        return {**parts, "tow": Force(e.X, e.Y, e.N)}

"""Hull memory: sway force and yaw moment of the hull arrive with a lag, as of a vortex system that must form.

Y_H and N_H pass a first-order lag of time constant T.
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import GRAVITY, time_scale
from mmg.motion.memory import lagged


class HullMemory(Effect):
    """Lag of the lateral hull force."""

    name, enters, needs = "hull_memory", "force", ("hull",)
    form_error = 0.05

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        return (Parameter("T", 0.0, 1.2 * k, 0.0, 10.0 * k, "s", "time constant of the lag"),)

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        k = time_scale(at.p.L)
        size = 0.5 * at.p.rho * at.p.L * at.p.d * 1e-3 * GRAVITY * at.p.L  # U^2 of Froude number 0.03, primes of 1
        old = parts["hull"]
        Y = lagged(at.memory, "hull_memory.Y", old.Y, e.T, 0.5 * k, size)
        N = lagged(at.memory, "hull_memory.N", old.N, e.T, 0.5 * k, 0.3 * size * at.p.L)
        return {**parts, "hull": Force(old.X, Y, N)}

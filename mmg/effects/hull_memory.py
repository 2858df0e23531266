"""Hull memory: sway force and yaw moment of the hull arrive with a lag, as of a vortex system that must form.

Y_H and N_H pass a first-order lag of time constant T (``lagged`` of mmg/memory.py).
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter
from mmg.flow import Flow, Force
from mmg.memory import Memory, lagged, scale
from mmg.smooth import GRAVITY, Smoothing


class HullMemory(Effect):
    """Lag of the lateral hull force."""

    name, enters, needs = "hull_memory", "force", ("hull",)

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = scale(p)
        return (Parameter("T", 0.0, 1.2 * k, 0.0, 10.0 * k, "s", "time constant of the lag"),)

    def forces(
        self,
        parts: dict[str, Force],
        flow: Flow,
        memory: Memory,
        e: SimpleNamespace,
        p: SimpleNamespace,
        ship: SimpleNamespace,
        s: Smoothing,
    ) -> dict[str, Force]:
        k = scale(p)
        size = 0.5 * p.rho * p.L * p.d * 1e-3 * GRAVITY * p.L
        old = parts["hull"]
        Y = lagged(memory, "hull_memory.Y", old.Y, e.T, 0.5 * k, size)
        N = lagged(memory, "hull_memory.N", old.N, e.T, 0.5 * k, 0.3 * size * p.L)
        return {**parts, "hull": Force(old.X, Y, N)}


EFFECT = HullMemory()

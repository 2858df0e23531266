"""Disturbance: slowly varying forces that no model explains, as a random process of its own in X, Y and N.

Each is an Ornstein-Uhlenbeck process: F = size d with d' = -d / tau + noise and d of unit variance when stationary. A
calibration estimates d along each run (latent force, Alvarez et al. 2013; here as extra variables of the multiple
shooting), so that coefficients need not bend to a gust, and with it sizes that are left at 0
(fitting/solvers/latent_forces.py).
A simulation has d = 0 and no force. Prediction bands rest on a process of the same kind (fitting/prediction/bands.py).
"""

from __future__ import annotations

from types import SimpleNamespace

from mmg.effects.effect import Effect, Parameter, Parts, Setting
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import force_scale, time_scale

LATENT_STATES = tuple(f"disturbance.{axis}" for axis in "XYN")


class Disturbance(Effect):
    """Latent force process."""

    name, enters = "disturbance", "force"
    surroundings = True

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k, force = time_scale(p.L), 0.15 * force_scale(p.L)
        rows = (("X", force, "N"), ("Y", force, "N"), ("N", force * p.L / 4, "N m"))
        return (
            *(
                Parameter(axis, 0.0, size, 0.0, 1e3 * size, unit, f"standard deviation of the force {axis}", held=True)
                for axis, size, unit in rows
            ),
            Parameter("tau", 10.0 * k, 5.0 * k, 1.0 * k, 1e3 * k, "s", "correlation time of the process", held=True),
        )

    def forces(self, parts: Parts, flow: Flow, e: SimpleNamespace, at: Setting) -> Parts:
        d = [at.memory.low_pass(name, 0.0, e.tau, 1.0) for name in LATENT_STATES]
        return {**parts, "disturbance": Force(e.X * d[0], e.Y * d[1], e.N * d[2])}

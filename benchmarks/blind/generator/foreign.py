"""Causes that no library of effects holds. Not for the eyes of who diagnoses."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import Array, Drawn, OneNumber, effect, scaled, sign
from benchmarks.blind.generator.instruments import turned


class Sized(OneNumber):
    """A foreign effect with one signed size and a few shape numbers, some for each run, that the key holds."""

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        size = self.size(strength, rng) * (sign(rng) if self.two_sided else 1.0)
        inside = {"size": size, **{k: float(rng.uniform(*limits)) for k, limits in self.shape.items()}}
        return Drawn(dict(inside), inside | {k: rng.uniform(*limits, runs) for k, limits in self.per_run.items()})


foreign = partial(effect, base=Sized)


@foreign("forces", (0.02, 0.04, 0.10))
def quadratic_yaw_damping(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Moment -size r |r| 1/2 rho L^5 d, quadratic in the yaw rate."""
    N = -e.size * 0.5 * p["rho"] * p["L"] ** 4 * p["d"] * m.r * np.abs(m.r)
    parts["quadratic_yaw_damping"] = (0.0 * N, 0.0 * N, N)


@foreign("forces", (0.2, 0.35, 0.9), two_sided=True, lever=(0.3, 1.2), soft=(0.002, 0.006))
def one_sided_drag(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Resistance with speed, and a moment, only while the ship turns to one side."""
    on = 0.5 * (1 + np.tanh(np.sign(e.size) * m.r / e.soft))
    X = -np.abs(e.size) * on * m.u * np.abs(m.u) * 10.0
    parts["one_sided_drag"] = (X, 0.0 * X, -np.sign(e.size) * e.lever * X * 0.3)


@foreign("forces", (0.03, 0.06, 0.16), two_sided=True, lever=(-1.5, -1.2), way=(0.2, 0.6))
def propeller_walk_ahead(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Side force and moment of the propeller going ahead, with n^2, weaker as the ship gathers way."""
    Y = e.size * np.maximum(m.n, 0.0) ** 2 / 64.0 / (1 + (np.maximum(m.u, 0.0) / e.way) ** 2)
    parts["propeller_walk_ahead"] = (0.0 * Y, Y, e.lever * Y)


@foreign("forces", (0.3, 0.55, 0.95), n_0=(6.5, 8.5), width=(0.8, 1.6))
def rudder_loss_at_low_n(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Rudder force lost at low revolutions."""
    left = 1 - e.size * 0.5 * (1 - np.tanh((np.abs(m.n) - e.n_0) / e.width))
    parts["rudder"] = scaled(parts["rudder"], left, left, left)


@foreign("forces", (0.25, 0.5, 0.8), r_0=(0.02, 0.035))
def thrust_drop_in_turn(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Thrust lost at high yaw rate."""
    lost = e.size * m.r**4 / (m.r**4 + e.r_0**4)
    parts["propeller"] = scaled(parts["propeller"], np.where(m.n > 0, 1 - lost, 1.0), 1.0, 1.0)


@foreign("columns", tuple(np.radians((1.0, 2.5, 6.0))), two_sided=True, pole=(-3.1, 3.1), second=(-0.4, 0.4))
def compass_deviation(y: Array, history: Any, rows: Array, e: Any) -> Array:
    """Compass deviation with the heading; u and v are turned with it."""
    out, psi = y.copy(), history.states[rows, 2]
    error = e.size * (np.sin(psi - e.pole) + e.second * np.sin(2 * psi))
    out[:, 2] += error
    out[:, 3], out[:, 4] = turned(y[:, 3], y[:, 4], error)
    return out


@foreign("forces", (1.0, 2.5, 6.0), to=(-3.1, 3.1), period=(2.2, 4.0), phase=(-3.1, 3.1), yaw=(0.3, 0.7))
def oscillating_waves(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Waves: forces at the frequency of encounter, on the bow, the side and the quarters."""
    omega = 2 * np.pi / e.period
    place = omega**2 / 9.81 * (m.x * np.cos(e.to) + m.y * np.sin(e.to))
    wave, quarter = np.sin(omega * m.t - place + e.phase), np.cos(omega * m.t - place + e.phase)
    angle = e.to - m.psi
    N = e.size * e.yaw * np.sin(2 * angle) * quarter
    parts["oscillating_waves"] = (0.4 * e.size * np.cos(angle) * wave, e.size * np.sin(angle) * wave, N)


@foreign("forces", (0.05, 0.12, 0.35), at=(-1.5, -1.1), slow=(0.01, 0.03))
def dragged_weight(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Something heavy dragged over the ground at the stern: a force of constant size against the way of the stern."""
    u, v = m.u, m.v + e.at * m.r
    pull = -e.size / np.sqrt(u**2 + v**2 + e.slow**2)
    parts["dragged_weight"] = (pull * u, pull * v, e.at * pull * v)


@foreign("water", (0.006, 0.015, 0.04), two_sided=True, x=(-6.0, 6.0), y=(-6.0, 6.0), ring=(4.0, 9.0))
def eddy(m: Any, e: Any) -> tuple[Any, Any, Any, Any]:
    """Water that turns about a place: fastest at a ring around it, dying out beyond."""
    x, y = (m.x - e.x) / e.ring, (m.y - e.y) / e.ring
    spin = e.size * np.exp(0.5 * (1 - x**2 - y**2))
    return -y * spin, x * spin, 0.0, 0.0


@foreign("inflow", (0.05, 0.12, 0.3), over=(0.3, 0.6), way=(0.15, 0.3))
def shaft_droop(m: Any, e: Any) -> None:
    """Shaft slower than logged while the rudder is over or the ship makes little way."""
    load = (np.abs(m.delta) / e.over) ** 2 + np.exp(-np.maximum(m.u, 0.0) / e.way)
    m.n = m.n * (1 - e.size * np.minimum(load, 1.6))


@foreign("forces", (30.0, 70.0, 110.0), states=2, period=(16.0, 28.0), damping=(0.03, 0.1), at=(0.8, 1.3))
def swinging_mass(parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
    """A swinging mass in the hold, driven by the centripetal acceleration."""
    omega = 2 * np.pi / e.period
    spring = omega**2 * z[0] + 2 * e.damping * omega * z[1]
    Y = e.size * (spring + m.u * m.r)
    parts["swinging_mass"] = (0.0 * Y, Y, e.at * Y)
    return np.stack([z[1], -spring - m.u * m.r])


FOREIGN = (
    quadratic_yaw_damping, one_sided_drag, propeller_walk_ahead, rudder_loss_at_low_n, thrust_drop_in_turn,
    compass_deviation, oscillating_waves, dragged_weight, eddy, shaft_droop, swinging_mass,
)  # fmt: skip

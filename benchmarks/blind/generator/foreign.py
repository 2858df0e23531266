"""Causes that no library of effects holds. Not for the eyes of who diagnoses."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import Array, Drawn, OneNumber, scaled, sign
from benchmarks.blind.generator.instruments import turned


class Sized(OneNumber):
    """A foreign effect with one signed size and a few shape numbers, some for each run, that the key holds."""

    two_sided = True

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        size = self.size(strength, rng) * (sign(rng) if self.two_sided else 1.0)
        inside = {"size": size, **{k: float(rng.uniform(*limits)) for k, limits in self.shape.items()}}
        return Drawn(dict(inside), inside | {k: rng.uniform(*limits, runs) for k, limits in self.per_run.items()})


class YawDrag(Sized):
    """Moment -size r |r| 1/2 rho L^5 d, quadratic in the yaw rate."""

    name, levels, two_sided = "quadratic_yaw_damping", (0.02, 0.04, 0.10), False

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        N = -e.size * 0.5 * p["rho"] * p["L"] ** 4 * p["d"] * m.r * np.abs(m.r)
        parts[self.name] = (0.0 * N, 0.0 * N, N)


class OneSidedDrag(Sized):
    """Resistance with speed, and a moment, only while the ship turns to one side."""

    name, levels = "one_sided_drag", (0.2, 0.35, 0.9)
    shape = {"lever": (0.3, 1.2), "soft": (0.002, 0.006)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        on = 0.5 * (1 + np.tanh(np.sign(e.size) * m.r / e.soft))
        X = -np.abs(e.size) * on * m.u * np.abs(m.u) * 10.0
        parts[self.name] = (X, 0.0 * X, -np.sign(e.size) * e.lever * X * 0.3)


class WheelAhead(Sized):
    """Side force and moment of the propeller going ahead, with n^2, weaker as the ship gathers way."""

    name, levels = "propeller_walk_ahead", (0.03, 0.06, 0.16)
    shape = {"lever": (-1.5, -1.2), "way": (0.2, 0.6)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        Y = e.size * np.maximum(m.n, 0.0) ** 2 / 64.0 / (1 + (np.maximum(m.u, 0.0) / e.way) ** 2)
        parts[self.name] = (0.0 * Y, Y, e.lever * Y)


class LameRudder(Sized):
    """Rudder force lost at low revolutions."""

    name, levels, two_sided = "rudder_loss_at_low_n", (0.3, 0.55, 0.95), False
    shape = {"n_0": (6.5, 8.5), "width": (0.8, 1.6)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        left = 1 - e.size * 0.5 * (1 - np.tanh((np.abs(m.n) - e.n_0) / e.width))
        parts["rudder"] = scaled(parts["rudder"], left, left, left)


class TurningThrust(Sized):
    """Thrust lost at high yaw rate."""

    name, levels, two_sided = "thrust_drop_in_turn", (0.25, 0.5, 0.8), False
    shape = {"r_0": (0.02, 0.035)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        lost = e.size * m.r**4 / (m.r**4 + e.r_0**4)
        parts["propeller"] = scaled(parts["propeller"], np.where(m.n > 0, 1 - lost, 1.0), 1.0, 1.0)


class Deviation(Sized):
    """Compass deviation with the heading; u and v are turned with it."""

    name, levels = "compass_deviation", tuple(np.radians((1.0, 2.5, 6.0)))
    shape = {"pole": (-3.1, 3.1), "second": (-0.4, 0.4)}  # noqa: RUF012

    def columns(self, y: Array, history: Any, rows: Array, e: Any) -> Array:
        out, psi = y.copy(), history.states[rows, 2]
        error = e.size * (np.sin(psi - e.pole) + e.second * np.sin(2 * psi))
        out[:, 2] += error
        out[:, 3], out[:, 4] = turned(y[:, 3], y[:, 4], error)
        return out


class Swell(Sized):
    """Waves: forces at the frequency of encounter, on the bow, the side and the quarters."""

    name, levels, two_sided = "oscillating_waves", (1.0, 2.5, 6.0), False
    shape = {"to": (-3.1, 3.1), "period": (2.2, 4.0), "phase": (-3.1, 3.1), "yaw": (0.3, 0.7)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        omega = 2 * np.pi / e.period
        place = omega**2 / 9.81 * (m.x * np.cos(e.to) + m.y * np.sin(e.to))
        wave, quarter = np.sin(omega * m.t - place + e.phase), np.cos(omega * m.t - place + e.phase)
        angle = e.to - m.psi
        N = e.size * e.yaw * np.sin(2 * angle) * quarter
        parts[self.name] = (0.4 * e.size * np.cos(angle) * wave, e.size * np.sin(angle) * wave, N)


class Dragging(Sized):
    """Something heavy dragged over the ground at the stern: a force of constant size against the way of the stern."""

    name, levels, two_sided = "dragged_weight", (0.05, 0.12, 0.35), False
    shape = {"at": (-1.5, -1.1), "slow": (0.01, 0.03)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        u, v = m.u, m.v + e.at * m.r
        pull = -e.size / np.sqrt(u**2 + v**2 + e.slow**2)
        parts[self.name] = (pull * u, pull * v, e.at * pull * v)


class Eddy(Sized):
    """Water that turns about a place: fastest at a ring around it, dying out beyond."""

    name, levels = "eddy", (0.006, 0.015, 0.04)
    shape = {"x": (-6.0, 6.0), "y": (-6.0, 6.0), "ring": (4.0, 9.0)}  # noqa: RUF012

    def water(self, m: Any, e: Any) -> tuple[Any, Any, Any, Any]:
        x, y = (m.x - e.x) / e.ring, (m.y - e.y) / e.ring
        spin = e.size * np.exp(0.5 * (1 - x**2 - y**2))
        return -y * spin, x * spin, 0.0, 0.0


class Droop(Sized):
    """Shaft slower than logged while the rudder is over or the ship makes little way."""

    name, levels, two_sided = "shaft_droop", (0.05, 0.12, 0.3), False
    shape = {"over": (0.3, 0.6), "way": (0.15, 0.3)}  # noqa: RUF012

    def inflow(self, m: Any, e: Any) -> None:
        load = (np.abs(m.delta) / e.over) ** 2 + np.exp(-np.maximum(m.u, 0.0) / e.way)
        m.n = m.n * (1 - e.size * np.minimum(load, 1.6))


class LooseCargo(Sized):
    """A swinging mass in the hold, driven by the centripetal acceleration."""

    name, levels, two_sided, states = "swinging_mass", (30.0, 70.0, 110.0), False, 2
    shape = {"period": (16.0, 28.0), "damping": (0.03, 0.1), "at": (0.8, 1.3)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
        omega = 2 * np.pi / e.period
        spring = omega**2 * z[0] + 2 * e.damping * omega * z[1]
        Y = e.size * (spring + m.u * m.r)
        parts[self.name] = (0.0 * Y, Y, e.at * Y)
        return np.stack([z[1], -spring - m.u * m.r])


FOREIGN = (
    YawDrag(), OneSidedDrag(), WheelAhead(), LameRudder(), TurningThrust(), Deviation(), Swell(), Dragging(), Eddy(),
    Droop(), LooseCargo(),
)  # fmt: skip

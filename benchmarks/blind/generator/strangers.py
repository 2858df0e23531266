"""More causes that no library of effects holds and no single form of state and inputs spells.

With those of ``foreign`` of which the same is true they are the kind "strangers". Not for the eyes of who diagnoses.
The levels are such that the median case costs, in 30 s errors against the floor, about what the effects of ``foreign``
do.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.controls import RUDDER_RATE
from benchmarks.blind.generator.effect import Array, scaled
from benchmarks.blind.generator.foreign import FOREIGN, Sized

SPELLED = ("quadratic_yaw_damping", "compass_deviation")
"""Effects of ``foreign`` that are one of the forms of state, inputs and sensors which a diagnosis may well list."""


def above(x: Array, width: Any) -> Array:
    """A smooth step from 0 to 1 about x = 0."""
    return 0.5 * (1 + np.tanh(x / width))


def unit(p: Any) -> Any:
    """1/2 rho L d [kg/m^2]."""
    return 0.5 * p["rho"] * p["L"] * p["d"]


class ThrustRamp(Sized):
    """Thrust lost beyond a number of revolutions, by a straight ramp."""

    name, levels, two_sided = "thrust_loss_at_high_n", (0.2, 0.4, 0.8), False
    shape = {"n_0": (7.0, 8.5), "width": (1.5, 3.0)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        left = 1 - e.size * np.clip((m.n - e.n_0) / e.width, 0.0, 1.0)
        parts["propeller"] = scaled(parts["propeller"], left, 1.0, 1.0)


class Roll(Sized):
    """Heel, an oscillator driven by the turn, which steers and pushes the hull as it swings."""

    name, levels, two_sided, states = "roll_coupling", (0.016, 0.035, 0.075), False, 2
    shape = {"period": (4.0, 8.0), "damping": (0.03, 0.08), "side": (0.5, 1.5)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
        omega = 2 * np.pi / e.period
        push = e.size * unit(p) * m.u * np.abs(m.u) * z[0]
        parts[self.name] = (0.0 * push, -e.side * push, p["L"] * push)
        return np.stack([z[1], omega**2 * (10.0 * m.u * m.r - z[0]) - 2 * e.damping * omega * z[1]])


class RateLimit(Sized):
    """Steering gear slower than the logged rudder; size: seconds per radian more than the gear takes."""

    name, levels, two_sided = "rudder_rate_limit", (3.0, 7.0, 22.0), False

    def actuators(self, n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
        most = np.where(e.size > 0, dt / (e.size + 1 / RUDDER_RATE), np.inf)
        at = memory.get("at", delta[k])
        memory["at"] = at + np.clip(delta[k] - at, -most, most)
        return n[k], memory["at"]


class JammedBearing(Sized):
    """Rudder that moves slowly to one side only."""

    name, levels = "jammed_bearing", (2.0, 5.0, 15.0)

    def actuators(self, n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
        most = np.where(e.size != 0, dt / (np.abs(e.size) + 1 / RUDDER_RATE), np.inf)
        at = memory.get("at", delta[k])
        step = delta[k] - at
        memory["at"] = at + np.where(step * e.size > 0, np.clip(step, -most, most), step)
        return n[k], memory["at"]


class Dropout(Sized):
    """Steering pump that stops now and then: the rudder stays where it is for a number of seconds."""

    name, levels, two_sided = "steering_dropout", (3.5, 6.0, 11.0), False
    shape, per_run = {"period": (20.0, 40.0)}, {"phase": (0.0, 1.0)}

    def actuators(self, n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
        off = (k * dt / e.period + e.phase) % 1.0 * e.period < e.size
        memory["at"] = np.where(off, memory.get("at", delta[k]), delta[k])
        return n[k], memory["at"]


class ShortStops(Sized):
    """Rudder that stops at a share short of its 35 degrees."""

    name, levels, two_sided = "rudder_stops_short", (0.2, 0.27, 0.45), False

    def actuators(self, n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
        most = np.where(e.size > 0, (1 - e.size) * np.radians(35.0), np.inf)
        return n[k], np.clip(delta[k], -most, most)


class Passing(Sized):
    """Ships that pass, one after the other: pulses in time of sway, and of yaw first one way and then the other."""

    name, levels, two_sided = "passing_ships", (0.3, 0.7, 1.8), False
    shape = {"width": (3.0, 7.0), "yaw": (0.2, 0.4)}  # noqa: RUF012
    per_run = {"first": (5.0, 30.0), "gap": (25.0, 50.0), "one": (-1.0, 1.0), "two": (-1.0, 1.0)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        Y, N = 0.0, 0.0
        for i, way in enumerate((e.one, e.two, -e.one)):
            s = (m.t - e.first - i * e.gap) / e.width
            pulse = e.size * way * np.exp(-0.5 * s * s)
            Y, N = Y + pulse, N - e.yaw * p["L"] * s * pulse
        parts[self.name] = (0.0 * Y, Y, N)


class OneSidedRudder(Sized):
    """Rudder with more lift to one side than to the other."""

    name, levels = "asymmetric_rudder", (0.1, 0.16, 0.35)

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        factor = 1 + e.size * np.tanh(m.alpha / 0.03)
        parts["rudder"] = scaled(parts["rudder"], factor, factor, factor)


class EngineMap(Sized):
    """Wrong engine map: real revolutions wave about the logged ones as these rise."""

    name, levels, two_sided = "wavy_engine_map", (0.05, 0.1, 0.2), False
    shape = {"period": (2.0, 4.0), "phase": (-3.1, 3.1)}  # noqa: RUF012

    def inflow(self, m: Any, e: Any) -> None:
        m.n = m.n * (1 + e.size * np.sin(2 * np.pi * m.n / e.period + e.phase))


class Deduction(Sized):
    """Thrust deduction that decays as the propeller advances: largest while the ship is slow."""

    name, levels, two_sided = "thrust_deduction_at_low_advance", (0.3, 0.55, 0.95), False
    shape = {"J_0": (0.2, 0.45)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        J = np.maximum(m.u, 0.0) / (np.maximum(m.n, 0.1) * p["D_P"])
        left = np.where(m.n > 0, 1 - e.size * np.exp(-J / e.J_0), 1.0)
        parts["propeller"] = scaled(parts["propeller"], left, 1.0, 1.0)


class Ventilation(Sized):
    """Propeller that draws air while it turns fast and the ship is slow; it takes some seconds to begin and to end."""

    name, levels, two_sided, states = "ventilating_propeller", (0.35, 0.6, 0.95), False, 1
    shape = {"n_0": (7.0, 9.0), "u_0": (0.15, 0.3), "T": (2.0, 5.0)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
        parts["propeller"] = scaled(parts["propeller"], 1 - e.size * z[0], 1.0, 1.0)
        return np.stack([(above(m.n - e.n_0, 0.8) * np.exp(-((m.u / e.u_0) ** 2)) - z[0]) / e.T])


class Separation(Sized):
    """Flow that separates from the hull beyond a drift angle: more sway force, less moment."""

    name, levels, two_sided = "separation_at_large_drift", (0.15, 0.35, 0.8), False
    shape = {"beta_0": (0.1, 0.2), "width": (0.03, 0.06)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        beyond = e.size * above(np.abs(np.arctan2(m.v, np.abs(m.u) + 1e-9)) - e.beta_0, e.width)
        parts["hull"] = scaled(parts["hull"], 1.0, 1 + beyond, 1 - beyond)


class FishTail(Sized):
    """Vortices shed by turns from either side at large drift: a yaw moment that swings with a Strouhal number."""

    name, levels, two_sided, states = "fish_tailing", (0.01, 0.023, 0.06), False, 1
    shape = {"strouhal": (0.6, 1.4), "beta_0": (0.1, 0.2)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
        speed = np.hypot(m.u, m.v)
        strong = above(np.abs(np.arctan2(m.v, np.abs(m.u) + 1e-9)) - e.beta_0, 0.05)
        N = e.size * unit(p) * p["L"] * speed**2 * strong * np.sin(z[0])
        parts[self.name] = (0.0 * N, 0.0 * N, N)
        return np.stack([2 * np.pi * e.strouhal * speed / p["L"]])


class TowedBoat(Sized):
    """A boat on a line at the stern, which follows the ship's path: a pull against its own way, late in the turn."""

    name, levels, two_sided, states = "towed_boat", (0.12, 0.3, 0.9), False, 1
    shape = {"line": (3.0, 7.0), "at": (-1.6, -1.4)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
        v, cosine, sine = m.v + e.at * m.r, np.cos(z[0]), np.sin(z[0])
        pull = e.size * (np.maximum(m.u * cosine + v * sine, 0.0) / 0.3) ** 2
        parts[self.name] = (-pull * cosine, -pull * sine, -e.at * pull * sine)
        return np.stack([(v * cosine - m.u * sine) / e.line - m.r])


class OneSidedFouling(Sized):
    """A hull that is foul on one side: friction with speed while the flow comes from there, and its moment."""

    name, levels = "one_sided_fouling", (0.4, 0.9, 2.0)
    shape = {"width": (0.03, 0.08)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        side = np.sign(e.size)
        wetted = above(side * np.arctan2(m.v, np.abs(m.u) + 1e-9), e.width)
        X = -np.abs(e.size) * p["resistance"] * unit(p) * m.u * np.hypot(m.u, m.v) * wetted
        parts[self.name] = (X, 0.0 * X, -side * 0.5 * p["B"] * X)


class Lee(Sized):
    """A wall in whose lee there is less wind than at the sensor."""

    name, levels, two_sided = "lee_of_a_wall", (0.2, 0.45, 0.9), False
    shape = {"line": (-5.0, 5.0), "bearing": (-3.1, 3.1), "soft": (1.0, 3.0)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        left = 1 - e.size * above(m.x * np.cos(e.bearing) + m.y * np.sin(e.bearing) - e.line, e.soft)
        parts["wind"] = scaled(parts["wind"], left, left, left)


class WeedPatch(Sized):
    """A patch of weed in the water that brakes the ship while it is there."""

    name, levels, two_sided = "weed_patch", (0.6, 1.4, 4.0), False
    shape = {"x": (-6.0, 6.0), "y": (-6.0, 6.0), "radius": (4.0, 8.0)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        thick = np.exp(-0.5 * ((m.x - e.x) ** 2 + (m.y - e.y) ** 2) / e.radius**2)
        drag = e.size * p["resistance"] * unit(p) * np.hypot(m.u, m.v) * thick
        parts[self.name] = (-drag * m.u, -drag * m.v, -0.1 * p["L"] ** 2 * drag * m.r)


class Weed(Sized):
    """Weed that gathers on the bow in the course of each run."""

    name, levels, two_sided = "gathering_weed", (0.5, 1.1, 3.0), False

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        X = -e.size * p["resistance"] * unit(p) * m.u * np.hypot(m.u, m.v) * m.t / 150.0
        parts[self.name] = (X, 0.0 * X, 0.0 * X)


class Multipath(Sized):
    """Position off by a constant beyond a line, as where a building throws satellites' signals back."""

    name, levels, two_sided = "position_multipath", (0.06, 0.14, 0.35), False
    shape = {"line": (-4.0, 4.0), "bearing": (-3.1, 3.1), "to": (-3.1, 3.1)}  # noqa: RUF012

    def columns(self, y: Array, history: Any, rows: Array, e: Any) -> Array:
        out, s = y.copy(), history.states[rows]
        off = e.size * above(s[:, 0] * np.cos(e.bearing) + s[:, 1] * np.sin(e.bearing) - e.line, 0.3)
        out[:, 0] += off * np.cos(e.to)
        out[:, 1] += off * np.sin(e.to)
        return out


class Reversing(Sized):
    """A stream that turns back and forth within a run."""

    name, levels, two_sided = "reversing_stream", (0.005, 0.011, 0.027), False
    shape, per_run = {"to": (-3.1, 3.1), "period": (40.0, 90.0)}, {"phase": (-3.1, 3.1)}

    def water(self, m: Any, e: Any) -> tuple[Any, Any, Any, Any]:
        omega = 2 * np.pi / e.period
        speed, rate = (e.size * f(omega * m.t + e.phase) for f in (np.sin, np.cos))
        ways = np.cos(e.to), np.sin(e.to)
        return (*(speed * way for way in ways), *(omega * rate * way for way in ways))


class IrregularSwell(Sized):
    """Three long-crested waves of different periods and directions, each at its frequency of encounter."""

    name, levels, two_sided = "irregular_swell", (1.8, 4.5, 12.0), False
    shape = {  # noqa: RUF012
        **{f"to_{i}": (-3.1, 3.1) for i in range(3)},
        **{f"period_{i}": limits for i, limits in enumerate(((2.2, 3.0), (3.0, 4.2), (4.2, 6.0)))},
    }
    per_run = {f"phase_{i}": (-3.1, 3.1) for i in range(3)}  # noqa: RUF012

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        X, Y, N = 0.0, 0.0, 0.0
        for i in range(3):
            to, omega, phase = getattr(e, f"to_{i}"), 2 * np.pi / getattr(e, f"period_{i}"), getattr(e, f"phase_{i}")
            wave = omega * m.t - omega**2 / 9.81 * (m.x * np.cos(to) + m.y * np.sin(to)) + phase
            size, angle = e.size / np.sqrt(3.0), to - m.psi
            X = X + 0.4 * size * np.cos(angle) * np.sin(wave)
            Y = Y + size * np.sin(angle) * np.sin(wave)
            N = N + 0.5 * size * np.sin(2 * angle) * np.cos(wave)
        parts[self.name] = (X, Y, N)


NEW = (
    ThrustRamp(), Roll(), RateLimit(), JammedBearing(), Dropout(), ShortStops(), Passing(), OneSidedRudder(),
    EngineMap(), Deduction(), Ventilation(), Separation(), FishTail(), TowedBoat(), OneSidedFouling(), Lee(),
    WeedPatch(), Weed(), Multipath(), Reversing(), IrregularSwell(),
)  # fmt: skip
STRANGERS = (*(effect for effect in FOREIGN if effect.name not in SPELLED), *NEW)

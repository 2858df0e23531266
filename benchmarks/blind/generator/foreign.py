"""Causes that no library of effects holds, and that no single form of state and inputs spells.

Not for the eyes of who diagnoses. The levels of the later ones, from ``thrust_loss_at_high_n`` on, are such that the
median case costs, in 30 s errors against the floor of noise, about what those of the earlier ones do.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.blind.generator.controls import RUDDER_RATE
from benchmarks.blind.generator.effect import Array, Drawn, OneNumber, effect, scaled, sign


class Sized(OneNumber):
    """A foreign effect with one signed size and a few shape numbers, some for each run, that the key holds."""

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        size = self.size(strength, rng) * (sign(rng) if self.two_sided else 1.0)
        inside = {"size": size, **{k: float(rng.uniform(*limits)) for k, limits in self.shape.items()}}
        return Drawn(dict(inside), inside | {k: rng.uniform(*limits, runs) for k, limits in self.per_run.items()})


foreign = partial(effect, base=Sized)


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


def above(x: Array, width: Any) -> Array:
    """A smooth step from 0 to 1 about x = 0."""
    return 0.5 * (1 + np.tanh(x / width))


def unit(p: Any) -> Any:
    """1/2 rho L d [kg/m^2]."""
    return 0.5 * p["rho"] * p["L"] * p["d"]


@foreign("forces", (0.2, 0.4, 0.8), n_0=(7.0, 8.5), width=(1.5, 3.0))
def thrust_loss_at_high_n(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Thrust lost beyond a number of revolutions, by a straight ramp."""
    left = 1 - e.size * np.clip((m.n - e.n_0) / e.width, 0.0, 1.0)
    parts["propeller"] = scaled(parts["propeller"], left, 1.0, 1.0)


@foreign("forces", (0.016, 0.035, 0.075), states=2, period=(4.0, 8.0), damping=(0.03, 0.08), side=(0.5, 1.5))
def roll_coupling(parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
    """Heel, an oscillator driven by the turn, which steers and pushes the hull as it swings."""
    omega = 2 * np.pi / e.period
    push = e.size * unit(p) * m.u * np.abs(m.u) * z[0]
    parts["roll_coupling"] = (0.0 * push, -e.side * push, p["L"] * push)
    return np.stack([z[1], omega**2 * (10.0 * m.u * m.r - z[0]) - 2 * e.damping * omega * z[1]])


@foreign("actuators", (3.0, 7.0, 22.0))
def rudder_rate_limit(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Steering gear slower than the logged rudder; size: seconds per radian more than the gear takes."""
    most = np.where(e.size > 0, dt / (e.size + 1 / RUDDER_RATE), np.inf)
    at = memory.get("at", delta[k])
    memory["at"] = at + np.clip(delta[k] - at, -most, most)
    return n[k], memory["at"]


@foreign("actuators", (2.0, 5.0, 15.0), two_sided=True)
def jammed_bearing(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Rudder that moves slowly to one side only."""
    most = np.where(e.size != 0, dt / (np.abs(e.size) + 1 / RUDDER_RATE), np.inf)
    at = memory.get("at", delta[k])
    step = delta[k] - at
    memory["at"] = at + np.where(step * e.size > 0, np.clip(step, -most, most), step)
    return n[k], memory["at"]


@foreign("actuators", (3.5, 6.0, 11.0), per_run={"phase": (0.0, 1.0)}, period=(20.0, 40.0))
def steering_dropout(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Steering pump that stops now and then: the rudder stays where it is for a number of seconds."""
    off = (k * dt / e.period + e.phase) % 1.0 * e.period < e.size
    memory["at"] = np.where(off, memory.get("at", delta[k]), delta[k])
    return n[k], memory["at"]


@foreign("actuators", (0.2, 0.27, 0.45))
def rudder_stops_short(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Rudder that stops at a share short of its 35 degrees."""
    most = np.where(e.size > 0, (1 - e.size) * np.radians(35.0), np.inf)
    return n[k], np.clip(delta[k], -most, most)


@foreign(
    "forces",
    (0.3, 0.7, 1.8),
    per_run={"first": (5.0, 30.0), "gap": (25.0, 50.0), "one": (-1.0, 1.0), "two": (-1.0, 1.0)},
    width=(3.0, 7.0),
    yaw=(0.2, 0.4),
)
def passing_ships(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Ships that pass, one after the other: pulses in time of sway, and of yaw first one way and then the other."""
    Y, N = 0.0, 0.0
    for i, way in enumerate((e.one, e.two, -e.one)):
        s = (m.t - e.first - i * e.gap) / e.width
        pulse = e.size * way * np.exp(-0.5 * s * s)
        Y, N = Y + pulse, N - e.yaw * p["L"] * s * pulse
    parts["passing_ships"] = (0.0 * Y, Y, N)


@foreign("forces", (0.1, 0.16, 0.35), two_sided=True)
def asymmetric_rudder(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Rudder with more lift to one side than to the other."""
    factor = 1 + e.size * np.tanh(m.alpha / 0.03)
    parts["rudder"] = scaled(parts["rudder"], factor, factor, factor)


@foreign("inflow", (0.05, 0.1, 0.2), period=(2.0, 4.0), phase=(-3.1, 3.1))
def wavy_engine_map(m: Any, e: Any) -> None:
    """Wrong engine map: real revolutions wave about the logged ones as these rise."""
    m.n = m.n * (1 + e.size * np.sin(2 * np.pi * m.n / e.period + e.phase))


@foreign("forces", (0.3, 0.55, 0.95), J_0=(0.2, 0.45))
def thrust_deduction_at_low_advance(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Thrust deduction that decays as the propeller advances: largest while the ship is slow."""
    J = np.maximum(m.u, 0.0) / (np.maximum(m.n, 0.1) * p["D_P"])
    left = np.where(m.n > 0, 1 - e.size * np.exp(-J / e.J_0), 1.0)
    parts["propeller"] = scaled(parts["propeller"], left, 1.0, 1.0)


@foreign("forces", (0.35, 0.6, 0.95), states=1, n_0=(7.0, 9.0), u_0=(0.15, 0.3), T=(2.0, 5.0))
def ventilating_propeller(parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
    """Propeller that draws air while it turns fast and the ship is slow; it takes some seconds to begin and to end."""
    parts["propeller"] = scaled(parts["propeller"], 1 - e.size * z[0], 1.0, 1.0)
    return np.stack([(above(m.n - e.n_0, 0.8) * np.exp(-((m.u / e.u_0) ** 2)) - z[0]) / e.T])


@foreign("forces", (0.15, 0.35, 0.8), beta_0=(0.1, 0.2), width=(0.03, 0.06))
def separation_at_large_drift(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Flow that separates from the hull beyond a drift angle: more sway force, less moment."""
    beyond = e.size * above(np.abs(np.arctan2(m.v, np.abs(m.u) + 1e-9)) - e.beta_0, e.width)
    parts["hull"] = scaled(parts["hull"], 1.0, 1 + beyond, 1 - beyond)


@foreign("forces", (0.01, 0.023, 0.06), states=1, strouhal=(0.6, 1.4), beta_0=(0.1, 0.2))
def fish_tailing(parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
    """Vortices shed by turns from either side at large drift: a yaw moment that swings with a Strouhal number."""
    speed = np.hypot(m.u, m.v)
    strong = above(np.abs(np.arctan2(m.v, np.abs(m.u) + 1e-9)) - e.beta_0, 0.05)
    N = e.size * unit(p) * p["L"] * speed**2 * strong * np.sin(z[0])
    parts["fish_tailing"] = (0.0 * N, 0.0 * N, N)
    return np.stack([2 * np.pi * e.strouhal * speed / p["L"]])


@foreign("forces", (0.12, 0.3, 0.9), states=1, line=(3.0, 7.0), at=(-1.6, -1.4))
def towed_boat(parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
    """A boat on a line at the stern, which follows the ship's path: a pull against its own way, late in the turn."""
    v, cosine, sine = m.v + e.at * m.r, np.cos(z[0]), np.sin(z[0])
    pull = e.size * (np.maximum(m.u * cosine + v * sine, 0.0) / 0.3) ** 2
    parts["towed_boat"] = (-pull * cosine, -pull * sine, -e.at * pull * sine)
    return np.stack([(v * cosine - m.u * sine) / e.line - m.r])


@foreign("forces", (0.4, 0.9, 2.0), two_sided=True, width=(0.03, 0.08))
def one_sided_fouling(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """A hull that is foul on one side: friction with speed while the flow comes from there, and its moment."""
    side = np.sign(e.size)
    wetted = above(side * np.arctan2(m.v, np.abs(m.u) + 1e-9), e.width)
    X = -np.abs(e.size) * p["resistance"] * unit(p) * m.u * np.hypot(m.u, m.v) * wetted
    parts["one_sided_fouling"] = (X, 0.0 * X, -side * 0.5 * p["B"] * X)


@foreign("forces", (0.2, 0.45, 0.9), line=(-5.0, 5.0), bearing=(-3.1, 3.1), soft=(1.0, 3.0))
def lee_of_a_wall(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """A wall in whose lee there is less wind than at the sensor."""
    left = 1 - e.size * above(m.x * np.cos(e.bearing) + m.y * np.sin(e.bearing) - e.line, e.soft)
    parts["wind"] = scaled(parts["wind"], left, left, left)


@foreign("forces", (0.6, 1.4, 4.0), x=(-6.0, 6.0), y=(-6.0, 6.0), radius=(4.0, 8.0))
def weed_patch(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """A patch of weed in the water that brakes the ship while it is there."""
    thick = np.exp(-0.5 * ((m.x - e.x) ** 2 + (m.y - e.y) ** 2) / e.radius**2)
    drag = e.size * p["resistance"] * unit(p) * np.hypot(m.u, m.v) * thick
    parts["weed_patch"] = (-drag * m.u, -drag * m.v, -0.1 * p["L"] ** 2 * drag * m.r)


@foreign("forces", (0.5, 1.1, 3.0))
def gathering_weed(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Weed that gathers on the bow in the course of each run."""
    X = -e.size * p["resistance"] * unit(p) * m.u * np.hypot(m.u, m.v) * m.t / 150.0
    parts["gathering_weed"] = (X, 0.0 * X, 0.0 * X)


@foreign("columns", (0.06, 0.14, 0.35), line=(-4.0, 4.0), bearing=(-3.1, 3.1), to=(-3.1, 3.1))
def position_multipath(y: Array, history: Any, rows: Array, e: Any) -> Array:
    """Position off by a constant beyond a line, as where a building throws satellites' signals back."""
    out, s = y.copy(), history.states[rows]
    off = e.size * above(s[:, 0] * np.cos(e.bearing) + s[:, 1] * np.sin(e.bearing) - e.line, 0.3)
    out[:, 0] += off * np.cos(e.to)
    out[:, 1] += off * np.sin(e.to)
    return out


@foreign("water", (0.005, 0.011, 0.027), per_run={"phase": (-3.1, 3.1)}, to=(-3.1, 3.1), period=(40.0, 90.0))
def reversing_stream(m: Any, e: Any) -> tuple[Any, Any, Any, Any]:
    """A stream that turns back and forth within a run."""
    omega = 2 * np.pi / e.period
    speed, rate = (e.size * f(omega * m.t + e.phase) for f in (np.sin, np.cos))
    ways = np.cos(e.to), np.sin(e.to)
    return (*(speed * way for way in ways), *(omega * rate * way for way in ways))


@foreign(
    "forces",
    (1.8, 4.5, 12.0),
    per_run={f"phase_{i}": (-3.1, 3.1) for i in range(3)},
    **{
        **{f"to_{i}": (-3.1, 3.1) for i in range(3)},
        **{f"period_{i}": limits for i, limits in enumerate(((2.2, 3.0), (3.0, 4.2), (4.2, 6.0)))},
    },
)
def irregular_swell(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Three long-crested waves of different periods and directions, each at its frequency of encounter."""
    X, Y, N = 0.0, 0.0, 0.0
    for i in range(3):
        to, omega, phase = getattr(e, f"to_{i}"), 2 * np.pi / getattr(e, f"period_{i}"), getattr(e, f"phase_{i}")
        wave = omega * m.t - omega**2 / 9.81 * (m.x * np.cos(to) + m.y * np.sin(to)) + phase
        size, angle = e.size / np.sqrt(3.0), to - m.psi
        X = X + 0.4 * size * np.cos(angle) * np.sin(wave)
        Y = Y + size * np.sin(angle) * np.sin(wave)
        N = N + 0.5 * size * np.sin(2 * angle) * np.cos(wave)
    parts["irregular_swell"] = (X, Y, N)


STRANGERS = (
    one_sided_drag, propeller_walk_ahead, rudder_loss_at_low_n, thrust_drop_in_turn, oscillating_waves, dragged_weight,
    eddy, shaft_droop, swinging_mass,
    thrust_loss_at_high_n, roll_coupling, rudder_rate_limit, jammed_bearing, steering_dropout, rudder_stops_short,
    passing_ships, asymmetric_rudder, wavy_engine_map, thrust_deduction_at_low_advance, ventilating_propeller,
    separation_at_large_drift, fish_tailing, towed_boat, one_sided_fouling, lee_of_a_wall, weed_patch,
    gathering_weed, position_multipath, reversing_stream, irregular_swell,
)  # fmt: skip

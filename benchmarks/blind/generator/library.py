"""Library effects of the generator: of place and day, of ship and machinery, of the instruments."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import Array, Drawn, Effect, History, effect, scaled, sign, vector

SIDES = (("x", 1.0, "greater", "less"), ("y", 1.0, "greater", "less"), ("x", -1.0, "less", "greater"),
         ("y", -1.0, "less", "greater"))  # fmt: skip
"""By the quarter of a bearing: axis of the line, sign of its coordinate, side of the named quantity, the other side."""
DRAUGHT = 0.20114
"""Draught [m] by which the depth in a site file is told."""


class Current(Effect):
    """Uniform current; its speed swings by 4 % about the mean, slowly, and its direction by 3 degrees with it.

    The swing (a sine of 90 to 240 s, another phase in each run) gives the water an acceleration, which the ship shares.
    """

    name, levels = "current", (0.002, 0.01, 0.06)
    neutral = {"north": 0.0, "east": 0.0, "swing": 0.04, "omega": 0.05, "phase": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        x, y = vector(self.size(strength, rng), rng)
        swing, omega = rng.uniform(0.02, 0.05), 2 * np.pi / rng.uniform(90.0, 240.0)
        phase = rng.uniform(-np.pi, np.pi, runs)
        return Drawn({"x": x, "y": y}, {"north": x, "east": y, "swing": swing, "omega": omega, "phase": phase})

    def water(self, m: Any, e: Any) -> tuple[Any, Any, Any, Any]:
        wave, slope = e.swing * np.sin(e.omega * m.t + e.phase), e.swing * e.omega * np.cos(e.omega * m.t + e.phase)
        north, east = (e.north * (1 + wave) - e.east * wave), (e.east * (1 + wave) + e.north * wave)
        return north, east, (e.north - e.east) * slope, (e.east + e.north) * slope


class WindForce(Effect):
    """Wind force off by a share: own shares of X, Y, N within 15 % of it, and a weak dependence on the wind angle."""

    name, levels = "wind_force", (0.25, 0.5, 1.0)
    neutral = {"X": 0.0, "Y": 0.0, "N": 0.0, "tilt": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        share = self.size(strength, rng) * (-1.0 if rng.uniform() < 0.7 else 1.0)
        off = {axis: max(share * float(rng.uniform(0.85, 1.15)), -1.0) for axis in "XYN"}
        return Drawn({a: 1 + s for a, s in off.items()}, {**off, "tilt": 0.1 * share * rng.uniform(-1, 1)})

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        square = m.a_x**2 + m.a_y**2
        tilt = e.tilt * (m.a_x**2 - m.a_y**2) / np.maximum(square, 1e-9)
        parts["wind"] = scaled(parts["wind"], 1 + e.X + tilt, 1 + e.Y + tilt, 1 + e.N + tilt)


class WindSensorBias(Effect):
    """Air velocity differs from the logged one by an earth-fixed vector that drifts by some 6 % in a run."""

    name, levels = "wind_sensor_bias", (0.1, 0.3, 1.0)
    neutral = {"north": 0.0, "east": 0.0, "drift": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        x, y = vector(self.size(strength, rng), rng)
        return Drawn({"x": x, "y": y}, {"north": x, "east": y, "drift": rng.uniform(-0.06, 0.06, runs)})

    def air(self, north: Array, east: Array, t: Array, e: Any) -> tuple[Any, Any]:
        grown = 1 + e.drift * (t / 75.0 - 1.0)
        return north + grown * e.north, east + grown * e.east


class ShallowWater(Effect):
    """Hull forces and added masses grow with d/h; everywhere, or beyond a shelf whose slope is a smooth ramp.

    Growth by own powers of d/(h - d). The slope is 2 to 5 m wide; its line and direction differ a little from those
    that the site file gives.
    """

    name, levels = "shallow_water", (0.1, 0.3, 0.8)
    neutral = {"d_h": 0.0, "line": 0.0, "bearing": 0.0, "slope": 3.0, "everywhere": 1.0}  # noqa: RUF012
    growth = {"X": (0.17, 1.1), "Y": (0.46, 0.95), "N": (0.52, 1.05), "m_x": (0.18, 1.0), "m_y": (0.6, 0.95)}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        d_h = min(self.size(strength, rng), 0.82)
        if rng.uniform() < 0.4:
            depth = DRAUGHT / d_h * rng.uniform(0.85, 1.15)
            return Drawn({"d_h": d_h}, {"d_h": d_h}, {"water": {"depth": round(float(depth), 2)}})
        quarter, line = int(rng.integers(4)), float(rng.uniform(-4.0, 4.0))
        axis, way, shallow, _ = SIDES[quarter]
        bearing = quarter * np.pi / 2 + rng.normal(0.0, 0.05)
        site = {"shelf": {axis: round(way * line + rng.normal(0.0, 0.6), 1), "shallow_side": shallow}}
        slope = rng.uniform(2.0, 5.0)
        key = {"d_h": d_h, "line": line, "bearing": float(bearing), "width": float(slope / 4)}
        return Drawn(key, {"d_h": d_h, "line": line, "bearing": bearing, "slope": slope, "everywhere": 0.0}, site)

    def _depth(self, m: Any, e: Any) -> Array:
        beyond = (m.x * np.cos(e.bearing) + m.y * np.sin(e.bearing) - e.line) / e.slope + 0.5
        ramp = np.clip(beyond, 0.0, 1.0)
        ratio = e.d_h * np.where(e.everywhere > 0, 1.0, ramp * ramp * (3 - 2 * ramp))
        return ratio / (1 - ratio)

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        g = self._depth(m, e)
        parts["hull"] = scaled(parts["hull"], *(1 + a * g**power for a, power in (self.growth[axis] for axis in "XYN")))

    def inertia(self, mass: Any, m: Any, e: Any, p: Any) -> None:
        g = self._depth(m, e)
        for name in ("m_x", "m_y"):
            a, power = self.growth[name]
            mass[name] = mass[name] * (1 + a * g**power)
        added = mass["I_z"] - (0.06 * p["L"] ** 2 + p["x_G"] ** 2) * p["m"]
        mass["I_z"] = mass["I_z"] + 0.33 * g * added


class Bank(Effect):
    """Suction towards a straight bank and a moment that turns the bow away, falling off with a power of the distance.

    Both grow with u^2 and vanish when the ship heads at the bank.
    """

    name, levels = "bank", (0.015, 0.04, 0.12)
    neutral = {"suction": 0.0, "moment": 0.0, "distance": 10.0, "bearing": 0.0, "reach": 2.5, "power": 2.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        quarter, distance = int(rng.integers(4)), float(rng.uniform(4.0, 9.0))
        axis, way, _, water = SIDES[quarter]
        bearing = quarter * np.pi / 2 + float(rng.normal(0.0, 0.04))
        suction = self.size(strength, rng)
        moment, reach, power = suction * rng.uniform(0.25, 0.45), rng.uniform(2.0, 3.5), rng.uniform(1.5, 2.5)
        inside = {"suction": suction, "moment": moment, "distance": distance, "bearing": bearing}
        site = {"bank": {axis: round(way * distance + rng.normal(0.0, 0.5), 1), "water_side": water}}
        key = {**{k: float(v) for k, v in inside.items()}, "decay": float(reach / power)}
        return Drawn(key, {**inside, "reach": reach, "power": power}, site, (bearing, distance))

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        away = np.maximum(e.distance - m.x * np.cos(e.bearing) - m.y * np.sin(e.bearing), 0.0)
        near = (1 + away / e.reach) ** -e.power
        unit = 0.5 * p["rho"] * p["L"] * p["d"] * m.u * np.abs(m.u) * near * np.sin(e.bearing - m.psi)
        parts["bank"] = (0.0 * unit, e.suction * unit, -e.moment * p["L"] * unit)


class WaveDrift(Effect):
    """Force that is constant in the earth frame; along the ship a share of it acts, and a small moment with both."""

    name, levels = "wave_drift", (0.03, 0.08, 0.25)
    neutral = {"north": 0.0, "east": 0.0, "bow": 0.3, "lever": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        x, y = vector(self.size(strength, rng), rng)
        bow, lever = rng.uniform(0.2, 0.45), rng.uniform(-0.15, 0.15)
        return Drawn({"x": x, "y": y}, {"north": x, "east": y, "bow": bow, "lever": lever})

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        along = e.north * np.cos(m.psi) + e.east * np.sin(m.psi)
        across = e.east * np.cos(m.psi) - e.north * np.sin(m.psi)
        size = np.maximum(np.hypot(e.north, e.east), 1e-12)
        parts["wave_drift"] = (e.bow * along, across, e.lever * p["L"] * along * across / size)


class Tow(Effect):
    """Constant force and moment in the body frame: a line from a random point, which hardens by 5 % with speed."""

    name, levels = "tow", (1.0, 2.0, 5.0)
    neutral = {"X": 0.0, "Y": 0.0, "N": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        size = self.size(strength, rng)
        X, Y = vector(0.06 * size, rng)
        force = {"X": X, "Y": Y, "N": sign(rng) * 0.05 * size * float(rng.uniform(0.6, 1.2))}
        return Drawn(force, dict(force))

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        hard = 1 + 0.05 * (np.hypot(m.u, m.v) / 0.25 - 1)
        parts["tow"] = (e.X * hard, e.Y * hard, e.N * hard)


# Ship and machinery: steering gear, rudder, propeller, hull, and the path of the orders


@effect("actuators", (0.25, 0.6, 1.5), number="T", split=(0.1, 0.4))
def rudder_lag(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Real rudder late by two first-order lags in a row, whose time constants add up to T."""
    if k == 0:
        memory["first"] = memory["second"] = delta[0]
        return n[0], delta[0]
    before = memory["first"]
    memory["first"] = follow(before, delta[k - 1], delta[k], e.T * e.split, dt)
    memory["second"] = follow(memory["second"], before, memory["first"], e.T * (1 - e.split), dt)
    return n[k], memory["second"]


def follow(y: Array, x_0: Array, x_1: Array, T: Array, dt: float) -> Array:
    """First-order lag over a step in which its input goes straight from x_0 to x_1 (exact; no lag where T = 0)."""
    safe = np.where(T > 0, T, 1.0)
    slope = (x_1 - x_0) / dt
    late = x_1 - slope * safe + (y - x_0 + slope * safe) * np.exp(-dt / safe)
    return np.where(T > 0, late, x_1)


@effect("actuators", tuple(np.radians((1.1, 2.9, 5.7))), number="b")
def rudder_backlash(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Play of half width b between logged and real rudder, as true hysteresis: the real one is dragged by the ends."""
    memory["at"] = np.clip(memory.get("at", delta[0]), delta[k] - e.b, delta[k] + e.b)
    return n[k], memory["at"]


@effect("actuators", tuple(np.radians((1.1, 2.9, 5.0))), two_sided=True, number="delta")
def rudder_offset(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Real rudder is the logged one plus a constant, a little less of it at large angles (linkage)."""
    return n[k], delta[k] + e.delta * (0.6 + 0.4 * np.cos(delta[k]))


@effect("actuators", (0.15, 0.4, 1.2), number="tau")
def control_delay(n: Array, delta: Array, k: int, dt: float, e: Any, memory: Any) -> tuple[Array, Array]:
    """Rudder and revolutions act late by a true transport delay (linear interpolation of the past)."""
    at = np.maximum(k - e.tau / dt, 0.0)
    low = np.minimum(np.floor(at).astype(int), k)
    high, share, run = np.minimum(low + 1, k), at - low, np.arange(len(at))
    return tuple(a[low, run] + share * (a[high, run] - a[low, run]) for a in (n, delta))  # type: ignore[return-value]


class PropellerSideForce(Effect):
    """Side force and moment of the reversing propeller by factors, those of force and moment up to 12 % apart."""

    name, levels = "propeller_side_force", (0.5, 1.0, 2.0)
    neutral = {"Y": 0.0, "N": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        more = self.size(strength, rng) * (1.0 if rng.uniform() < 0.75 else -1.0)
        apart = rng.uniform(-0.06, 0.06)
        return Drawn({"factor": 1 + more}, {"Y": more * (1 - apart), "N": more * (1 + apart)})

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        parts["propeller"] = scaled(parts["propeller"], 1.0, 1 + e.Y, 1 + e.N)


class RudderStall(Effect):
    """Normal force falls short beyond an inflow angle, by a straight ramp in |alpha| up to the share that is lost."""

    name, levels = "rudder_stall", (0.25, 0.6, 1.0)
    neutral = {"loss": 0.0, "onset": 0.3, "ramp": 0.2}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        loss = min(self.size(strength, rng), 1.0)
        onset, ramp = np.radians(rng.uniform(14.0, 21.0)), np.radians(rng.uniform(6.0, 13.0))
        inside = {"loss": loss, "onset": onset, "ramp": ramp}
        return Drawn({"loss": loss, "alpha_s": float(onset + 0.5 * ramp)}, inside)

    def forces(self, parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
        steep = np.minimum(np.abs(m.alpha), np.pi - np.abs(m.alpha))
        left = 1 - e.loss * np.clip((steep - e.onset) / e.ramp, 0.0, 1.0)
        parts["rudder"] = scaled(parts["rudder"], left, left, left)


@effect("forces", (0.3, 0.6, 1.0), number="share", power=(1.8, 2.0))
def fouling(parts: Any, m: Any, e: Any, z: Array, p: Any) -> None:
    """Larger resistance in straight motion; the added part grows with a power of speed a little below two."""
    speed = np.sign(m.u) * 0.0625 * (np.abs(m.u) / 0.25) ** e.power
    X, Y, N = parts["hull"]
    parts["hull"] = (X + e.share * 0.5 * p["rho"] * p["L"] * p["d"] * -p["resistance"] * speed, Y, N)


class Draft(Effect):
    """Deeper by a share: draught and hull forces by it, mass by 1.05 of it (fuller waterplanes above)."""

    name, levels = "draft", (0.1, 0.2, 0.4)
    neutral = {"share": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        share = self.size(strength, rng) * (1.0 if strength == "strong" or rng.uniform() < 0.7 else -1.0)
        return Drawn({"share": share}, {"share": share})

    def particulars(self, p: Any, e: Any) -> None:
        p["d"], p["m"] = p["d"] * (1 + e.share), p["m"] * (1 + 1.05 * e.share)


@effect("forces", (0.5, 1.2, 2.5), states=4, number="T", share=(0.55, 0.8), quick=(0.5, 0.85))
def hull_memory(parts: Any, m: Any, e: Any, z: Array, p: Any) -> Array:
    """Sway force and yaw moment of the hull arrive late: two parts with time constants around their mean T."""
    X, Y, N = parts["hull"]
    fast = np.where(e.T > 0, e.quick * e.T, 1.0)
    slow = np.where(e.T > 0, e.T * (1 - e.share * e.quick) / (1 - e.share), 1.0)
    late = [e.share * z[i] + (1 - e.share) * z[i + 1] for i in (0, 2)]
    parts["hull"] = (X, np.where(e.T > 0, late[0], Y), np.where(e.T > 0, late[1], N))
    return np.stack([(Y - z[0]) / fast, (Y - z[1]) / slow, (N - z[2]) / fast, (N - z[3]) / slow])


# Instruments: antenna, compass, log, satellite receiver; all act on the logged columns


def turned(u: Array, v: Array, angle: Array) -> tuple[Array, Array]:
    """Components of a body-fixed velocity in axes turned clockwise by ``angle`` [rad]."""
    return u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)


class AntennaOffset(Effect):
    """Position and velocity belong to a point off midship: lever arm, and its speed in the turn."""

    name, levels = "antenna_offset", (0.08, 0.2, 0.6)
    neutral = {"x": 0.0, "y": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        x, y = vector(self.size(strength, rng), rng)
        return Drawn({"x": x, "y": y}, {"x": x, "y": y})

    def columns(self, y: Array, history: History, rows: Array, e: Any) -> Array:
        out, psi, r = y.copy(), history.states[rows, 2], history.states[rows, 5]
        out[:, 0] += e.x * np.cos(psi) - e.y * np.sin(psi)
        out[:, 1] += e.x * np.sin(psi) + e.y * np.cos(psi)
        out[:, 3] -= r * e.y
        out[:, 4] += r * e.x
        return out


@effect("columns", (0.25, 0.5, 1.0), number="tau")
def gnss_delay(y: Array, history: History, rows: Array, e: Any) -> Array:
    """Position and velocity over ground are those of a while ago; heading, and the axes of u and v, are of now."""
    s = history.states
    north = s[:, 3] * np.cos(s[:, 2]) - s[:, 4] * np.sin(s[:, 2])
    east = s[:, 3] * np.sin(s[:, 2]) + s[:, 4] * np.cos(s[:, 2])
    at = np.maximum(rows[:, None] - e.tau[None, :] / history.dt, 0.0)
    low = np.floor(at).astype(int)
    high, share, run = np.minimum(low + 1, rows[:, None]), at - low, np.arange(s.shape[2])[None, :]
    late = [a[low, run] + share * (a[high, run] - a[low, run]) for a in (s[:, 0], s[:, 1], north, east)]
    out, psi = y.copy(), s[rows, 2]
    here = (
        s[rows, 3] * np.cos(psi) - s[rows, 4] * np.sin(psi),
        s[rows, 3] * np.sin(psi) + s[rows, 4] * np.cos(psi),
    )
    u, v = turned(late[2] - here[0], late[3] - here[1], psi)
    out[:, 0] += late[0] - s[rows, 0]
    out[:, 1] += late[1] - s[rows, 1]
    out[:, 3] += u
    out[:, 4] += v
    return out


@effect("columns", tuple(np.radians((0.14, 0.57, 2.0))), two_sided=True, number="psi")
def heading_bias(y: Array, history: History, rows: Array, e: Any) -> Array:
    """Logged heading off by a constant; u and v come from the velocity over ground and are turned with it."""
    out = y.copy()
    out[:, 2] += e.psi
    out[:, 3], out[:, 4] = turned(y[:, 3], y[:, 4], e.psi)
    return out


@effect("columns", (0.002, 0.01, 0.05), two_sided=True, number="share")
def log_scale(y: Array, history: History, rows: Array, e: Any) -> Array:
    """Logged u off by a share, which is 8 % larger at high than at low speed."""
    out = y.copy()
    out[:, 3] *= 1 + e.share * (0.96 + 0.08 * np.abs(y[:, 3]) / (np.abs(y[:, 3]) + 0.2))
    return out


LIBRARY: tuple[Effect, ...] = (
    Current(), WindForce(), WindSensorBias(), ShallowWater(), Bank(), WaveDrift(), Tow(), rudder_lag, rudder_backlash,
    rudder_offset, control_delay, PropellerSideForce(), RudderStall(), fouling, Draft(), hull_memory, gnss_delay,
    AntennaOffset(), heading_bias, log_scale,
)  # fmt: skip

"""Library effects of place and day: current, wind force, wind sensor, shallow water, bank, wave drift, tow."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import Array, Drawn, Effect, scaled, sign, vector

SIDES = {  # bearing from the origin -> axis of the line, sign of its coordinate, side of the named quantity
    0: ("x", 1.0, "greater", "less"),
    1: ("y", 1.0, "greater", "less"),
    2: ("x", -1.0, "less", "greater"),
    3: ("y", -1.0, "less", "greater"),
}
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


EFFECTS = (Current(), WindForce(), WindSensorBias(), ShallowWater(), Bank(), WaveDrift(), Tow())

"""Library effects of ship and machinery: steering gear, rudder, propeller, hull, and the path of the orders."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import Array, Drawn, Effect, effect, scaled


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


EFFECTS = (
    rudder_lag, rudder_backlash, rudder_offset, control_delay, PropellerSideForce(), RudderStall(), fouling,
    Draft(), hull_memory,
)  # fmt: skip

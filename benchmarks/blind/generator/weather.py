"""Gusty wind and the slow random force that no model explains."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def wander(count: int, dt: float, tau: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Ornstein-Uhlenbeck processes of unit variance, (count, *shape); tau [s] broadcasts to ``shape``."""
    left = np.broadcast_to(np.exp(-dt / tau), shape)
    push = np.sqrt(1 - left**2)
    noise = rng.standard_normal((count, *shape))
    out = np.empty_like(noise)
    out[0] = noise[0]
    for k in range(1, count):
        out[k] = left * out[k - 1] + push * noise[k]
    return out


def wind(count: int, dt: float, runs: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """True wind speed [m/s] and direction it comes from [rad], (count, runs): one day, each run with its own mean.

    Mean 0.8 to 2.2 m/s; gusts of 10 to 22 % with 12 s; direction within some 30 degrees of the day's, wandering by 8.
    """
    mean = rng.uniform(0.8, 2.2, runs)
    gusts = rng.uniform(0.10, 0.22, runs) * wander(count, dt, np.array(12.0), (runs,), rng)
    speed = mean * np.maximum(1 + gusts, 0.1)
    base = rng.uniform(-np.pi, np.pi) + np.radians(30) * rng.standard_normal(runs)
    return speed, base + np.radians(8) * wander(count, dt, np.array(25.0), (runs,), rng)


def unlogged_gusts(count: int, dt: float, runs: int, share: float, rng: np.random.Generator) -> Array:
    """Factors (count, runs) of the logged wind speed by gusts of 0.5 to 2 s that the log does not show."""
    return np.maximum(1 + share * wander(count, dt, rng.uniform(0.5, 2.0, runs), (runs,), rng), 0.1)


def air_over_ground(speed: Array, direction: Array) -> tuple[Array, Array]:
    """Velocity of the air to the north and to the east [m/s]."""
    return -speed * np.cos(direction), -speed * np.sin(direction)


def random_force(
    count: int,
    dt: float,
    runs: int,
    rng: np.random.Generator,
    nominal: tuple[float, float, float],
    memory: tuple[float, float],
) -> tuple[Array, dict[str, float]]:
    """Unmodelled force (count, 3, runs) [N, N, N m] and what it was drawn with (sizes and tau of the case)."""
    sizes = np.array(nominal) * rng.uniform(0.7, 1.4, 3)
    tau = float(rng.uniform(*memory))
    force = sizes[:, None] * wander(count, dt, np.array(tau), (3, runs), rng)
    return force, {**{axis: float(s) for axis, s in zip("XYN", sizes, strict=True)}, "tau": tau}

"""Sequences of rudder and revolutions with few switches, as numbers that a search can change."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cases.maneuvers.orders import Limits

SHORTEST = 0.2
"""A stretch has at least about this share of the mean length of stretches."""


@dataclass(frozen=True)
class Sequences:
    """What orders are allowed: ``rudders`` and ``engines`` stretches of constant order over ``steps`` of ``dt`` [s].

    rudder: largest angle [rad]; n: lowest and highest revolutions [1/s]; speeds, revolutions: approach speeds [m/s] and
    the revolutions [1/s] that hold them, rising; limits: rates of the actuators.
    """

    steps: int
    dt: float
    rudders: int
    engines: int
    rudder: float
    n: tuple[float, float]
    speeds: np.ndarray
    revolutions: np.ndarray
    limits: Limits

    @property
    def size(self) -> int:
        """How many numbers between 0 and 1 name a sequence."""
        return 2 * (self.rudders + self.engines) + 1

    def orders(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Orders n [1/s] and delta [rad], (steps + 1, 2, K), approach speed [m/s] (K,) and its revolutions (K,).

        x: (K, size). Angles are whole degrees, revolutions hundredths of the highest, times whole steps.
        """
        x = np.clip(x, 0.0, 1.0)
        a, b = self.rudders, self.engines
        angles = np.radians(np.round(np.degrees((2 * x[:, :a] - 1) * self.rudder)))
        engine = self.n[0] + x[:, 2 * a : 2 * a + b] * (self.n[1] - self.n[0])
        engine = np.clip(np.round(engine / self.n[1], 2) * self.n[1], *self.n)
        held = (self._held(engine, x[:, 2 * a + b : -1]), self._held(angles, x[:, a : 2 * a]))
        speed = self.speeds[0] + x[:, -1] * (self.speeds[-1] - self.speeds[0])
        return np.stack(held, axis=1), speed, np.interp(speed, self.speeds, self.revolutions)

    def _held(self, levels: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """The ``levels`` (K, m) over time (steps + 1, K), each for its share of ``lengths`` (K, m)."""
        weights = SHORTEST + lengths
        ends = np.round(np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True) * (self.steps + 1))
        at = np.arange(self.steps + 1)[:, None, None]
        number = np.minimum((at >= ends[None]).sum(axis=2), levels.shape[1] - 1)
        return levels[np.arange(len(levels))[None, :], number]

    def positions(self, orders: np.ndarray, revolutions: np.ndarray) -> np.ndarray:
        """Positions of the actuators (steps + 1, 2, K) that follow ``orders`` at limited rates.

        They are means over the step that follows; revolutions: of the approach (K,), the rudder is midships then.
        """
        rates = np.array([self.limits.propeller_rate, self.limits.rudder_rate])[:, None] * self.dt
        here = np.stack([revolutions, np.zeros_like(revolutions)])
        out = np.empty_like(orders)
        for k, order in enumerate(orders):
            after = here + np.clip(order - here, -rates, rates)
            out[k] = 0.5 * (here + after)
            here = after
        return out

    def like(self, n: np.ndarray, delta: np.ndarray, speed: float) -> np.ndarray:
        """The numbers (size,) of a sequence near a run with ``n`` [1/s] and ``delta`` [rad] (N,), repeated to the end.

        speed: of its approach [m/s].
        """
        at = np.arange(self.steps + 1) % max(len(n), 1)
        parts = []
        for values, count, low, high in (
            (delta[at], self.rudders, -self.rudder, self.rudder), (n[at], self.engines, *self.n),
        ):  # fmt: skip
            edges = np.linspace(0, len(at), count + 1).round().astype(int)
            level = np.array([np.median(values[i:j]) for i, j in pairwise(edges)])
            parts += [(level - low) / (high - low), np.full(count, 0.5)]
        span = max(self.speeds[-1] - self.speeds[0], 1e-9)
        return np.clip(np.concatenate([*parts, [(speed - self.speeds[0]) / span]]), 0.0, 1.0)


def table_of(orders: np.ndarray, dt: float) -> list[dict[str, float]]:
    """The switches of ``orders`` (N, 2) of n [1/s] and delta [rad] at steps of ``dt`` [s]: when, and what from then."""
    at = [0, *(np.flatnonzero(np.abs(np.diff(orders, axis=0)).max(axis=1) > 1e-9) + 1).tolist()]
    return [
        {"t_s": float(k * dt), "n_rps": float(orders[k, 0]), "delta_deg": float(np.degrees(orders[k, 1]))} for k in at
    ]

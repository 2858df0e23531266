"""Sequences of rudder and revolutions with few switches, as numbers, and the search that changes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cases.maneuvers.orders import Limits

SHORTEST = 0.2
"""A stretch has at least about this share of the mean length of stretches. Set by hand."""


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


Cost = Callable[[np.ndarray], np.ndarray]


class Evolution:
    """A search without derivatives, with adapted covariance (Hansen 2016, arXiv:1604.00772).

    From ``mean`` (n,) with steps of about ``sigma`` in each number; ``best``, ``cost``: found so far.
    count: trials of a generation; rng: their source of chance.
    """

    def __init__(self, mean: np.ndarray, sigma: float, count: int, rng: np.random.Generator) -> None:
        self.mean, self.sigma, self.count, self.rng = np.array(mean, dtype=float), sigma, count, rng
        n, half = len(self.mean), count // 2
        weights = np.log((count + 1) / 2) - np.log(np.arange(1, half + 1))
        self.weights = weights / weights.sum()
        mu = 1 / float((self.weights**2).sum())
        self.mu = mu
        self.c_s, self.c_c = (mu + 2) / (n + mu + 5), (4 + mu / n) / (n + 4 + 2 * mu / n)
        self.c_1 = 2 / ((n + 1.3) ** 2 + mu)
        self.c_mu = min(1 - self.c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
        self.damping = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (n + 1)) - 1) + self.c_s
        self.norm = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
        self.C, self.path, self.path_s = np.eye(n), np.zeros(n), np.zeros(n)
        self.best, self.cost, self.generation = self.mean.copy(), np.inf, 0

    def advance(self, cost: Cost) -> None:
        """One generation; ``cost`` of points (count, n) is (count,). Points are held between 0 and 1."""
        n, mu = len(self.mean), self.mu
        values, vectors = np.linalg.eigh(self.C)
        root = np.sqrt(np.maximum(values, 1e-14))
        drawn = self.rng.standard_normal((self.count, n))
        steps = (drawn * root) @ vectors.T
        x = self.mean + self.sigma * steps
        if self.generation == 0:
            x[0], steps[0] = self.mean, 0.0
        inside = np.clip(x, 0.0, 1.0)
        found = cost(inside) + 0.01 * ((x - inside) ** 2).sum(axis=1)
        order = np.argsort(found, kind="stable")
        if found[order[0]] < self.cost:
            self.best, self.cost = inside[order[0]].copy(), float(found[order[0]])
        chosen = steps[order[: len(self.weights)]]
        y = self.weights @ chosen
        self.mean = self.mean + self.sigma * y
        self.generation += 1
        whitened = vectors @ ((vectors.T @ y) / root)
        self.path_s = (1 - self.c_s) * self.path_s + np.sqrt(self.c_s * (2 - self.c_s) * mu) * whitened
        length = float(np.linalg.norm(self.path_s))
        fading = np.sqrt(1 - (1 - self.c_s) ** (2 * self.generation))
        on = float(length / fading < (1.4 + 2 / (n + 1)) * self.norm)
        self.path = (1 - self.c_c) * self.path + on * np.sqrt(self.c_c * (2 - self.c_c) * mu) * y
        left = 1 - self.c_1 - self.c_mu + (1 - on) * self.c_1 * self.c_c * (2 - self.c_c)
        own = np.einsum("k,ki,kj->ij", self.weights, chosen, chosen)
        self.C = left * self.C + self.c_1 * np.outer(self.path, self.path) + self.c_mu * own
        self.sigma *= float(np.exp(min(1.0, self.c_s / self.damping * (length / self.norm - 1))))

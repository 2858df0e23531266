"""Search without derivatives: evolution strategy with adapted covariance (Hansen 2016, arXiv:1604.00772)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Cost = Callable[[np.ndarray], np.ndarray]


class Evolution:
    """A search from ``mean`` (n,) with steps of about ``sigma`` in each number; ``best``, ``cost``: found so far.

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

"""A ship that lacks a known force, and its trials, shared by the tests of residual/."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from mmg.network import Layers, Network
from mmg.rollout import Simulator
from mmg.ship import Ship

NOISE = np.array([0.01, 0.01, 0.002, 0.003, 0.003, 0.0005])


@lru_cache(maxsize=1)
def ship() -> Ship:
    """ESSO OSAKA, without wind."""
    return load_ship("esso_osaka_3m")


@lru_cache(maxsize=1)
def lacking() -> Ship:
    """The true ship: the same with an acceleration in sway and yaw that the other does not know, of tanh in u and r."""
    features = ship().features
    W1 = np.zeros((2, len(features)))
    W1[0, features.index("r")] = W1[1, features.index("delta")] = 1.0
    last = np.array([[0.0, 0.0], [1.0, 0.0], [-0.7, 0.4]])
    scales = np.ones(len(features))
    scales[features.index("r")], scales[features.index("delta")] = 0.03, 0.5
    limit = np.full(len(features), np.inf)
    layers = Layers((W1, np.eye(2), last), (np.zeros(2), np.zeros(2)))
    return ship().with_network(Network(features, scales, (layers,), np.array([2e-3, 2e-3, 1e-3]), -limit, limit))


def random_controls(rng: np.random.Generator, N: int, M: int, n: float = 10.0, delta: float = 0.6) -> np.ndarray:
    """Inputs (N, C, M): revolutions and rudder that change every twenty rows, calm air."""
    hold = -(-N // 20)
    controls = np.zeros((N, len(ship().inputs), M))
    controls[:, 0] = np.repeat(rng.uniform(0.3 * n, n, (hold, M)), 20, axis=0)[:N]
    controls[:, 1] = np.repeat(rng.uniform(-delta, delta, (hold, M)), 20, axis=0)[:N]
    return controls


def trials(true: Ship, count: int = 4, seconds: int = 400, seed: int = 0) -> list[Trial]:
    """Runs of a ship under random inputs, sampled every second, with noise."""
    rng = np.random.default_rng(seed)
    controls = random_controls(rng, seconds, count)
    start = np.zeros((6, count))
    start[3] = 0.4
    states = Simulator(true, compiled=False).run(start, controls, 1.0)
    states = states + rng.normal(size=states.shape) * NOISE[:, None]
    result = []
    for k in range(count):
        held = np.vstack([controls[:, :2, k], controls[-1:, :2, k]])
        names = ("x", "y", "psi", "u", "v", "r")
        columns = {"t": np.arange(seconds + 1.0), **dict(zip(names, states[:, :, k].T, strict=True))}
        columns |= {"n": held[:, 0], "delta": held[:, 1]}
        result.append(Trial(name=f"run{k}", columns=columns))
    return result

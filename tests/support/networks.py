"""Networks with random weights, for tests."""

from __future__ import annotations

import numpy as np

from mmg.network import Layers, Network
from mmg.ship import Ship

SIZES = {"u": 0.5, "v": 0.2, "r": 0.1, "n": 10.0, "n_2": 10.0, "n_bow": 10.0, "n_stern": 10.0}
"""Typical size of a feature; 0.5 for the others."""


def random_layers(F: int, width: int = 8, seed: int = 0) -> Layers:
    """Two hidden layers with weights and biases of order 1."""
    rng = np.random.default_rng(seed)
    shapes = ((width, F), (width, width), (3, width))
    weights = tuple(rng.normal(size=shape) / np.sqrt(shape[1]) for shape in shapes)
    return Layers(weights, tuple(rng.normal(size=width) for _ in range(2)))


def random_network(ship: Ship, members: int = 1, width: int = 8) -> Network:
    """A network for this ship, its accelerations comparable with those of a 3 m model."""
    scales = np.array([SIZES.get(name, 0.5) for name in ship.features])
    layers = tuple(random_layers(len(scales), width, seed) for seed in range(members))
    return Network(ship.features, scales, layers, np.array([0.01, 0.02, 0.03]), -scales, scales)

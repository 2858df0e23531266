"""The residual acceleration: a small tanh network, zero at the origin, of bounded size (Wakita et al. 2022, Eq. 7)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from mmg.network import Layers, Network, features_of

SWAPPED = {"delta_port": "delta_starboard", "delta_starboard": "delta_port", "n": "n_2", "n_2": "n"}
"""Features that change places when port becomes starboard, where a ship has both."""
SIGN_CHANGING = (
    "v", "r", "a_y", "delta", "delta_port", "delta_starboard", "n_bow", "n_stern",
    "azimuth", "azimuth_2", "azimuth_3", "azimuth_4",
)  # fmt: skip
"""Features that change sign."""


def uniform(draw: torch.Generator, rows: int, columns: int) -> nn.Parameter:
    """Weights (rows, columns) by ``draw``, uniform within sqrt(6 / (rows + columns)) (Glorot and Bengio, 2010)."""
    values = torch.rand(rows, columns, generator=draw, dtype=torch.float64)
    return nn.Parameter(math.sqrt(6.0 / (rows + columns)) * (2 * values - 1))


def normal(draw: torch.Generator, width: int) -> nn.Parameter:
    """Biases (width,) by ``draw``, normal with a deviation of 0.5."""
    return nn.Parameter(0.5 * torch.randn(width, generator=draw, dtype=torch.float64))


def hidden(x: torch.Tensor, W: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """A layer tanh(W x + b) - tanh(b) (rows, M), zero at the origin, of ``x`` (columns, M)."""
    column = b[:, None]
    return torch.tanh(torch.addmm(column, W, x)) - torch.tanh(column)


class TwoLayers(nn.Module):
    """du, dv, dr [m/s2, rad/s2] (3, M) from the features of ``mmg.network`` (F, M): motion, actuators, relative air.

    h1 = tanh(W1 q + b1) - tanh(b1), h2 = tanh(W2 h1 + b2) - tanh(b2), a = scale * (W3 h2), with q the features over
    feature_scale (F,).
    """

    scale: torch.Tensor
    feature_scale: torch.Tensor
    W1: torch.Tensor
    W2: torch.Tensor
    W3: torch.Tensor
    b1: torch.Tensor
    b2: torch.Tensor

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M)."""
        h1 = hidden(features / self.feature_scale[:, None], self.W1, self.b1)
        return self.scale[:, None] * (self.W3 @ hidden(h1, self.W2, self.b2))

    def plain(self) -> tuple[torch.Tensor, ...]:
        """W1 (H, F), b1 (H,), W2 (H, H), b2 (H,), W3 (3, H), b3 (3,) of layers W tanh(.) + b of the same output."""
        W3 = self.scale[:, None] * self.W3
        return (
            self.W1 / self.feature_scale, self.b1,
            self.W2, self.b2 - self.W2 @ torch.tanh(self.b1),
            W3, -(W3 @ torch.tanh(self.b2)),
        )  # fmt: skip

    @torch.no_grad()
    def bound(self) -> np.ndarray:
        """What |du|, |dv|, |dr| never exceed, whatever the inputs (3,): scale_j sum_i |W3_ji| (1 + |tanh b2_i|)."""
        return (self.scale * (self.W3.abs() @ (1 + torch.tanh(self.b2).abs()))).numpy()

    @torch.no_grad()
    def layers(self) -> Layers:
        """Its weights and biases as numpy arrays."""
        weights, biases = (self.W1, self.W2, self.W3), (self.b1, self.b2)
        return Layers(tuple(w.numpy().copy() for w in weights), tuple(b.numpy().copy() for b in biases))


class Residual(TwoLayers):
    """Two layers of free weights. W3 starts at zero, so that training starts from the calibrated ship."""

    def __init__(self, feature_scale: np.ndarray, scale: np.ndarray, width: int = 32, seed: int = 0) -> None:
        super().__init__()
        F = len(feature_scale)
        draw = torch.Generator().manual_seed(seed)
        self.W1, self.W2 = uniform(draw, width, F), uniform(draw, width, width)
        self.W3 = nn.Parameter(torch.zeros(3, width, dtype=torch.float64))
        self.b1, self.b2 = normal(draw, width), normal(draw, width)
        self.register_buffer("scale", torch.as_tensor(np.array(scale, dtype=float)))
        self.register_buffer("feature_scale", torch.as_tensor(np.array(feature_scale, dtype=float)))

    @classmethod
    def of_network(cls, network: Network, member: int = 0) -> Residual:
        """A member of a network of ``mmg`` as something to train further."""
        layers = network.members[member]
        result = cls(network.feature_scales, network.output_scales, len(layers.biases[0]))
        with torch.no_grad():
            for name, values in zip(("W1", "W2", "W3", "b1", "b2"), (*layers.weights, *layers.biases), strict=True):
                getattr(result, name).copy_(torch.as_tensor(values))
        return result


class Symmetric(TwoLayers):
    """The mean of a residual and its mirror image: what port does, starboard does mirrored, whatever the weights.

    a(q) = (b(q) + S b(Q q)) / 2, where b is the residual ``own``, Q turns the features of a ship with these actuators
    into those of the mirrored motion and S = diag(1, -1, -1). It is again two layers, twice as wide.
    """

    mirror: torch.Tensor
    turned: torch.Tensor

    def __init__(self, own: Residual, actuators: Sequence[str]) -> None:
        super().__init__()
        self.own = own
        scales = own.feature_scale
        mirror = torch.as_tensor(mirror_of(features_of(actuators))) * scales[None, :] / scales[:, None]
        self.register_buffer("mirror", mirror, persistent=False)
        self.register_buffer("turned", torch.tensor([[1.0], [-1.0], [-1.0]], dtype=torch.float64), persistent=False)

    def __getattr__(self, name: str) -> Any:
        """The weights of both as those of one network."""
        if name in ("scale", "feature_scale"):
            return getattr(self.own, name)
        if name == "W1":
            return torch.cat([self.own.W1, self.own.W1 @ self.mirror])
        if name == "W2":
            return torch.block_diag(self.own.W2, self.own.W2)
        if name == "W3":
            return 0.5 * torch.cat([self.own.W3, self.turned * self.own.W3], dim=1)
        if name in ("b1", "b2"):
            return getattr(self.own, name).repeat(2)
        return super().__getattr__(name)


def mirror_of(features: Sequence[str]) -> np.ndarray:
    """(F, F) that turns ``features`` of these names into those of the motion mirrored at the ship's centre plane."""
    result = np.zeros((len(features), len(features)))
    for row, name in enumerate(features):
        other = SWAPPED.get(name, name)
        result[row, features.index(other if other in features else name)] = -1.0 if name in SIGN_CHANGING else 1.0
    return result


def to_network(
    residuals: Sequence[TwoLayers], actuators: Sequence[str], lower: np.ndarray, upper: np.ndarray
) -> Network:
    """The mean of residuals of the same scales, for a ship with these actuators; lower, upper: envelope (F,)."""
    first = residuals[0]
    return Network(
        features_of(actuators),
        first.feature_scale.numpy().copy(),
        tuple(residual.layers() for residual in residuals),
        first.scale.numpy().copy(),
        lower,
        upper,
    )

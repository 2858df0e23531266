"""A torch module and a loss of a user: what is trained in place of the residual that is built here."""

from __future__ import annotations

import copy
from collections.abc import Callable, MutableMapping
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import nn

from mmg.components.own import Own, origin_of
from mmg.errors import BadValue
from mmg.network import Layers, features_of
from mmg.ship import Ship
from residual.hybrid import HYBRID_KIND, Hybrid, mirror_of
from residual.physics import Physics
from residual.settings import TrainSettings
from residual.train import ModelKind
from residual.windows import Scales, campaign_symbols

FORM = "torch.nn.Sequential of Linear layers with Tanh between them"


class OwnLoss(Own):
    """The loss of a user, a function of normalised errors (N, 6, M)."""

    @property
    def names(self) -> MutableMapping[str, Any]:
        """Nobody looks it up by its name."""
        return {}

    def __call__(self, errors: torch.Tensor) -> Any:
        return self.function(errors)


class OwnResidual(nn.Module):
    """du, dv, dr [m/s2, rad/s2] (3, M) from features (F, M) by a ``module`` of a user, which is copied.

    a = scale (m(q) - m(0)), q the features over feature_scale: zero at the origin, as every residual. Its last layer
    starts at zero, so that training starts from the calibrated ship. actuators: of a ship whose port and starboard are
    to be alike, by the mean with the mirror image (``residual.hybrid.Symmetric``); None: as the module is.
    """

    scale: torch.Tensor
    feature_scale: torch.Tensor
    mirror: torch.Tensor | None
    turned: torch.Tensor

    def __init__(
        self, module: nn.Sequential, feature_scale: np.ndarray, scale: np.ndarray, actuators: Any = None
    ) -> None:
        super().__init__()
        self.module = copy.deepcopy(module).double().requires_grad_(True)
        with torch.no_grad():
            self.linear[-1].weight.zero_()
        F = torch.as_tensor(np.array(feature_scale, dtype=float))
        mirror = None if actuators is None else torch.as_tensor(mirror_of(features_of(actuators))) * F / F[:, None]
        self.register_buffer("scale", torch.as_tensor(np.array(scale, dtype=float)))
        self.register_buffer("feature_scale", F)
        self.register_buffer("mirror", mirror, persistent=False)
        self.register_buffer("turned", torch.tensor([[1.0], [-1.0], [-1.0]], dtype=torch.float64), persistent=False)

    @property
    def linear(self) -> list[nn.Linear]:
        """Its linear layers."""
        return [layer for layer in self.module.modules() if isinstance(layer, nn.Linear)]

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M)."""
        q = features / self.feature_scale[:, None]
        rest = self.module(q.new_zeros(1, len(q)))
        made = (self.module(q.T) - rest).T
        if self.mirror is not None:
            made = 0.5 * (made + self.turned * (self.module((self.mirror @ q).T) - rest).T)
        return self.scale[:, None] * made

    @torch.no_grad()
    def layers(self) -> Layers:
        """The same as layers tanh(W x + b) - tanh(b): what is subtracted goes into the next bias."""
        *inner, last = self.linear
        weights: list[torch.Tensor] = []
        biases: list[torch.Tensor] = []
        rest = torch.zeros(inner[0].in_features, dtype=torch.float64)
        for i, layer in enumerate(inner):
            W, own = layer.weight, getattr(layer, "bias", None)
            b = layer.weight @ rest + (0.0 if own is None else own)
            rest = torch.tanh(b)
            if self.mirror is not None:
                W = torch.cat([W, W @ self.mirror]) if i == 0 else torch.block_diag(W, W)
                b = b.repeat(2)
            weights, biases = [*weights, W], [*biases, b]
        W3 = last.weight
        weights.append(W3 if self.mirror is None else 0.5 * torch.cat([W3, self.turned * W3], dim=1))
        return Layers(tuple(w.numpy().copy() for w in weights), tuple(b.numpy().copy() for b in biases))


def build_own(
    module: nn.Sequential, first: int, ship: Ship, scales: Scales, settings: TrainSettings, seed: int
) -> Hybrid:
    """A calibrated ``ship`` with a residual of the ``module``: with its weights for the seed ``first``, drawn anew by
    its layers for each other one. scales, settings, seed: as of ``residual.hybrid.build_hybrid``."""
    made = copy.deepcopy(module)
    if seed != first:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            for layer in made.modules():
                if isinstance(layer, nn.Linear):
                    layer.reset_parameters()
    residual = OwnResidual(made, scales.feature, scales.output, ship.actuators if settings.symmetric else None)
    return Hybrid(Physics(ship, symbols=campaign_symbols(ship)), residual, scales.features)


def own_kind(ship: Ship, network: Any, loss: Callable[[torch.Tensor], torch.Tensor] | None, first: int) -> ModelKind:
    """What is trained on a ``ship`` with a ``network`` or a ``loss`` of a user, from the seed ``first`` on. network:
    features (M, F) to (M, 3), None for the usual one; loss: of normalised errors (N, 6, M), None for that of states.

    Raises UserError, which names the argument, for a module that the ship's equations cannot hold, and for a loss that
    is no function.
    """
    kind = HYBRID_KIND
    if network is not None:
        _check(network, len(ship.features), ", ".join(ship.features))
        kind = kind._replace(build=partial(build_own, network, first))
    if loss is not None:
        if not callable(loss):
            raise BadValue(f"loss: is a {type(loss).__name__}; give a function of the normalised errors (N, 6, M)")
        name = getattr(loss, "__name__", type(loss).__name__)
        kind = kind._replace(own_loss=OwnLoss(loss, name=name, origin=origin_of(loss)))
    return kind


def _check(network: Any, count: int, features: str) -> None:
    """Raises UserError unless a ``network`` is of the FORM and takes ``count`` features, of these names."""
    if not isinstance(network, nn.Module):
        raise BadValue(f"network: is a {type(network).__name__}; give a {FORM}")
    parts = [part for part in network.modules() if not isinstance(part, nn.Sequential)]
    kinds = [nn.Linear, nn.Tanh] * (len(parts) // 2) + [nn.Linear]
    if len(parts) < 3 or [type(part) for part in parts] != kinds:
        found = ", ".join(type(part).__name__ for part in parts)
        raise BadValue(f"network: is {found}; equations, C and ONNX of a ship hold a {FORM}, one Tanh at least")
    sizes = [(part.in_features, part.out_features) for part in parts if isinstance(part, nn.Linear)]
    ends = sizes[0][0], sizes[-1][1]
    if ends != (count, 3) or any(a[1] != b[0] for a, b in pairwise(sizes)):
        words = f"{count} features ({features}) to 3 scaled accelerations du, dv, dr"
        raise BadValue(f"network: leads from {ends[0]} to {ends[1]} by layers {sizes}; it must lead from {words}")

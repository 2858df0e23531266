"""A torch module and a loss of a user: what is trained in place of the residual that is built here."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import nn

from mmg.components.own import Own, origin_of
from mmg.errors import BadValue
from mmg.network import Layers
from mmg.ship import Ship
from residual.hybrid import HYBRID_KIND, Hybrid, Residual, hybrid_with
from residual.settings import TrainSettings
from residual.train import ModelKind
from residual.windows import Scales

FORM = "torch.nn.Sequential of Linear layers with Tanh between them"


class OwnLoss(Own):
    """The loss of a user, a function of normalised errors (N, 6, M)."""

    def __call__(self, errors: torch.Tensor) -> Any:
        return self.function(errors)


@torch.no_grad()
def layers_of(module: nn.Module) -> Layers:
    """The ``module`` less its value at the origin as layers tanh(W x + b) - tanh(b), the last one zero."""
    *inner, last = (layer for layer in module.modules() if isinstance(layer, nn.Linear))
    biases: list[np.ndarray] = []
    rest = torch.zeros(inner[0].in_features, dtype=torch.float64)
    for layer in inner:
        # what is subtracted goes into the next bias
        own = getattr(layer, "bias", None)
        b = layer.weight.double() @ rest + (0.0 if own is None else own)
        biases, rest = [*biases, b.numpy()], torch.tanh(b)
    # zero, so that training starts from the calibrated ship
    weights = *(layer.weight.numpy() for layer in inner), np.zeros((last.out_features, last.in_features))
    return Layers(weights, tuple(biases))


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
    return hybrid_with(Residual(scales.feature, scales.output, layers_of(made)), ship, scales, settings)


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

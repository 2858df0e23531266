"""A calibrated ship with a learned residual acceleration: the network, the system, what training needs of it.

The network is a small tanh network, zero at the origin, of bounded size (Wakita et al. 2022, Eq. 7), or a torch module
of a user.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, cast

import numpy as np
import torch
from torch import nn

from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.predict import change_over
from fitting.prediction.score import WINDOW
from mmg.components.own import Own, origin_of
from mmg.errors import BadValue
from mmg.network import Layers, Network, features_of
from mmg.ship import Ship
from residual.physics import FusedRollout, Physics
from residual.settings import TrainSettings
from residual.system import Past, TrainableSystem
from residual.train import ModelKind, Outcome, Task, restored
from residual.windows import LEAST_SCALE, STRIDE, Scales, campaign_symbols, training_scales, windows

# Features that change places when port becomes starboard, where a ship has both. A lone propeller n stays.
SWAPPED = {"delta_port": "delta_starboard", "delta_starboard": "delta_port", "n": "n_2", "n_2": "n"}
# Features that change sign.
SIGN_CHANGING = (
    "v", "r", "a_y", "delta", "delta_port", "delta_starboard", "n_bow", "n_stern",
    "azimuth", "azimuth_2", "azimuth_3", "azimuth_4",
)  # fmt: skip


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
    # subtracted after the nonlinearity: biases shift where the layer bends, and the origin stays at zero
    return torch.tanh(torch.addmm(column, W, x)) - torch.tanh(column)


class Layered(nn.Module):
    """du, dv, dr [m/s2, rad/s2] (3, M) from the features of ``mmg.network`` (F, M): motion, actuators, relative air.

    h1 = tanh(W1 q + b1) - tanh(b1), h2 = tanh(W2 h1 + b2) - tanh(b2), ..., a = scale * (W h), with q the features over
    feature_scale (F,), h the last hidden layer. weights: (H, F), ..., (3, H); biases: (H,), ... of the hidden layers.
    """

    scale: torch.Tensor  # (3,) [m/s2, rad/s2]
    feature_scale: torch.Tensor  # (F,)

    @property
    def weights(self) -> list[torch.Tensor]:
        raise NotImplementedError

    @property
    def biases(self) -> list[torch.Tensor]:
        raise NotImplementedError

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M)."""
        h, (*inner, last) = features / self.feature_scale[:, None], self.weights
        for W, b in zip(inner, self.biases, strict=True):
            h = hidden(h, W, b)
        return self.scale[:, None] * (last @ h)

    def plain(self) -> list[torch.Tensor]:
        """W1 (H, F), b1 (H,), ..., W (3, H), b (3,) of layers W tanh(.) + b of the same output."""
        # scales go into the outer weights and tanh(b) into the next biases: the C loop then has plain layers only
        first, *inner, last = self.weights
        weights, biases = [*inner, self.scale[:, None] * last], [*self.biases[1:], torch.zeros_like(self.scale)]
        result = [first / self.feature_scale, self.biases[0]]
        for W, b, before in zip(weights, biases, self.biases, strict=True):
            result += [W, b - W @ torch.tanh(before)]
        return result

    @torch.no_grad()
    def layers(self) -> Layers:
        """Its weights and biases as numpy arrays."""
        return Layers(*(tuple(a.numpy().copy() for a in some) for some in (self.weights, self.biases)))


class Residual(Layered):
    """``layers`` of free weights W1, W2, ... and biases b1, ...; feature_scale (F,), scale (3,): as of ``Layered``."""

    def __init__(self, feature_scale: np.ndarray, scale: np.ndarray, layers: Layers) -> None:
        super().__init__()
        for letter, arrays in (("W", layers.weights), ("b", layers.biases)):
            for number, values in enumerate(arrays, 1):
                # names of single layers: they are those in the files of finished seeds
                self.register_parameter(f"{letter}{number}", nn.Parameter(torch.tensor(values, dtype=torch.float64)))
        self.depth = len(layers.biases)
        self.register_buffer("scale", torch.as_tensor(np.array(scale, dtype=float)))
        self.register_buffer("feature_scale", torch.as_tensor(np.array(feature_scale, dtype=float)))

    @classmethod
    def drawn(cls, feature_scale: np.ndarray, scale: np.ndarray, width: int = 32, seed: int = 0) -> Residual:
        """Two layers of this ``width``, by ``seed``; the last weights are zero: training starts from the calibrated
        ship."""
        F, draw = len(feature_scale), torch.Generator().manual_seed(seed)
        # the order of the draws is part of a seed: another order is another training
        made = [uniform(draw, width, F), uniform(draw, width, width), normal(draw, width), normal(draw, width)]
        W1, W2, b1, b2 = (p.detach().numpy() for p in made)
        # zeros here alone: with W3 = 0 the gradient by W3 is not zero, so that training leaves this point
        return cls(feature_scale, scale, Layers((W1, W2, np.zeros((3, width))), (b1, b2)))

    @classmethod
    def of_network(cls, network: Network, member: int = 0) -> Residual:
        """A ``member`` of a network of ``mmg`` as something to train further."""
        return cls(network.feature_scales, network.output_scales, network.members[member])

    @property
    def weights(self) -> list[torch.Tensor]:
        return [getattr(self, f"W{i + 1}") for i in range(self.depth + 1)]

    @property
    def biases(self) -> list[torch.Tensor]:
        return [getattr(self, f"b{i + 1}") for i in range(self.depth)]


class Symmetric(Layered):
    """The mean of a residual and its mirror image: what port does, starboard does mirrored, whatever the weights.

    a(q) = (b(q) + S b(Q q)) / 2, where b is the residual ``own``, Q turns the features of a ship with these actuators
    into those of the mirrored motion and S = diag(1, -1, -1). It is again a network, twice as wide.
    """

    mirror: torch.Tensor  # Q (F, F), between scaled features
    turned: torch.Tensor  # the diagonal of S (3, 1)

    def __init__(self, own: Residual, actuators: Sequence[str]) -> None:
        super().__init__()
        self.own = own
        scales = own.feature_scale
        # weights see scaled features, and two features that change places may have unlike scales
        mirror = torch.as_tensor(mirror_of(features_of(actuators))) * scales[None, :] / scales[:, None]
        turned = torch.tensor([[1.0], [-1.0], [-1.0]], dtype=torch.float64)
        # not in the file of weights: they follow from the actuators and the residual
        parts = {"mirror": mirror, "turned": turned, "scale": own.scale, "feature_scale": scales}
        for name, value in parts.items():
            self.register_buffer(name, value, persistent=False)

    @property
    def weights(self) -> list[torch.Tensor]:
        first, *inner, last = self.own.weights
        # the halves do not mix before the last layer, where their mean is taken
        ends = torch.cat([first, first @ self.mirror]), 0.5 * torch.cat([last, self.turned * last], dim=1)
        return [ends[0], *(torch.block_diag(W, W) for W in inner), ends[1]]  # (2 H, F), (2 H, 2 H), (3, 2 H)

    @property
    def biases(self) -> list[torch.Tensor]:
        # tanh(b) is subtracted from each half, so that both have the biases of the one residual
        return [b.repeat(2) for b in self.own.biases]


class Hybrid(TrainableSystem):
    """A calibrated ship and a residual acceleration of its u, v, r.

    physics: ``residual.physics.Physics`` of the ship; residual: the network; features: (F, R) of the training rows, on
    which its size is penalised.
    """

    features: torch.Tensor

    def __init__(self, physics: Any, residual: Layered, features: np.ndarray) -> None:
        super().__init__()
        self.physics, self.residual = physics, residual
        widths = [len(b) for b in residual.biases]
        # the loop in C has two hidden layers of one width; compiled when first used, as scoring needs no compiler
        self.fused = FusedRollout(physics, widths[0]) if widths == 2 * widths[:1] else None
        self.register_buffer("features", torch.as_tensor(np.ascontiguousarray(features, dtype=float)), persistent=False)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        return self.physics.start(logged, controls)

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        rates, features = self.physics.call("rates_and_features", z, controls)
        # on u, v, r alone: kinematics are exact, and memory states belong to the physics
        return torch.cat([rates[:3], rates[3:6] + self.residual(features), rates[6:]])

    def columns(self, z: torch.Tensor, controls: torch.Tensor | None = None) -> torch.Tensor:
        return self.physics.columns(z, controls)

    def simulate(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """As of any system, as one compiled loop where there is a compiler."""
        # single operators give the same states (tests/residual/test_physics.py) some seven times slower
        if self.fused is None or self.fused.library is None:
            return super().simulate(z, controls, h, method)
        return self.fused(z, controls, h, self.residual.plain(), method)

    def penalty(self) -> torch.Tensor:
        """Mean of (residual / its scale)^2 over the training rows and components."""
        # by its scale: surge, sway and yaw, of unlike units, then count alike
        return ((self.residual(self.features) / self.residual.scale[:, None]) ** 2).mean()


def mirror_of(features: Sequence[str]) -> np.ndarray:
    """(F, F) that turns ``features`` of these names into those of the motion mirrored at the ship's centre plane."""
    result = np.zeros((len(features), len(features)))
    for row, name in enumerate(features):
        other = SWAPPED.get(name, name)
        result[row, features.index(other if other in features else name)] = -1.0 if name in SIGN_CHANGING else 1.0
    return result


def to_network(residuals: Sequence[Layered], actuators: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> Network:
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


OUTPUT = 0.3  # Scale of the residual as a share of the rms accelerations of the ship on the training rows. Set by hand.


def physics_of(ship: Ship) -> Physics:
    """The equations of a ``ship``, with the values that her campaigns have for themselves as inputs."""
    return Physics(ship, symbols=campaign_symbols(ship))


def build_hybrid(ship: Ship, scales: Scales, settings: TrainSettings, seed: int) -> Hybrid:
    """A calibrated ``ship`` with a residual of these ``scales``, ``settings`` and ``seed`` that is still zero."""
    # half as wide, since the mirror image doubles it: the cost stays what the width asks for
    width = max(1, settings.width // 2) if settings.symmetric else settings.width
    return hybrid_with(Residual.drawn(scales.feature, scales.output, width, seed), ship, scales, settings)


def hybrid_with(own: Residual, ship: Ship, scales: Scales, settings: TrainSettings) -> Hybrid:
    """A calibrated ``ship`` with the residual ``own``, and its mirror image where ``settings`` say so; scales: of the
    training data."""
    residual = Symmetric(own, ship.actuators) if settings.symmetric else own
    return Hybrid(physics_of(ship), residual, scales.features)


def hybrid_scales(ship: Ship, pieces: Sequence[Stretch], trials: Sequence[Trial], h: float) -> Scales:
    """Scales for a residual on ``ship`` from ``pieces`` of ``trials`` on a grid of ``h`` [s].

    Raises UserError where there are no rows, or nothing moves in them.
    """
    physics = physics_of(ship)
    scales, rows = training_scales(ship, pieces, trials, h, physics.logged_features), windows(pieces, h, 1, 1)
    assert rows is not None
    logged, controls = rows.targets[0], rows.controls[0]
    with torch.no_grad():
        # of the ship, not of the measurement: differences of noisy velocities would make the scale too large
        rates = physics.rates(physics.start(logged, controls), controls)[3:6].numpy()
    output = OUTPUT * np.sqrt((rates**2).mean(axis=1)) + LEAST_SCALE
    change = change_over(trials, WINDOW, STRIDE)
    return replace(scales, output=output, score=np.where(np.isfinite(change), change, scales.sigma))


# A residual on a ship without a network.
HYBRID_KIND = ModelKind(
    build_hybrid, hybrid_scales, lambda s: s.inputs, lambda s: physics_of(s).logged_features, campaigns=True
)


def network_of(task: Task, outcomes: Sequence[Outcome]) -> Network | None:
    """The mean of the residuals that trainings like ``task`` ended with, with the range of the training rows.

    outcomes: of the seeds. None where all diverged.
    """
    # seeds that diverged are left out of the mean, not counted as zero
    residuals = [cast(Hybrid, system).residual for system in restored(task, outcomes)]
    if not residuals:
        return None
    features = task.scales.features
    return to_network(residuals, task.ship.actuators, features.min(axis=1), features.max(axis=1))


FORM = "torch.nn.Sequential of Linear layers with Tanh between them"  # Of a module of a user


class OwnLoss(Own):
    """The loss of a user, a function of normalised errors (N, 6, M)."""

    def __call__(self, errors: torch.Tensor) -> Any:
        return self.function(errors)


@torch.no_grad()
def layers_of(module: nn.Module) -> Layers:
    """The ``module`` less its value at the origin as layers tanh(W x + b) - tanh(b), the last one zero."""
    *inner, last = (layer for layer in module.modules() if isinstance(layer, nn.Linear))
    biases: list[np.ndarray] = []
    rest = torch.zeros(inner[0].in_features, dtype=torch.float64)  # tanh(b) of the layer before
    for layer in inner:
        own = getattr(layer, "bias", None)  # None of Linear(..., bias=False), which its type does not say
        # what is subtracted after a layer goes into the next bias
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
    made = copy.deepcopy(module)  # the module of the user stays as it is
    if seed != first:
        with torch.random.fork_rng(devices=[]):  # the draws of the user's process stay as they are
            torch.manual_seed(seed)
            for layer in made.modules():
                if isinstance(layer, nn.Linear):
                    layer.reset_parameters()
    return hybrid_with(Residual(scales.feature, scales.output, layers_of(made)), ship, scales, settings)


def own_kind(ship: Ship, network: Any, loss: Callable[[torch.Tensor], torch.Tensor] | None, first: int) -> ModelKind:
    """What is trained on a ``ship`` with a ``network`` or a ``loss`` of a user, from the seed ``first`` on. network:
    features (M, F) to (M, 3), None for the usual one; loss: of normalised errors (N, 6, M), None for that of states.

    Raises UserError, which names the argument, for a module that the ship's equations cannot hold.
    """
    kind = HYBRID_KIND
    if network is not None:
        _check_form(network, len(ship.features), ", ".join(ship.features))
        kind = kind._replace(build=partial(build_own, network, first))
    if loss is not None:
        name = getattr(loss, "__name__", type(loss).__name__)
        kind = kind._replace(own_loss=OwnLoss(loss, name=name, origin=origin_of(loss)))
    return kind


def _check_form(network: Any, count: int, features: str) -> None:
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

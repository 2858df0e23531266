"""A neural network that adds accelerations to the right-hand side of a ship: zero at the origin, bounded, smooth.

h_1 = tanh(W_1 x / scale + b_1) - tanh(b_1), h_2 = tanh(W_2 h_1 + b_2) - tanh(b_2), ..., and the accelerations are
output_scale * (W h_last), without bias, so that a ship at rest in calm air stays there (Wakita et al. 2022). As
|tanh(.) - tanh(b)| <= 1 + |tanh(b)|, no input whatever makes it exceed its ``bound``. It sees what the force models
see (``Flow``): velocities through the water, actuators behind their lags and delays, air relative to the hull.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from mmg.errors import BadValue, Conflict

# Features besides the actuators: velocities through the water, air relative to the hull; body axes [m/s, rad/s].
MOTION, RELATIVE_AIR = ("u", "v", "r"), ("a_x", "a_y")
# No weight and no output scale of a trained network is larger: weights are of the order of 1.
LARGEST = 1e6  # set by hand: it bounds what a damaged file can do
OTHER = "network file for another ship or another input set"  # How every refusal of a network begins


def features_of(actuators: Sequence[str]) -> tuple[str, ...]:
    """Names of all features of a ship with these actuators, in their order: F = 5 + actuators."""
    return (*MOTION, *actuators, *RELATIVE_AIR)


@dataclass(frozen=True, eq=False)
class Layers:
    """One network: weights of the hidden layers and the last one (rows, columns), biases (rows,) of the hidden ones."""

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]

    def __call__(self, x: Any) -> Any:
        """Outputs (3, M) of scaled features (F, M), numpy or CasADi: before the output scales."""
        symbolic = isinstance(x, (ca.SX, ca.MX, ca.DM))
        f, product = (ca, ca.mtimes) if symbolic else (np, np.matmul)
        for W, b in zip(self.weights[:-1], self.biases, strict=True):
            column = ca.DM(b) if symbolic else b[:, None]
            offset = ca.DM(np.tanh(b)) if symbolic else np.tanh(column)  # a constant, so that 0 gives 0
            x = f.tanh(product(W, x) + column) - offset
        return product(self.weights[-1], x)

    @property
    def bound(self) -> np.ndarray:
        """What no output exceeds, (3,): sum_i |W_ji| (1 + |tanh b_i|) over the last hidden layer."""
        return np.abs(self.weights[-1]) @ (1.0 + np.abs(np.tanh(self.biases[-1])))


@dataclass(frozen=True, eq=False)
class Network:
    """Accelerations (du, dv, dr) from features: the mean of one or several networks trained from different seeds.

    features: names of the F features in order, of ``features_of(ship.actuators)``; all actuators are among them.
    feature_scales: (F,), by which features are divided [unit of the feature].
    members: the networks, each (F,) -> (3,).
    output_scales: (3,) [m/s^2, m/s^2, rad/s^2], by which their outputs are multiplied.
    lower, upper: (F,) range of the features in the training data; infinite where it is not known.
    """

    features: tuple[str, ...]
    feature_scales: np.ndarray
    members: tuple[Layers, ...]
    output_scales: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def accelerations(self, x: Any) -> Any:
        """du, dv [m/s^2], dr [rad/s^2], (3, M), of features (F, M), numpy or CasADi (F, 1)."""
        symbolic = isinstance(x, (ca.SX, ca.MX, ca.DM))
        scales = [ca.DM(a) if symbolic else a[:, None] for a in (self.feature_scales, self.output_scales)]
        scaled = x / scales[0]
        outputs = [member(scaled) for member in self.members]
        return scales[1] * (sum(outputs[1:], outputs[0]) / len(outputs))

    @property
    def bound(self) -> np.ndarray:
        """What |du|, |dv| [m/s^2], |dr| [rad/s^2] never exceed, (3,)."""
        return np.abs(self.output_scales) * np.mean([member.bound for member in self.members], axis=0)

    @property
    def feels_air(self) -> bool:
        """Whether the air relative to the hull changes what it adds."""
        columns = [self.features.index(name) for name in RELATIVE_AIR if name in self.features]
        # features enter by the first layer alone
        return any(bool(np.any(member.weights[0][:, columns])) for member in self.members)

    def outside(self, x: np.ndarray) -> np.ndarray:
        """(M,) bool: whether a feature of (F, M) lies outside the range of the training data."""
        return np.any((x < self.lower[:, None]) | (x > self.upper[:, None]), axis=0)

    def check(self, ship: str, actuators: Sequence[str]) -> None:
        """Raises UserError unless its sizes agree, its numbers are finite and its inputs are those of the ship."""
        expected, given = features_of(actuators), self.features
        unknown = [name for name in given if name not in expected]
        missing = [name for name in actuators if name not in given]
        if unknown or missing or len(set(given)) < len(given):
            raise Conflict(f"{OTHER}: it takes {', '.join(given)}; {ship or 'the ship'} has {', '.join(expected)}")
        fault = self._fault()
        if fault:
            raise BadValue(f"network of {ship or 'the ship'}: {fault}; train it again")

    def _fault(self) -> str:
        """What is wrong with its arrays, in words; "" if nothing."""
        F = len(self.features)
        if {a.shape for a in (self.feature_scales, self.lower, self.upper)} != {(F,)}:
            return f"scales and ranges must have one value for each of its {F} features"
        if self.output_scales.shape != (3,) or not self.members:
            return "it must have three output scales and at least one member"
        for member in self.members:
            rows = F  # of what the next layer takes
            if len(member.weights) < 2 or len(member.biases) != len(member.weights) - 1:
                return "it must have hidden layers with a bias each and a last layer without"
            for W, b in zip(member.weights, (*member.biases, np.zeros(3)), strict=True):
                if W.ndim != 2 or W.shape[1] != rows or b.shape != (len(W),):
                    return "the shapes of its weights do not fit each other"
                rows = len(W)
        arrays = [a for member in self.members for a in (*member.weights, *member.biases)]
        if not all(np.isfinite(a).all() for a in (*arrays, self.feature_scales, self.output_scales)):
            return "some of its numbers are not finite"
        if not all((np.abs(a) <= LARGEST).all() for a in (*arrays, self.output_scales)):
            return f"some of its weights are larger than {LARGEST:g}"
        return "" if (self.feature_scales > 0).all() else "some of its feature scales are not positive"

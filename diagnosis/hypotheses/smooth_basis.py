"""Smooth functions of some variables: random features (Rahimi & Recht 2007), put into the order of what they contribute
on the trials (principal components): an orthogonal basis whose size falls from component to component."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

FEATURES = 200
"""Random features."""


@dataclass(frozen=True)
class Forms:
    """Functions of the motion: names (m,), values (m, K, R), and their gradients (m, K, R, 6) by the logged states."""

    names: tuple[str, ...]
    values: np.ndarray
    gradients: np.ndarray

    def __add__(self, other: Forms) -> Forms:
        join = (np.concatenate([getattr(self, k), getattr(other, k)]) for k in ("values", "gradients"))
        return Forms((*self.names, *other.names), *join)

    def at(self, name: str) -> int:
        """Position of a ``name``."""
        return self.names.index(name)

    def only(self, names: tuple[str, ...]) -> Forms:
        """Those of these ``names``."""
        rows = [self.at(name) for name in names]
        return Forms(names, self.values[rows], self.gradients[rows])


def evaluated(
    expressions: Mapping[str, ca.SX], arguments: list[ca.SX], values: list[np.ndarray], mask: np.ndarray
) -> Forms:
    """``expressions`` of ``arguments``, the first being the six logged states, at ``values`` (K, R, ...); mask: (K, R)
    where they exist, else 0."""
    names, shape = tuple(expressions), mask.shape
    each = ca.vertcat(*expressions.values())
    function = ca.Function("forms", list(arguments), [each, ca.densify(ca.jacobian(each, arguments[0]))])
    flat = [v.reshape(mask.size, -1).T for v in values]
    value, J = (np.array(x) for x in function.map(mask.size)(*flat))
    value = value.reshape(len(names), *shape)
    # CasADi lays the blocks of its columns side by side: (m, points, 6)
    return Forms(names, value, J.reshape(len(names), mask.size, 6).reshape(len(names), *shape, 6))


def spread_of(values: np.ndarray) -> np.ndarray:
    """Standard deviation (m,) of ``values`` (m, M), 0 of what does not change."""
    spread = values.std(axis=1)
    return np.where(spread > 1e-3 * np.abs(values).max(axis=1, initial=0.0) + 1e-12, spread, 0.0)


class SmoothBasis:
    """Smooth functions of variables, whose units and order are taken from trials.

    values: (m, M) of the variables; scale: (m,) length over which a function changes, 0 for a variable that is left
    out; components: how many of the functions are kept; together: least and most variables of one function.
    """

    def __init__(self, values: np.ndarray, scale: np.ndarray, components: int, together: tuple[int, int]) -> None:
        rng = np.random.default_rng(0)
        self._centre = values.mean(axis=1)
        where, self._weight = np.flatnonzero(scale), np.zeros((FEATURES, len(values)))
        least, most = (min(len(where), n) for n in together)
        for row in self._weight:
            chosen = rng.choice(where, int(rng.integers(least, most + 1)), replace=False)
            row[chosen] = rng.standard_normal(len(chosen)) / scale[chosen]
        self._phase = rng.uniform(0, 2 * np.pi, FEATURES)
        features = np.cos(self._weight @ (values - self._centre[:, None]) + self._phase[:, None])
        self._mean = features.mean(axis=1)
        features -= self._mean[:, None]
        sizes, vectors = np.linalg.eigh(features @ features.T / features.shape[1])
        kept = np.argsort(-sizes)[:components]
        kept = kept[sizes[kept] > 1e-9]
        self._mix = vectors[:, kept].T / np.sqrt(sizes[kept].max(initial=1e-300))

    def on(self, known: Forms, name: str) -> Forms:
        """The functions of the variables ``known``, by ``name`` and number."""
        shape, own = known.values.shape[1:], np.flatnonzero(self._weight.any(axis=0))
        values = known.values.reshape(len(known.values), -1) - self._centre[:, None]
        angle = self._weight @ values + self._phase[:, None]
        found = self._mix @ (np.cos(angle) - self._mean[:, None])
        steep = -np.sin(angle, out=angle)
        gradient = np.zeros((len(found), values.shape[1], known.gradients.shape[-1]))
        for v in own:
            along = known.gradients[v].reshape(values.shape[1], -1)
            if along.any():  # the past of an input has none
                gradient += ((self._mix * self._weight[:, v]) @ steep)[..., None] * along
        values, gradient = found.reshape(-1, *shape), gradient.reshape(-1, *shape, gradient.shape[-1])
        return Forms(tuple(f"{name} {i + 1}" for i in range(len(values))), values, gradient)

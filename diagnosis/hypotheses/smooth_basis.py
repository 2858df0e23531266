"""Smooth functions of some variables: random features (Rahimi & Recht 2007), put into the order of what they contribute
on the trials (principal components): an orthogonal basis whose size falls from component to component."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mmg.compile.batch import BatchFunction

FEATURES = 200
"""Random features."""


@dataclass(frozen=True)
class Forms:
    """Functions of the motion: names (m,), values (m, K, R), and their gradients (m, K, R, 6) by the logged states."""

    names: tuple[str, ...]
    values: np.ndarray
    gradients: np.ndarray

    @classmethod
    def together(cls, some: Sequence[Forms]) -> Forms:
        """All of ``some``, one after the other."""
        join = (np.concatenate([getattr(forms, k) for forms in some]) for k in ("values", "gradients"))
        return cls(tuple(name for forms in some for name in forms.names), *join)

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
    each = ca.densify(ca.vertcat(*expressions.values()))
    function = ca.Function("forms", list(arguments), [each, ca.densify(ca.jacobian(each, arguments[0]))])
    count = int(mask.sum())
    value, gradient = np.zeros((len(names), *shape)), np.zeros((len(names), *shape, 6))
    if count:
        made = BatchFunction(function, None).at(*(v.reshape(*shape, -1)[mask].T for v in values))
        value[:, mask] = made[0]
        gradient[:, mask] = np.moveaxis(made[1].reshape(6, len(names), count), 0, 2)  # nonzeros column by column
    return Forms(names, value, gradient)


def spread_of(values: np.ndarray) -> np.ndarray:
    """Standard deviation (m,) of ``values`` (m, M), 0 of what does not change."""
    spread = values.std(axis=1)
    return np.where(spread > 1e-3 * np.abs(values).max(axis=1, initial=0.0) + 1e-12, spread, 0.0)


class SmoothBasis:
    """Smooth functions of variables, whose units and order are taken from trials.

    values: (m, M) of the variables; scale: length over which a function changes; components: how many of the functions
    are kept.
    """

    def __init__(self, values: np.ndarray, scale: float, components: int) -> None:
        rng = np.random.default_rng(0)
        self._centre = values.mean(axis=1)
        self._weight = rng.standard_normal((FEATURES, len(values))) / scale
        self._phase = rng.uniform(0, 2 * np.pi, FEATURES)
        features = np.cos(self._weight @ (values - self._centre[:, None]) + self._phase[:, None])
        self._mean = features.mean(axis=1)
        features -= self._mean[:, None]
        sizes, vectors = np.linalg.eigh(features @ features.T / features.shape[1])
        kept = np.argsort(-sizes)[:components]
        kept = kept[sizes[kept] > 1e-9]
        self._mix = vectors[:, kept].T / np.sqrt(sizes[kept].max(initial=1e-300))

    def on(self, known: Forms, name: str, mask: np.ndarray) -> Forms:
        """The functions of the variables ``known``, by ``name`` and number; mask: (K, R) where they exist, else 0."""
        angle = self._weight @ (known.values[:, mask] - self._centre[:, None]) + self._phase[:, None]
        found = self._mix @ (np.cos(angle) - self._mean[:, None])
        slope = np.zeros((*found.shape, known.gradients.shape[-1]))
        for weight, along in zip(self._weight.T, known.gradients[:, mask], strict=True):
            if along.any():  # an input has none
                slope -= ((self._mix * weight) @ np.sin(angle))[..., None] * along
        values, gradients = (np.zeros((len(found), *mask.shape, *x.shape[2:])) for x in (found, slope))
        values[:, mask], gradients[:, mask] = found, slope
        return Forms(tuple(f"{name} {i + 1}" for i in range(len(found))), values, gradients)

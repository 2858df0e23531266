"""Whether new code does what the expressions that it was made from do: some points, beside CasADi's virtual machine."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from mmg.compile.cache import Untested

CLOSE = 1e-7
"""Largest difference of a result, over the largest number of its kind, by which sums may be rounded otherwise."""
ROUNDING = float(np.finfo(float).eps)
"""A difference of results that cancel, of arguments of the order of 1."""
MORE = 8
"""So many times the points are drawn where some have no finite value."""
NO_VALUE = "the equations have no finite value at any point of the test"
LOW, HIGH = 0.2, 1.0
"""Range of all arguments of a test, in which nothing is singular."""


def points(rows: int, count: int, seed: int) -> np.ndarray:
    """Arguments (rows, count) of a test, the same for the same ``seed``."""
    return np.random.default_rng(seed).uniform(LOW, HIGH, (rows, count))


def by_virtual_machine(function: ca.Function, inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Nonzeros (nnz, M) of each output of a ``function`` of vectors, and of matrices by their nonzeros, for ``inputs``
    (rows, M)."""
    found: list[list[list[float]]] = [[] for _ in range(function.n_out())]
    shapes = [function.sparsity_in(j) for j in range(function.n_in())]
    for k in range(inputs[0].shape[1]):
        given = [ca.DM(shape, a[:, k]) for shape, a in zip(shapes, inputs, strict=True)]
        for j, value in enumerate(function.call(given)):
            found[j].append(value.nonzeros())
    return [np.array(rows).reshape(inputs[0].shape[1], -1).T for rows in found]


def finite_points(function: ca.Function, count: int, seed: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Arguments of a ``function`` at ``count`` points, (rows, count) each, the same for the same ``seed``, and its
    results there by ``by_virtual_machine``; of more points those at which it is finite, where there are any."""
    for drawn in (count, MORE * count):
        inputs = [points(function.nnz_in(j), drawn, seed + j) for j in range(function.n_in())]
        results = by_virtual_machine(function, inputs)
        if (good := finite_at(results)).all():
            break
    chosen = np.resize(np.flatnonzero(good) if good.any() else np.arange(drawn), count)
    return [a[:, chosen] for a in inputs], [a[:, chosen] for a in results]


def finite_at(results: Sequence[np.ndarray]) -> np.ndarray:
    """At which points (M,) all numbers of the ``results`` (nnz, M) are finite."""
    return np.all([np.isfinite(a).all(axis=0) for a in results], axis=0)


def differences(found: Sequence[np.ndarray], expected: Sequence[np.ndarray], close: float = CLOSE) -> str:
    """What tells the arrays ``found`` (...,) each from the ``expected`` (...,), "" for nothing but rounding.

    Compared are the finite numbers of ``expected``, each with a difference of at most ``close`` times the largest one
    of its array (what follows from no number is not the same everywhere).
    """
    for a, b in zip(found, expected, strict=True):
        finite = np.isfinite(b)
        away, largest = np.abs(a[finite] - b[finite]), float(np.abs(b[finite]).max(initial=0.0))
        if not (away <= close * largest + ROUNDING).all():
            most = float(np.where(np.isfinite(away), away, np.inf).max())
            return f"by {most:.2g}, where the largest number is {largest:.2g}"
    return ""


def require_values(expected: Sequence[np.ndarray]) -> None:
    """Raises Untested where there are arrays ``expected`` (...,) and none of their numbers is finite."""
    if any(a.size for a in expected) and not any(np.isfinite(a).any() for a in expected):
        raise Untested(NO_VALUE)

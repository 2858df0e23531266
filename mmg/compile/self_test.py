"""Whether new code does what the expressions that it was made from do: some points, beside CasADi's virtual machine."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

CLOSE = 1e-7
"""Largest difference of a result, over the largest number of its kind, by which sums may be rounded otherwise."""
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


def alike(found: np.ndarray, expected: np.ndarray) -> bool:
    """Whether the arrays ``found`` and ``expected``, (nnz, M) both, are the same but for rounding, where a number is
    expected (what follows from none is not the same everywhere)."""
    good = np.isfinite(expected)
    if found.shape != expected.shape or not np.isfinite(found[good]).all():
        return False
    largest = float(np.abs(expected[good]).max(initial=0.0))
    return bool((np.abs(found[good] - expected[good]) <= CLOSE * largest).all())

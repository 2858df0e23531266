"""The cost of samples inside shooting intervals to second order, and what the intervals make of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fitting.nlp.group_sums import group_sums


@dataclass(frozen=True)
class Curved:
    """Second derivatives of intervals: ends (M, S, S + P) sensitivities, slope (M, S + P) of the samples' cost, rows
    (M, S, S + P) of the start nodes, shared (windows or groups, P, P) of the coefficients."""

    ends: np.ndarray
    slope: np.ndarray
    rows: np.ndarray
    shared: np.ndarray

    def of_groups(self, group: np.ndarray, groups: int) -> Curved:
        """The same with the blocks of the coefficients summed by ``group``, one number below ``groups`` for each."""
        return replace(self, shared=group_sums(group, self.shared, groups))


@dataclass
class SampleCost:
    """Derivatives of the cost of the interior states, by step and interval.

    pull: (K-1, S, M) gradient with respect to the state; weight: (K-1, S, M) diagonal of its Hessian; full: instead,
    (K-1, M, S + O, S + O) Hessian with respect to the state and the free coefficients at positions ``own`` (O of them).
    """

    pull: np.ndarray
    weight: np.ndarray
    full: np.ndarray | None = None
    own: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    def triangles(self) -> np.ndarray:
        """Upper triangles of the Hessians, row by row: (K - 1, n (n + 1) / 2, M) for n = S + O."""
        steps, S, M = self.pull.shape
        n = S + len(self.own)
        rows, columns = np.triu_indices(n)
        if self.full is not None:
            return np.ascontiguousarray(np.moveaxis(self.full[:, :, rows, columns], 2, 1))
        found = np.zeros((steps, len(rows), M))
        found[:, rows == columns] = self.weight
        return found

"""Derivatives of the cost of the samples inside shooting intervals, for a sweep through the intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class SampleCost:
    """Derivatives of the cost of the interior states, by step and interval.

    pull: (K-1, S, M) gradient with respect to the state; weight: (K-1, S, M) diagonal of its Hessian; full: instead,
    (K-1, M, S + O, S + O) Hessian with respect to the state and the free coefficients at positions ``own`` (O of them).
    """

    pull: np.ndarray
    weight: np.ndarray
    full: np.ndarray | None = None
    own: np.ndarray | None = None

    def block(self, s: slice) -> SampleCost:
        """The intervals of a slice."""
        full = None if self.full is None else self.full[:, s]
        return SampleCost(self.pull[:, :, s], self.weight[:, :, s], full, self.own)

    def add(self, k: int, m: int, S: np.ndarray, nodes: np.ndarray, shared: np.ndarray) -> None:
        """Adds the cost's Hessian after step k with respect to the start nodes, for sensitivities S (m, S, S + P)."""
        size, P = S.shape[1], S.shape[2] - S.shape[1]
        if self.full is None:
            WS = self.weight[k, :, :m].T[:, :, None] * S
            nodes[:m] += np.swapaxes(S[:, :, :size], 1, 2) @ WS
            shared += S[:, :, size:].reshape(-1, P).T @ WS[:, :, size:].reshape(-1, P)
            return
        assert self.own is not None
        extra = len(self.own)
        through = np.zeros((m, size + extra, size + P))
        through[:, :size] = S
        through[:, np.arange(size, size + extra), size + self.own] = 1.0
        curved = self.full[k, :m] @ through
        nodes[:m] += np.swapaxes(through[:, :, :size], 1, 2) @ curved
        rows = through[:, :, size:].reshape(-1, P)
        shared += rows.T @ curved[:, :, size:].reshape(-1, P)

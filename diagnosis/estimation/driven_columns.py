"""Columns of a linearisation whose responses are wanted: as arrays, or as products made block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

BLOCK = 2_000_000
"""Numbers in a block: 16 MB, of memory that the next block uses again."""


@dataclass(frozen=True)
class DrivenColumns:
    """c columns whose responses are wanted.

    forcing: (K, R, m, c) what a column adds over a step to the first m states; observed: (K + 1, R, 6, d) what the
    columns ``observing`` (d,) add to the logged columns, the others add nothing; scale: (R, c) by which forcing and
    observed are multiplied (None: 1); start: (R, n, c) first states (None: 0).
    """

    forcing: np.ndarray
    observed: np.ndarray
    observing: np.ndarray
    scale: np.ndarray | None = None
    start: np.ndarray | None = None

    @classmethod
    def dense(cls, forcing: np.ndarray, observed: np.ndarray, start: np.ndarray | None = None) -> DrivenColumns:
        """DrivenColumns that may all act on what is logged. forcing, observed, start: as of the class, with d = c."""
        return cls(forcing, observed, np.arange(observed.shape[3]), None, start)

    @classmethod
    def pushing(cls, forcing: np.ndarray) -> DrivenColumns:
        """DrivenColumns that act on the states alone. forcing: as of the class."""
        K, R = forcing.shape[:2]
        return cls(forcing, np.zeros((K + 1, R, 6, 0)), np.zeros(0, dtype=int))

    @classmethod
    def misread(cls, observed: np.ndarray) -> DrivenColumns:
        """DrivenColumns that act on what is logged alone. observed: as of the class, with d = c."""
        K1, R, _, c = observed.shape
        return cls(np.zeros((K1 - 1, R, 0, c)), observed, np.arange(c))

    @property
    def width(self) -> int:
        """How many columns they are."""
        return self.forcing.shape[3]

    def blocks(self) -> Iterator[DrivenColumns]:
        """These columns, at once."""
        yield self

    @property
    def dense_observed(self) -> np.ndarray:
        """What every column adds to the logged columns, (K + 1, R, 6, c)."""
        out = np.zeros((*self.observed.shape[:3], self.forcing.shape[3]))
        out[..., self.observing] = self.observed
        return out


@dataclass(frozen=True)
class ProductColumns:
    """f times v columns that act on the states: pushes (K, R, m, f), what each adds over a step to the first m states,
    times each of the ``values`` (v, K, R), or (v, K, 1) that are the same in all windows. Those of one value are
    side by side."""

    pushes: np.ndarray
    values: np.ndarray

    @property
    def width(self) -> int:
        """How many columns they are."""
        return len(self.values) * self.pushes.shape[3]

    def blocks(self) -> Iterator[DrivenColumns]:
        """The columns in their order, some at a time."""
        K, R, m, f = self.pushes.shape
        count = max(1, BLOCK // max(K * R * m * f, 1))
        for begin in range(0, len(self.values), count):
            some = np.moveaxis(self.values[begin : begin + count], 0, -1)
            made = self.pushes[:, :, :, None] * some[:, :, None, :, None]
            yield DrivenColumns.pushing(made.reshape(K, R, m, -1))

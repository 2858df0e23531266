"""Columns of a linearisation that are products, made block by block when their responses are wanted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.filtering import DrivenColumns

BLOCK = 2_000_000
"""Numbers in a block: 16 MB, of memory that the next block uses again."""


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

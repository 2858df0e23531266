"""Sums of rows by group."""

from __future__ import annotations

import numpy as np


def group_sums(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, ...) of the rows of ``values`` (m, ...) of each ``group`` (m,), a number below ``count``."""
    sums = np.zeros((count, *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums

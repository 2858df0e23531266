"""A score in words, and when one is worse than another."""

from __future__ import annotations

import numpy as np

NOTED = 0.005
"""Share of an error by which it must change for that to be said."""


def in_words(error: float | None) -> str:
    """An ``error`` with four digits behind the point, "-" of nothing, "diverges" where the prediction gave none."""
    if error is None or np.isinf(error):
        return "diverges"
    return "-" if np.isnan(error) else f"{error:.4f}"


def is_worse(before: float, after: float) -> bool:
    """Whether an error rose from ``before`` to ``after`` by more than is worth a word."""
    return after > (1 + NOTED) * before + 1e-6

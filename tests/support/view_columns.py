"""Columns of numbers of an interactive page, read back."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from delivery.view.page import MISSING


def unpacked(column: list[Any]) -> np.ndarray:
    """The values (N,) of a ``column`` of ``packed``, NaN where it has none."""
    offset, scale, text = column
    steps = np.frombuffer(base64.b64decode(text), dtype="<i2").astype(float)
    return np.where(steps == MISSING, np.nan, offset + scale * steps)

"""Columns of numbers as short texts: 16 bits a value, exact enough for a screen; JSON that is safe inside a page."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from fitting.report.run_folder import plain

MISSING = -32768
"""The 16-bit number that stands for a value that is not finite."""
LARGEST = 32767


def packed(values: np.ndarray) -> list[Any]:
    """A column (N,) as [offset, scale, text]: value = offset + scale k, with k the 16-bit integers in base64.

    values: numbers that are not finite become MISSING. The error is at most half a scale, 1/65534 of the range.
    """
    column = np.asarray(values, dtype=float)
    good = np.isfinite(column)
    low, high = (float(column[good].min()), float(column[good].max())) if good.any() else (0.0, 0.0)
    offset, scale = 0.5 * low + 0.5 * high, (0.5 * high - 0.5 * low) / LARGEST
    steps = np.full(len(column), MISSING, dtype="<i2")
    steps[good] = np.clip(np.rint((column[good] - offset) / (scale or 1.0)), -LARGEST, LARGEST).astype("<i2")
    return [offset, scale, base64.b64encode(steps.tobytes()).decode()]


def unpacked(column: list[Any]) -> np.ndarray:
    """The values (N,) of a ``column`` of ``packed``, NaN where it has none."""
    offset, scale, text = column
    steps = np.frombuffer(base64.b64decode(text), dtype="<i2").astype(float)
    return np.where(steps == MISSING, np.nan, offset + scale * steps)


def packed_times(t: np.ndarray) -> str:
    """Times ``t`` (N,) [s] since the start, as 32-bit floats in base64."""
    return base64.b64encode(np.asarray(t, dtype="<f4").tobytes()).decode()


def safe_json(data: Any) -> str:
    """``data`` as JSON that may stand in a script element: no text in it ends the element or begins a comment."""
    text = json.dumps(plain(data), separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")

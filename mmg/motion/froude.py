"""Froude's law: what times, speeds and forces of a 3 m model become at another length.

Equal Froude numbers u / sqrt(g L) make motions similar: lengths grow with L, times and speeds with sqrt(L), rates with
1 / sqrt(L), forces with L^3 and moments with L^4.
"""

from __future__ import annotations

import math

import numpy as np

GRAVITY = 9.80665  # Standard acceleration of free fall [m/s^2] (CGPM 1901).
# Length [m] of the model for which constants that depend on the size of a ship are written.
MODEL_LENGTH = 3.0  # set by hand: that of the Esso Osaka model whose trials were the first


def length_scale(length: float) -> float:
    """Factor of lengths [-] from a 3 m model to a ship of ``length`` [m]."""
    return float(length) / MODEL_LENGTH


def time_scale(length: float) -> float:
    """Factor of times and speeds [-] from a 3 m model to a ship of ``length`` [m]; rates are divided by it."""
    return math.sqrt(length_scale(length))


def force_scale(length: float) -> float:
    """Factor of forces [-] from a 3 m model to a ship of ``length`` [m]; moments grow by ``length_scale`` more."""
    return length_scale(length) ** 3


def state_scale(length: float) -> np.ndarray:
    """Factors (6,) of x, y, psi, u, v, r from a 3 m model to a ship of ``length`` [m]."""
    lam, k = length_scale(length), time_scale(length)
    return np.array([lam, lam, 1.0, k, k, 1 / k])


def reference_speed(length: float) -> float:
    """Speed [m/s] at Froude number 1 of a ship of ``length`` [m]: sqrt(g L)."""
    return math.sqrt(GRAVITY * length)

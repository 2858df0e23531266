"""Tails of the usual distributions by ``scipy.special``: the values of ``scipy.stats``, which is slow to import."""

from __future__ import annotations

from scipy.special import fdtrc, ndtr, stdtrit


def normal_tail(value: float) -> float:
    """Probability that a standard normal number exceeds ``value``."""
    return float(ndtr(-value))


def student_quantile(probability: float, degrees: float) -> float:
    """Value that Student's t with so many ``degrees`` of freedom stays below with this ``probability``."""
    return float(stdtrit(degrees, probability))


def f_tail(value: float, degrees: float, others: float) -> float:
    """Probability that an F ratio with ``degrees`` and ``others`` degrees of freedom exceeds ``value``, 1 below 0."""
    return 1.0 if value <= 0 else float(fdtrc(degrees, others, value))

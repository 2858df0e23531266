"""Tails of the usual distributions by ``scipy.special``: the values of ``scipy.stats``, which is slow to import.

It is imported where one is wanted: a tenth of a second that most calls of a short command do without.
"""

from __future__ import annotations

import math


def normal_tail(value: float) -> float:
    """Probability that a standard normal number exceeds ``value``."""
    return 0.5 * math.erfc(value / math.sqrt(2.0))


def chi2_tail(value: float, degrees: float) -> float:
    """Probability that chi-squared with so many ``degrees`` of freedom exceeds ``value``, 1 below 0."""
    from scipy.special import chdtrc

    return 1.0 if value <= 0 else float(chdtrc(degrees, value))


def gamma_tail(value: float, shape: float, scale: float) -> float:
    """Probability that a gamma number of this ``shape`` and ``scale`` exceeds ``value``, 1 below 0."""
    from scipy.special import gammaincc

    return 1.0 if value <= 0 else float(gammaincc(shape, value / scale))


def student_quantile(probability: float, degrees: float) -> float:
    """Value that Student's t with so many ``degrees`` of freedom stays below with this ``probability``."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, probability))


def f_tail(value: float, degrees: float, others: float) -> float:
    """Probability that an F ratio with ``degrees`` and ``others`` degrees of freedom exceeds ``value``, 1 below 0."""
    from scipy.special import fdtrc

    return 1.0 if value <= 0 else float(fdtrc(degrees, others, value))

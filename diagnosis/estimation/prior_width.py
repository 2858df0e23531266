"""How wide the priors of the coefficients should have been: one factor on all of them, told by the trials.

Stated standard deviations of coefficients are rough: a method is said to be good to 8 %, and is to 3 % for this ship or
to 15 % for that one. Where they are too narrow, what the coefficients may not take up looks like an effect; where they
are too wide, they take up effects. About a fit the log likelihood is quadratic in the coefficients, so that with all
priors wider by s the marginal likelihood is known in closed form (empirical Bayes: Morris 1983; MacKay 1992):

    ln p(s) = 1/2 sum_i [ s^2 g_i^2 / (1 + s^2 l_i) - ln(1 + s^2 l_i) ] + const,

l the eigenvalues of the information of the trials on the coefficients [prior std], all else projected out, and g its
slope at the prior means along the eigenvectors.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate, estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.transition_model import TransitionModel
from mmg.messages import Message

LEAST, MOST = 0.25, 4.0
"""Factors that are tried."""
TWICE = 2.0
"""The largest factor that stands in for an effect: a method that is said to be good to 8 % may be to 15 %. Coefficients
that are farther off are a finding themselves. With factors up to four they hid pairs of effects."""
DOUBT = 0.5
"""Standard deviation of the natural logarithm of the factor before the trials: most ships lie within 60 to 160 %."""
STEP = 0.01
GRID = np.arange(np.log(LEAST), np.log(MOST) + STEP, STEP)
"""Logarithms of the factors that are tried, and their distance."""
TOLD = 1.25
"""Factor, or one over it, that makes a difference."""


class Width(NamedTuple):
    """The most likely factor on the stated priors, the standard error of its natural logarithm, and what it gains in
    log likelihood over the factor that the priors of the fit have already."""

    factor: float
    error: float
    gain: float


def likely_width(found: Estimate, present: float = 1.0, most: float = MOST) -> Width:
    """The most likely width of the coefficients' priors, up to the factor ``most``, at the fit ``found``, whose priors
    have the factor ``present`` already.

    Where no coefficient is free, that is kept.
    """
    own = np.flatnonzero(_of_coefficients(found.free))
    if not len(own) or not np.isfinite(found.covariance).all():
        return Width(present, DOUBT, 0.0)
    known = np.linalg.inv(found.covariance[np.ix_(own, own)])
    values, vectors = np.linalg.eigh(0.5 * (known + known.T) - np.eye(len(own)))
    values, slopes = np.maximum(values, 0.0), vectors.T @ (known @ found.p[own])
    tried = GRID[np.exp(GRID) <= most]
    logs = np.append(tried, np.log(present))
    square = np.exp(2 * (logs - np.log(present)))[:, None]
    each = slopes**2 * square / (1 + square * values) - np.log1p(square * values)
    likely = 0.5 * each.sum(axis=1) - 0.5 * (logs / DOUBT) ** 2
    weight = np.exp(likely[:-1] - likely[:-1].max())
    mean = float(weight @ tried / weight.sum())
    error = float(np.sqrt(weight @ (tried - mean) ** 2 / weight.sum()))
    best = int(np.argmax(likely))
    return Width(float(np.exp(logs[best])), error, float(likely[best] - likely[-1]))


def narrowed(
    steps: TransitionModel, data: GriddedTrials, null: Estimate, base: Priors, iterations: int
) -> tuple[Estimate, Priors, float]:
    """The fit ``null`` without effects and its stated priors ``base``, narrower where the trials say so, by one
    standard error less than they say; and by what factor. What is missing in the model makes them seem too narrow, so
    that they are not widened before it is known.

    steps, data, iterations: as of ``estimate``.
    """
    width = likely_width(null)
    factor = width.factor * float(np.exp(width.error))
    if factor > 1 / TOLD:
        return null, base, 1.0
    again = refitted_at(steps, data, null, factor, iterations)
    return (null, base, 1.0) if again is null else (again, widened(base, factor), factor)


def refitted_at(
    steps: TransitionModel, data: GriddedTrials, found: Estimate, factor: float, iterations: int = 8
) -> Estimate:
    """The fit ``found`` again with priors of the coefficients wider by ``factor`` than it has.

    steps, data, found, iterations: as of ``estimate``. Where the ship explodes with them it stays as it is.
    """
    free = widened(found.free, factor)
    start = replace(found, free=free, p=np.clip(found.p * found.free.std / free.std, *free.scaled_bounds))
    try:
        return estimate(steps, data, start, iterations)
    except (BrokenModelError, np.linalg.LinAlgError):
        return found


def widened(base: Priors, factor: float) -> Priors:
    """The priors ``base`` with the standard deviations of the ship's coefficients times ``factor``; those of effects
    stay."""
    return replace(base, std=np.where(_of_coefficients(base), factor, 1.0) * base.std)


def _of_coefficients(priors: Priors) -> np.ndarray:
    """Which columns (P,) are coefficients of the ship, not parameters of effects."""
    return np.array([c.run is None and "." not in c.symbol for c in priors.columns], dtype=bool)

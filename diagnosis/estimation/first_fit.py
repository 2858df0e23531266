"""The first fit of a diagnosis, without any effect, to samples so far apart that their errors are not correlated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Linearisation
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate, IsEnough, estimate, initial_point, never
from diagnosis.estimation.noise_sizes import swallows
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.residual_checks import (
    lag_correlation,
    residuals,
    spectral_line,
    with_correlation_time,
    with_gust_memory,
)
from diagnosis.estimation.transition_model import TransitionModel
from mmg.messages import LOGGER
from mmg.motion.froude import time_scale

# Correlation of neighbouring whitened residuals from which only samples APART are compared. On the records of the 3 m
# tanker it is .65; the latent force is then three times what it is with samples every 3, 5 or 10 s, and predictions are
# worse. With white errors it is below .05.
CORRELATED = 0.25
APART = (2.0, 5.0)  # Seconds [of a 3 m model]: the first at which it is less than half of that. Set by hand.
LEAST = 100  # Grid times that are left at least, however correlated they are. Set by hand.
# Expected gain in log likelihood by grid time compared below which a fit shows how correlated its residuals are.
NEARLY = 5e-3  # set by hand
SURELY = 1.5  # Times the limit that is surely too much: the fit ends, as one with samples farther apart follows
FEW = 20  # Grid times that must be left where the interval is known from other trials. Set by hand.
# Linearisations of the first fit. Of all fits before and after effects are selected. Set by hand: it bounds time.
MAX_FITS = 12


@dataclass(frozen=True)
class FirstFit:
    """The fit ``null`` without effects of ``data``, one in ``gap`` grid times compared; dense: all of them with their
    residuals; correlation: of neighbouring ones of these; line: sharpest in their spectrum (``spectral_line``)."""

    data: GriddedTrials
    null: Estimate
    gap: int
    dense: tuple[GriddedTrials, np.ndarray]
    correlation: float
    line: tuple[float, float] = (1.0, 0.0)

    def finished(self, steps: TransitionModel) -> FirstFit:
        """With the memories of the random forces, converged, and with the ``line``; steps: the transition model."""
        data, null = self.data, self.null
        null = with_gust_memory(steps, data, with_correlation_time(steps, data, null))
        if not null.converged:  # the slopes of all tests are those at the optimum
            null = estimate(steps, data, null, MAX_FITS)
        if self.gap == 1:
            return replace(self, null=null, line=spectral_line(*self.dense))
        return replace(self, null=null, line=spectral_line(data, residuals(steps, data, null), self.dense))


def fit_without_effects(
    steps: TransitionModel, data: GriddedTrials, theta: np.ndarray, base: Priors, noise: NoiseModel, gap: int = 0
) -> FirstFit:
    """Fit without effects, first on all samples, and again on fewer where neighbouring residuals are correlated.

    steps: the transition model; data: the trials; theta: (all,) first coefficients; base: their priors; noise: first
    sizes; gap: one in so many grid times was compared in other trials, 0: not known. Returns the fit, not ``finished``.
    """
    p = (theta[[steps.ship.symbols.index(s) for s in base.symbols]] - base.mean) / base.std  # [prior std]
    most = max(1, data.samples // (FEW if gap else LEAST))
    each = [min(gap or max(1, round(s * time_scale(steps.ship.particulars["L"]) / data.h)), most) for s in APART]
    enough = partial(_surely_correlated, 0.0 if gap else CORRELATED) if each[0] > 1 else never
    null, p = _first_fit(steps, data, theta, base, noise, p, enough)
    dense = (data, residuals(steps, data, null))
    correlation = lag_correlation(*dense)
    apart, crowded = 1, correlation > CORRELATED or swallows(null.noise, steps.ship)
    for number, apart in enumerate(each if gap or crowded else ()):
        enough = never if gap or number == len(each) - 1 else partial(_surely_correlated, 0.5 * CORRELATED)
        if apart > 1:
            data = dense[0].thinned(apart)
            start = initial_point(steps, data, theta, base, noise, p)
            null = estimate(steps, data, start, MAX_FITS, is_enough=enough)
            left = lag_correlation(data, residuals(steps, data, null))
        if gap or apart == 1 or (left < 0.5 * CORRELATED and not swallows(null.noise, steps.ship)):
            break
    return FirstFit(data, null, apart, dense, correlation)


def _surely_correlated(limit: float, here: Linearisation, gain: float) -> bool:
    """Whether residuals ``here`` are correlated by surely more than ``limit``, where a step gains at most ``gain``."""
    data = here.data
    near = gain < NEARLY * data.samples
    return near and lag_correlation(data, np.where(data.good, here.left, 0.0)) > SURELY * limit


def _first_fit(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    base: Priors,
    noise: NoiseModel,
    p: np.ndarray,
    is_enough: IsEnough,
) -> tuple[Estimate, np.ndarray]:
    """The fit from coefficients ``p`` [prior std] or, where the ship explodes with them, from the prior means; and from
    which. is_enough: as of ``estimate``."""
    start = initial_point(steps, data, theta, base, noise, p)
    try:
        return estimate(steps, data, start, MAX_FITS, is_enough=is_enough), p
    except BrokenModelError:
        if not p.any():
            raise
    LOGGER.info("the ship explodes along these trials: fitted again from the means of its priors")
    return _first_fit(steps, data, theta, base, noise, np.zeros(len(p)), is_enough)

"""Prior on each effect, estimated from the calibration trials.

No model is perfect: on its own trials, too, a calibrated ship looks a little late, or as if its antenna stood
elsewhere. Other trials must show more than that. All effects are fitted to the trials of the calibration
together, with priors of their typical sizes, and the scatter of each from run to run is estimated (by
expectation-maximisation); both become the prior of the effect in other trials (empirical Bayes, Robbins 1956).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.candidates import Candidate, Column
from diagnosis.estimation.first_fit import MAX_FITS
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Point, linearise_and_filter, path_of_all_states
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.parameters import Priors, priors_of_effects
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.unnamed import unnamed_forms

LEAST = 0.1  # Least standard deviation of an effect between runs, in typical sizes. Set by hand.
ROUNDS = 20  # Of expectation-maximisation. Set by hand.
# Standard deviations within which an effect is the usual misfit in other trials. Without this limit trials with hardly
# any random force had a current fitted 79 of them off before it was looked for.
USUAL = 4.0
# Typical sizes from which an effect in the trials of the calibration is a gap there already, no usual misfit.
STRONG = 2.0  # set by hand


@dataclass(frozen=True)
class Reference:
    """What the trials of the calibration show.

    priors: of the coefficients and of the parameters of all effects, for other trials; candidates: with the estimates
    as neutral values, unless they are STRONG; strong: those that are; theta: (all,) first coefficients; shift, scatter:
    of each parameter, and its standard deviation between runs [typical sizes]; unnamed: log Bayes factor of unnamed
    forms per grid time compared; unexplained: that without strong effects; noise: sizes of what is random.
    """

    priors: Priors
    candidates: tuple[Candidate, ...]
    strong: tuple[Candidate, ...]
    theta: np.ndarray
    shift: dict[Column, float]
    scatter: dict[Column, float]
    unnamed: float
    unexplained: float
    noise: NoiseModel


def fit_reference(
    steps: TransitionModel,
    data: GriddedTrials,
    null: Estimate,
    base: Priors,
    candidates: Sequence[Candidate],
    runs: int = 1,
) -> Reference:
    """Fit all effects to the trials of the calibration, and estimate how they scatter from run to run.

    steps: the transition model; data: those trials; null: the fit without effects; base: priors of the coefficients;
    candidates: the effects; runs: number of the other trials, whose mean scatters less. Returns the priors for them.
    """
    effects = priors_of_effects(candidates, 1.0)
    free = base + effects
    p = np.concatenate([null.p, np.zeros(len(effects.symbols))])
    start = Point(null.theta, free, p, path_of_all_states(steps, data, null), null.noise)
    found = _with_likeliest_noise(steps, data, start)
    spread = _scatter(steps, data, found, len(base.symbols))
    P, known = len(base.symbols), found.p.copy()
    std = np.sqrt(np.diag(found.covariance))
    std[P:] = np.hypot(std[P:], spread / np.sqrt(runs))  # the mean of the other runs scatters too
    moved: list[Candidate] = []
    strong: list[Candidate] = []
    for c in candidates:
        at = [free.columns.index(x) for x in c.columns]
        if np.abs(found.p[at]).max() > STRONG:
            strong.append(c)
            known[at], std[at] = 0.0, np.minimum(spread[np.array(at) - P] / np.sqrt(runs), 1.0)
        moved.append(replace(c, neutral=free.mean[at] + free.std[at] * known[at]))
    value = free.mean + free.std * known
    theta = found.theta.copy()
    theta[[steps.ship.symbols.index(s) for s in free.symbols]] = value
    shift, scatter = (dict(zip(effects.columns, x.tolist(), strict=True)) for x in (found.p[P:], spread))
    rest = max(unnamed_forms(steps, data, found).mixture, 0.0) / data.samples
    whole = rest
    if strong:
        whole = max(
            unnamed_forms(steps, data, _without(steps, data, found, [c for c in moved if c in strong])).mixture, 0.0
        )
        whole /= data.samples
    priors = replace(free, mean=value, std=free.std * std)
    reach = np.where(np.arange(len(value)) < P, np.inf, USUAL * priors.std)
    priors = replace(priors, lower=np.maximum(free.lower, value - reach), upper=np.minimum(free.upper, value + reach))
    return Reference(priors, tuple(moved), tuple(strong), theta, shift, scatter, rest, whole, found.noise)


def _with_likeliest_noise(steps: TransitionModel, data: GriddedTrials, start: Point) -> Estimate:
    """The fit of ``start``, with its noise, that of the fit itself, or half way between them: where the likelihood is
    the largest with the parameters integrated out (Laplace's approximation).

    So many parameters can explain most of the random force of a few runs. The likelihood is then largest with hardly
    any, and errors as small, unless they are integrated out (restricted likelihood, Harville 1977).
    """
    fits = [estimate(steps, data, start, MAX_FITS, fixed_noise=True), estimate(steps, data, start, MAX_FITS)]
    one, other = (fit.noise for fit in fits)
    # half way in the logarithms
    between = one.with_(force=np.sqrt(one.force * other.force), white=np.sqrt(one.white * other.white))
    fits.append(estimate(steps, data, replace(fits[0], noise=between), MAX_FITS, fixed_noise=True))
    # Laplace: + log det of the information / 2
    return min(fits, key=lambda fit: fit.nll - 0.5 * float(np.linalg.slogdet(fit.covariance)[1]))


def _without(steps: TransitionModel, data: GriddedTrials, fit: Estimate, effects: Sequence[Candidate]) -> Estimate:
    """The fit with these effects at their neutral values."""
    theta, at_neutral = fit.theta.copy(), [s for c in effects for s in c.symbols]
    theta[[steps.ship.symbols.index(s) for s in at_neutral]] = np.concatenate([c.neutral for c in effects])
    kept = [s not in at_neutral for s in fit.free.symbols]
    start = Point(theta, fit.free.only(kept), fit.p[kept], fit.path, fit.noise)
    return estimate(steps, data, start, MAX_FITS)


def _scatter(steps: TransitionModel, data: GriddedTrials, fit: Estimate, first: int) -> np.ndarray:
    """Standard deviation between runs of the columns from ``first`` on, in their prior std, by EM."""
    linearised = linearise_and_filter(steps, data, fit)
    grams = np.einsum("krca,krcb->rab", linearised.white, linearised.white, optimize=True)
    slopes = -(grams[:, :-1, -1] + linearised.logdet_gradient)
    runs = np.unique(data.run)
    G = np.array([grams[data.run == r][:, first:-1, first:-1].sum(axis=0) for r in runs])
    g = np.array([slopes[data.run == r][:, first:].sum(axis=0) for r in runs])
    std = np.ones(G.shape[1])
    for _ in range(ROUNDS):
        C = np.linalg.inv(G + np.diag(std**-2.0))  # E: covariance of each run's own value
        move = np.einsum("rab,rb->ra", C, g)
        std = np.sqrt(np.mean(move**2 + np.einsum("raa->ra", C), axis=0))  # M: mean of the expected squares
        std = np.maximum(std, LEAST)
    return std

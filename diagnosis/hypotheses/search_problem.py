"""What all hypotheses of a search share: model, trials, priors of the coefficients, candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.prior_width import TWICE, likely_width
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.found_again import OtherTrials, other_trials
from diagnosis.hypotheses.known_results import KnownResults
from diagnosis.hypotheses.refit import likelihood
from diagnosis.hypotheses.unnamed import UnnamedForms, unnamed_forms


def gained(fewer: Estimate, kept: int, more: Estimate, every: int, present: float | None = 1.0) -> float:
    """Log likelihood that the fit ``more`` gains over ``fewer``, whose last ``every`` and ``kept`` columns are of
    effects, each with the most likely width of the coefficients' priors, which have the factor ``present`` on those
    stated, None where none are: coefficients that are farther off than stated are no effect, and one that explains why
    they seemed so counts for less. An effect that asks for wider priors itself gains nothing by these: coefficients so
    far off that nothing is linear there would have to follow.
    """
    gain = likelihood(fewer, kept) - likelihood(more, every)
    if present is None:
        return gain
    return gain + min(likely_width(more, present, TWICE).gain - likely_width(fewer, present, TWICE).gain, 0.0)


@dataclass(frozen=True)
class SearchProblem:
    """What all hypotheses share: the transition model of the full ship, data, priors of its coefficients, candidates.

    expected_unnamed: log Bayes factor of unnamed forms that the trials of the calibration show, for as many samples;
    expected_unnamed_null: the same without the effects that are strong in those trials; tests: trials that take no part
    in any fit, or None; factor: by which ``base`` is narrower than stated (``prior_width``), None where these are no
    stated priors but another calibration; known: what searches have found, with whatever candidates.
    """

    steps: TransitionModel
    data: GriddedTrials
    base: Priors
    candidates: tuple[Candidate, ...]
    expected_unnamed: float = 0.0
    expected_unnamed_null: float = 0.0
    tests: GriddedTrials | None = None
    factor: float | None = None
    known: KnownResults = field(default_factory=KnownResults, compare=False, repr=False)

    def gained(self, fewer: Estimate, kept: int, more: Estimate, every: int) -> float:
        """``gained`` by the fit ``more`` with ``every`` columns of effects over ``fewer`` with those ``kept``."""
        return gained(fewer, kept, more, every, self.factor)

    def unnamed(self, fit: Estimate) -> UnnamedForms:
        """What unnamed forms explain at a ``fit``; the last one is kept."""
        return self.known.unnamed(fit, partial(unnamed_forms, self.steps, self.data, fit))

    def followed(self, fit: Estimate, tests: GriddedTrials) -> OtherTrials:
        """The trials ``tests`` that took no part, followed by a ``fit``."""
        return self.known.followed(fit, partial(other_trials, self.steps, tests, fit))

    def without(self, found: Estimate, kept: Sequence[Candidate]) -> Estimate:
        """The fit ``found`` as a start of one with the effects ``kept``, the others at neutral values."""
        theta, remains = found.theta.copy(), {c.effect for c in kept}
        for c in self.candidates:
            if c.effect not in remains:
                for s, value in zip(c.symbols, c.neutral, strict=True):
                    theta[self.steps.ship.symbols.index(s)] = value
        if theta.ndim > 1 and np.ptp(theta, axis=1).max() == 0:
            theta = theta[:, 0].copy()
        return replace(found, theta=theta)

    @property
    def cost(self) -> float:
        """ln N of the BIC."""
        return float(np.log(self.data.samples))

"""What all hypotheses of a search share: model, trials, priors of the coefficients, candidates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.prior_width import TOLD, Width, likely_width, refitted_at
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.refit import likelihood


def likelihood_of_width(found: Estimate, own: int, present: float = 1.0) -> float:
    """``likelihood`` of the fit ``found``, whose last ``own`` columns are of effects, with the most likely width of the
    coefficients' priors, which have the factor ``present`` on those stated."""
    return likelihood(found, own) - likely_width(found, present).gain


@dataclass(frozen=True)
class SearchProblem:
    """What all hypotheses share: the transition model of the full ship, data, priors of its coefficients, candidates.

    expected_unnamed: log Bayes factor of unnamed forms that the trials of the calibration show, for as many samples;
    expected_unnamed_null: the same without the effects that are strong in those trials; tests: trials that take no part
    in any fit, or None; factor: by which ``base`` is narrower than stated (``prior_width``), None where these are no
    stated priors but another calibration.
    """

    steps: TransitionModel
    data: GriddedTrials
    base: Priors
    candidates: tuple[Candidate, ...]
    expected_unnamed: float = 0.0
    expected_unnamed_null: float = 0.0
    tests: GriddedTrials | None = None
    factor: float | None = None

    def likelihood(self, found: Estimate, own: int) -> float:
        """``likelihood`` of the fit ``found``, whose last ``own`` columns are of effects, with the width of the priors
        that is most likely with these: coefficients that are farther off than stated are no effect, and an effect that
        explains why they seemed so counts for that too."""
        return likelihood(found, own) if self.factor is None else likelihood_of_width(found, own, self.factor)

    def width(self, found: Estimate) -> Width:
        """The most likely width of the stated priors at a fit."""
        return Width(1.0, 0.0, 0.0) if self.factor is None else likely_width(found, self.factor)

    def with_wider(self, found: Estimate) -> Estimate:
        """The fit with wider priors than stated, where these are more likely."""
        factor = self.width_taken(found)
        if self.factor is None or factor == self.factor:
            return found
        return refitted_at(self.steps, self.data, found, factor / self.factor)

    def width_taken(self, found: Estimate) -> float:
        """The factor on the stated priors with which a hypothesis is judged at last: the most likely one where it is
        wider than stated, else that of ``base``."""
        factor = self.width(found).factor
        return factor if factor > TOLD else self.factor or 1.0

    @property
    def cost(self) -> float:
        """ln N of the BIC."""
        return float(np.log(self.data.samples))

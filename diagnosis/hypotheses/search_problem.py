"""What all hypotheses of a search share: model, trials, priors of the coefficients, candidates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.transition_model import TransitionModel


@dataclass(frozen=True)
class SearchProblem:
    """What all hypotheses share: the transition model of the full ship, data, priors of its coefficients, candidates.

    expected_unnamed: log Bayes factor of unnamed forms that the trials of the calibration show, for as many samples;
    expected_unnamed_null: the same without the effects that are strong in those trials; tests: trials that take no part
    in any fit, or None.
    """

    steps: TransitionModel
    data: GriddedTrials
    base: Priors
    candidates: tuple[Candidate, ...]
    expected_unnamed: float = 0.0
    expected_unnamed_null: float = 0.0
    tests: GriddedTrials | None = None

    @property
    def cost(self) -> float:
        """ln N of the BIC."""
        return float(np.log(self.data.samples))

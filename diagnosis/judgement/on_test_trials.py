"""The test trials of a diagnosis: errors of their predictions by each of its fits, calculated once."""

from __future__ import annotations

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import HeldOut
from diagnosis.validation.held_out import PredictionErrors, compare, prediction_errors


class OnTestTrials:
    """Errors of test trials by fits.

    steps: the transition model; data: the test trials; seed: of the draws that give intervals.
    """

    def __init__(self, steps: TransitionModel, data: GriddedTrials, seed: int) -> None:
        self.steps, self.data, self.seed = steps, data, seed
        self._known: dict[int, tuple[Estimate, PredictionErrors | None]] = {}

    def errors(self, fit: Estimate) -> PredictionErrors | None:
        """Errors by a ``fit``."""
        if id(fit) not in self._known:  # the fit is kept, so that no other takes its number
            self._known[id(fit)] = fit, prediction_errors(self.steps, self.data, fit)
        return self._known[id(fit)][1]

    def compare(self, before: Estimate, after: Estimate) -> HeldOut | None:
        """How far the errors fall from the fit ``before`` to the fit ``after``; None without a whole window."""
        return compare(self.data, self.errors(before), self.errors(after), self.seed)

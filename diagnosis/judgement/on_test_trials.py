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
        self._known: dict[tuple[int, bool], tuple[Estimate, PredictionErrors | None]] = {}

    def errors(self, fit: Estimate, second_half: bool = False) -> PredictionErrors | None:
        """Errors by a ``fit``. second_half: as of ``prediction_errors``."""
        key = id(fit), second_half
        if key not in self._known:  # the fit is kept, so that no other takes its number
            self._known[key] = fit, prediction_errors(self.steps, self.data, fit, second_half)
        return self._known[key][1]

    def compare(self, before: Estimate, after: Estimate) -> HeldOut | None:
        """How far the errors fall from the fit ``before`` to the fit ``after``; None without a whole window."""
        by_run = before.free.by_run or after.free.by_run
        return compare(self.data, self.errors(before, by_run), self.errors(after, by_run), self.seed)

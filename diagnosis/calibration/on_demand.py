"""What a calibration asks a diagnosis for: its modules are read only where that is worked out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cases.trial import Trial
from fitting.result import FitResult
from mmg.ship import Ship


def second_estimate(ship: Ship, trials: Sequence[Trial]) -> Mapping[str, float] | str:
    """As ``filter_estimate`` of ``ship`` on ``trials``: values by symbol, or why there are none."""
    from diagnosis.calibration.filter_estimate import filter_estimate

    return filter_estimate(ship, trials)


def tests_of_effects(result: FitResult, start: Ship) -> FitResult:
    """As ``with_effect_tests`` of a ``result`` from the ship ``start``."""
    from diagnosis.calibration.freed_effects import with_effect_tests

    return with_effect_tests(result, start)

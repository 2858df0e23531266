"""The second estimate of a calibration, by name: its modules are read by the process that works it out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cases.trial import Trial
from mmg.ship import Ship


def second_estimate(ship: Ship, trials: Sequence[Trial]) -> Mapping[str, float] | str:
    """As ``filter_estimate`` of ``ship`` on ``trials``: values by symbol, or why there are none."""
    from diagnosis.calibration.filter_estimate import filter_estimate

    return filter_estimate(ship, trials)

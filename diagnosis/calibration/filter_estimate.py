"""Coefficients by a Kalman filter: the fit without effects with which a diagnosis begins, for a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cases.evidence.kinematics import consistency
from cases.trial import Trial
from diagnosis.estimation.gridded_trials import possible_readings
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate
from diagnosis.inputs import diagnosable_trials
from diagnosis.prepare import fit_of_more, prepare, with_sensor_faults
from fitting.nlp.grid import default_step
from mmg.errors import UserError
from mmg.ship import Ship

MOST = 40_000
"""Steps of a filter that take 2 GB (13,460 s of a 3 m model: 0.6 GB)."""
FEW = 3_000
"""Steps of trials that are fitted first where there are at least twice as many: sizes of the noise and how far apart
samples are compared hardly depend on the rest. On 35 records 20 linearisations of all trials become seven."""
FINE = 0.25
"""Samples so short, in steps of the filter, that it hardly matters whether actuators are held or joined between them:
one reading is fitted then, not both."""


def filter_estimate(ship: Ship, trials: Sequence[Trial]) -> Mapping[str, float] | str:
    """Values of the free coefficients of ``ship`` by symbol, from ``trials``, or why there are none.

    The most likely ones with random forces, gusts and sensor noise of estimated sizes, as predictions of the next
    sample tell; free faults of instruments are found anew by the kinematics of the trials. Priors are the values
    and standard deviations of the ship, as in a calibration.
    """
    rows = {
        s: c.with_(prior_value=None, prior_std=None) for s, c in ship.coefficients.items() if c.prior_std is not None
    }
    ship = ship.without_network().with_coefficients(rows)
    for name in {s.partition(".")[0] for s in ship.free if "." in s}:
        ship = ship.without_effect(name)
    try:
        kept, _ = diagnosable_trials(trials)
        ship, _ = with_sensor_faults(ship, consistency(kept, ship))
        step = default_step(kept, ship.particulars["L"])
        steps = _duration(kept) / step
        if steps > MOST:
            return f"a filter of {steps:.0f} steps would take too much memory (at most {MOST})"
        few = _some(kept, max(1, int(steps // FEW)))
        found, null = _fitted(ship, kept, few if default_step(few, ship.particulars["L"]) == step else kept)
    except (UserError, BrokenModelError, np.linalg.LinAlgError) as error:
        return f"a filter could not be fitted ({error})"
    values = dict(zip(found.symbols, null.theta.tolist(), strict=True))
    return {s: values[s] for s in null.free.symbols if "." not in s}


def _duration(trials: Sequence[Trial]) -> float:
    """Of all ``trials`` together [s]."""
    return sum(trial.duration for trial in trials)


def _some(trials: Sequence[Trial], every: int) -> Sequence[Trial]:
    """One in ``every`` of the ``trials``, beginning where they last nearest to that share of all."""
    share = _duration(trials) / every
    each = [trials[first::every] for first in range(min(every, len(trials)))]
    return min(each, key=lambda some: abs(_duration(some) - share))


def _fitted(ship: Ship, trials: Sequence[Trial], few: Sequence[Trial]) -> tuple[Ship, Estimate]:
    """The fit without effects to all ``trials``, begun at that to a ``few`` of them; and the ship whose coefficients it
    has."""
    is_fine = max(t.dt for t in trials) <= FINE * default_step(trials, ship.particulars["L"])
    straight = possible_readings(trials)[-1] if is_fine else None
    try:
        ready = prepare(ship, few, straight=straight, tests_follow=False)
    except UserError:
        if len(few) == len(trials):
            raise
        return _fitted(ship, trials, trials)
    return ready.full.ship, ready.null if len(few) == len(trials) else fit_of_more(ready, ship, trials)

"""Coefficients by a Kalman filter: the fit without effects with which a diagnosis begins, for a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cases.evidence.kinematics import consistency
from cases.trial import Trial
from diagnosis.estimation.gridded_trials import possible_readings
from diagnosis.estimation.map_estimate import BrokenModelError
from diagnosis.estimation.parameters import mean_over_windows
from diagnosis.inputs import diagnosable_trials
from diagnosis.prepare import prepare, with_sensor_faults
from fitting.nlp.grid import default_step
from mmg.errors import UserError
from mmg.ship import Ship

MOST = 40_000
"""Steps of a filter that take 2 GB (13,460 s of a 3 m model: 0.6 GB)."""
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
        steps = sum(float(t["t"][-1] - t["t"][0]) for t in kept) / step
        if steps > MOST:
            return f"a filter of {steps:.0f} steps would take too much memory (at most {MOST})"
        is_fine = max(t.dt for t in kept) <= FINE * step
        ready = prepare(ship, kept, straight=possible_readings(kept)[-1] if is_fine else None)
    except (UserError, BrokenModelError, np.linalg.LinAlgError) as error:
        return f"a filter could not be fitted ({error})"
    theta = mean_over_windows(ready.null.theta)
    found = dict(zip(ready.full.ship.symbols, theta.tolist(), strict=True))
    return {s: found[s] for s in ready.null.free.symbols if "." not in s}

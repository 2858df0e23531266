"""The extreme motions and inputs at which a polynomial must not accelerate more than the ship was seen to.

Miyauchi et al. (2023), section 3.1.2: 1,350 combinations of motions at the edges of the data and inputs that are
expected to give the largest forces, in calm air; the limit of each acceleration is the 99.7th percentile of its modulus
in the data, by differences averaged over 1 s. Their levels were lost in conversion: 1,350 = 27 x 50 is read as three
levels of u, v and r, two of the revolutions and five of each of two rudders (UNVERIFIED).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cases.simulation.harbour_inputs import ranges_of
from cases.trial import Trial
from mmg.motion.flow import INPUTS
from mmg.motion.froude import time_scale
from mmg.ship import Ship

MARGIN = 1.2
"""Factor on the range of the motions of the trials."""
INPUTS_EACH = 50
"""Most combinations of inputs at each of the 27 motions."""
LEVELS = {"rps": 2, "rad": 5}
"""Levels of an actuator by its unit."""
PERCENTILE = 99.7


@dataclass(frozen=True)
class Extremes:
    """Motions and inputs at which accelerations are limited.

    state: (6, m); controls: (C, m), in the order of the ship's inputs; limit: (3,) of du/dt, dv/dt [m/s^2] and dr/dt
    [rad/s^2].
    """

    state: np.ndarray
    controls: np.ndarray
    limit: np.ndarray


def extremes_of(ship: Ship, trials: Sequence[Trial], seed: int = 0) -> Extremes:
    """The extremes for ``ship`` by the range of ``trials``, 1,350 for one propeller and two rudders.

    Where there are more than INPUTS_EACH combinations of the actuators' levels, so many of them are drawn; seed: of
    that draw.
    """
    low, high = (f(np.concatenate([t["u"] for t in trials])) for f in (np.nanmin, np.nanmax))
    motions = [np.array([MARGIN * min(low, -0.1 * high), 0.5 * (low + high), MARGIN * high])]
    for name in ("v", "r"):
        most = MARGIN * max(float(np.nanmax(np.abs(t[name]))) for t in trials)
        motions.append(np.array([-most, 0.0, most]))
    levels = []
    for name, (lowest, highest) in ranges_of(ship).items():
        given = np.concatenate([t[name] for t in trials if name in t] or [np.zeros(1)])
        edges = min(lowest, float(np.nanmin(given))), max(highest, float(np.nanmax(given)))
        levels.append(np.linspace(*edges, LEVELS.get(INPUTS[name][1], 3)))
    each = np.array(list(product(*levels)))
    if len(each) > INPUTS_EACH:
        rng = np.random.default_rng([29, seed])
        each = each[np.sort(rng.choice(len(each), INPUTS_EACH, replace=False))]
    pairs = [(m, c) for m in product(*motions) for c in each]
    state, controls = np.zeros((6, len(pairs))), np.zeros((len(ship.inputs), len(pairs)))
    state[3:] = np.transpose([m for m, _ in pairs])
    for column, name in enumerate(ranges_of(ship)):
        controls[ship.inputs.index(name)] = [c[column] for _, c in pairs]
    return Extremes(state, controls, acceleration_limits(trials, time_scale(ship.particulars["L"])))


def acceleration_limits(trials: Sequence[Trial], seconds: float) -> np.ndarray:
    """The PERCENTILE of the modulus of du/dt, dv/dt, dr/dt (3,) in ``trials``, differences averaged over ``seconds``.

    Raises ValueError where no trial has two finite neighbours.
    """
    found: list[np.ndarray] = []
    for trial in trials:
        span = max(1, round(seconds / trial.dt))
        rows = np.column_stack([trial[name] for name in ("u", "v", "r")])
        found.append((rows[span:] - rows[:-span]) / (trial.t[span:] - trial.t[:-span])[:, None])
    rates = np.abs(np.concatenate(found))
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not len(rates):
        raise ValueError("no accelerations in the trials")
    return np.percentile(rates, PERCENTILE, axis=0)

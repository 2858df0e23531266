"""Forces of the ship as given, at motions and actuator positions beyond the trials, as weak data of a generated model.

A polynomial knows nothing where no trial was. Miyauchi et al. (2023) keep it from running away by a penalty on
accelerations at 1,350 combinations of extreme states and inputs. Here the forces at as many points are drawn towards
those of the ship's own force models, as loosely as by COUNT_AS points with an error of their whole size.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.simulation.harbour_inputs import ranges_of
from cases.trial import Trial
from fitting.nlp.captive import FORCES, Captive
from mmg.model import assemble
from mmg.ship import Ship

POINTS = 1350
"""Number of points, that of the paper."""
COUNT_AS = 50.0
"""Number of independent points that they count as."""
BEYOND = 1.3
"""Factor on the range of the motions of the trials."""


def anchor_points(ship: Ship, trials: Sequence[Trial], seed: int = 0) -> Captive:
    """POINTS points with the forces of ``ship``, its coefficients as they are, without wind.

    Motions lie in the range of the ``trials`` and BEYOND it, half of them on its edges; actuators in the range of
    harbour use and of the trials. seed: of the draws.
    """
    rng = np.random.default_rng([23, seed])
    motion = []
    for name in ("u", "v", "r"):
        values = np.concatenate([t[name] for t in trials])
        low, high = np.nanmin(values), np.nanmax(values)
        most = BEYOND * max(abs(low), abs(high))
        edges = (BEYOND * min(low, -0.3 * high), BEYOND * high) if name == "u" else (-most, most)
        motion.append(_spread(rng, *edges))
    actuators = {}
    for name, (lowest, highest) in ranges_of(ship).items():
        given = np.concatenate([t[name] for t in trials if name in t] or [np.zeros(1)])
        actuators[name] = _spread(rng, min(lowest, np.nanmin(given)), max(highest, np.nanmax(given)))
    model = assemble(ship)
    still = {"wind_north": motion[0], "wind_east": motion[1]}
    zero = np.zeros(POINTS)
    controls = np.array([(actuators | still).get(name, zero) for name in model.controls])
    state = np.array(model.initial(np.vstack([zero, zero, zero, *motion]), controls, ship.values))
    rows = np.array(model.forces(state, controls, ship.values)).reshape(len(model.roles), POINTS, 3)
    forces = rows[[i for i, role in enumerate(model.roles) if role != "wind"]].sum(axis=0).T
    size = np.sqrt((forces**2).mean(axis=1, keepdims=True)) + 1e-12
    sigma = np.broadcast_to(np.sqrt(POINTS / COUNT_AS) * size, (len(FORCES), POINTS)).copy()
    return Captive("anchors", np.array(motion), actuators, forces, sigma)


def _spread(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """Points (POINTS,) between two limits, half of them on one of these."""
    inside = rng.uniform(low, high, POINTS)
    edge = np.where(rng.random(POINTS) < 0.5, low, high)
    return np.where(rng.random(POINTS) < 0.5, edge, inside)

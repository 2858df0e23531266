"""The envelope of trials: the range of motion, actuators and air that they held, beyond which a ship extrapolates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.inputs import model_inputs
from cases.trial import Trial
from mmg.model import assemble, states_behind
from mmg.ship import Ship

DRIFT = "beta"
"""Drift angle atan2(-v, u) [rad], beside the features of a ship."""
SLOW = 0.1
"""Below this share of the greatest speed ahead or astern a drift angle has no meaning."""


def envelope_of(names: Sequence[str], features: np.ndarray) -> dict[str, list[float]]:
    """Least and greatest value of each row of ``features`` (F, M) by its name of ``names``, and of the drift angle."""
    if not features.size:
        return {}
    found = {name: [float(row.min()), float(row.max())] for name, row in zip(names, features, strict=True)}
    u, v = (features[list(names).index(axis)] for axis in "uv")
    moving = np.hypot(u, v) > SLOW * np.abs(u).max()
    beta = np.arctan2(-v[moving], u[moving])
    return found | ({DRIFT: [float(beta.min()), float(beta.max())]} if moving.any() else {})


def trial_envelope(ship: Ship, trials: Sequence[Trial]) -> dict[str, list[float]]:
    """What ``envelope_of`` gives of the rows of ``trials`` in which everything is known.

    The features are those of ``ship``: velocities through the water, actuators behind their lags, air relative to the
    hull. Returns {} where no row is complete.
    """
    model, parts = assemble(ship.without_network()), []
    for trial in trials:
        logged, held = trial.states.T, model_inputs(trial, ship.inputs).array.T
        logged[:2] = np.where(np.isfinite(logged[:2]), logged[:2], 0.0)
        good = np.isfinite(logged).all(axis=0) & np.isfinite(held).all(axis=0)
        if good.any():
            states = states_behind(model, logged[:, good], held[:, good], ship.values)
            parts.append(model.at_points("features", states, held[:, good], ship.values))
    return envelope_of(ship.features, np.hstack(parts)) if parts else {}

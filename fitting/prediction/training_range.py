"""How much of a hybrid's prediction lies outside the range of the data that its network was trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.inputs import model_inputs
from cases.trial import Trial
from fitting.prediction.predict import Window
from mmg.model import states_behind
from mmg.rollout import Simulator


def outside_share(simulator: Simulator, trial: Trial, windows: Sequence[Window]) -> float | None:
    """Share of rows predicted by ``simulator`` in ``windows`` of ``trial`` with a network input outside its training
    range.

    None for a ship without a network or without windows. Rows without inputs count nothing.
    """
    network, model = simulator.ship.network, simulator.model
    if network is None or not windows:
        return None
    controls = model_inputs(trial, simulator.ship.inputs).array
    logged = np.vstack([w.states for w in windows]).T
    held = np.vstack([controls[w.first : w.last + 1] for w in windows]).T
    good = np.isfinite(logged).all(axis=0) & np.isfinite(held).all(axis=0)
    if not good.any():
        return None
    logged, held, values = logged[:, good], held[:, good], simulator.ship.values
    features = np.array(model.features(states_behind(model, logged, held, values), held, values))
    order = [simulator.ship.features.index(name) for name in network.features]
    return float(network.outside(features[order]).mean())

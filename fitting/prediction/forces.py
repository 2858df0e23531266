"""Forces of the components of a ship along a measured motion."""

from __future__ import annotations

import numpy as np

from cases.trial import Trial
from fitting.prediction.predict import record_of
from mmg.components.rigid_body import inertia
from mmg.model import states_behind
from mmg.rollout import Simulator

NETWORK = "learned residual"  # Role under which the accelerations of a network, times the masses, are shown

Forces = dict[str, np.ndarray]
"""Role -> (N, 3)."""


def forces_along(simulator: Simulator, trial: Trial) -> Forces:
    """Force of each component along the measured motion of ``trial``, role -> (N, 3): X, Y [N], N [N m], body axes.

    simulator: of the ship; what its effects remember is taken as settled at each sample. NaN where a state or an input
    is missing. The accelerations of a network are shown as the force that they stand for.
    """
    ship, model = simulator.ship, simulator.model
    record = record_of(trial, ship.inputs)
    good = record.good
    logged, controls, values = record.states[good].T, record.controls[good].T, ship.values
    if not good.any():
        return {}
    states = states_behind(model, logged, controls, values)
    rows = np.array(model.forces(states, controls, values)).reshape(len(model.roles), -1, 3)

    def at_all_rows(part: np.ndarray) -> np.ndarray:
        result = np.full((len(good), 3), np.nan)
        result[good] = part
        return result

    forces = {role: at_all_rows(rows[i]) for i, role in enumerate(model.roles)}
    if ship.network is not None:
        without = Simulator(ship.without_network(), compiled=simulator.compiled)
        added = simulator.rates(states, controls)[3:6] - without.rates(states, controls)[3:6]
        mass = inertia(ship.namespace, type(ship.namespace)(**{s: c.value for s, c in ship.coefficients.items()}))
        X, Y = (mass.m + mass.m_x) * added[0], (mass.m + mass.m_y) * added[1] + mass.moment * added[2]
        forces[NETWORK] = at_all_rows(np.column_stack([X, Y, mass.I_z * added[2] + mass.moment * added[1]]))
    return forces

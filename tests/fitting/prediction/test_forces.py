"""The force that stands for a network is the ship's masses times its accelerations."""

from __future__ import annotations

import numpy as np

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from fitting.prediction.predict import NETWORK, forces_along, record_of
from mmg.components.rigid_body import accelerations, inertia
from mmg.motion.flow import Force
from mmg.rollout import Simulator
from tests.support.networks import random_network


def test_the_force_of_a_network_with_added_masses_that_couple_sway_and_yaw() -> None:
    ship = load_ship("mariner")
    hybrid = ship.with_network(random_network(ship))
    trial = simulate(ship, parse_maneuver("zigzag:20/20", ship, duration=60.0), dt=1.0)
    simulator, record = Simulator(hybrid, compiled=False), record_of(trial, ship.inputs)
    mass = inertia(ship.namespace, type(ship.namespace)(**{s: c.value for s, c in ship.coefficients.items()}))
    assert mass.y_r and mass.n_v
    total = sum(forces_along(simulator, trial).values())
    expected = simulator.rates(record.states.T, record.controls.T)[3:6]
    found = accelerations(*trial.states[:, 3:].T, Force(*total.T), mass)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert np.abs(forces_along(simulator, trial)[NETWORK]).min(axis=0).max() > 0

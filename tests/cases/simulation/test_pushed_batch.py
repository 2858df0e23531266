"""Many runs with accelerations of their own: without any they are those of the plain batch."""

from __future__ import annotations

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate_batch import simulate_batch, simulate_pushed
from mmg.rollout import Simulator

COUNT = 12


@pytest.mark.parametrize("name", ["zigzag:10/10", "zigzag:-20/20", "turning:35"])
def test_without_accelerations_runs_are_those_of_the_plain_batch(name: str) -> None:
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver(name, ship, speed=0.5)
    values = {"N_r": ship.coefficients["N_r"].value * np.linspace(0.8, 1.2, COUNT)}
    simulator = Simulator(ship)
    found = simulate_pushed(simulator, plan, values, 0.5, lambda k, states: np.zeros((3, COUNT)))
    plain = simulate_batch(simulator, plan, values, dt=0.5, held=True)
    assert len(set(found.last)) > 1 or name == "turning:35"  # zigzags end at times of their own
    for m in range(COUNT):
        rows = slice(0, int(found.last[m]) + 1)
        np.testing.assert_allclose(found.states[rows, :, m], plain.states[rows, :, m], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.inputs[rows, :, m][:-1], plain.inputs[rows, :, m][:-1], rtol=0, atol=1e-12)


def test_a_zigzag_that_has_been_read_is_not_pushed_any_more() -> None:
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver("zigzag:20/20", ship, speed=0.5)
    push = np.zeros((3, 2))
    push[2, 1] = 2e-3  # one of two is pushed, and ends at another time
    found = simulate_pushed(Simulator(ship), plan, {"N_r": np.full(2, ship.coefficients["N_r"].value)}, 0.5,
                            lambda k, states: push)  # fmt: skip
    first, second = found.last
    assert first != second
    early, last = (0, int(first)) if first < second else (1, int(second))
    assert (found.states[last + 1 :, :, early] == found.states[last + 1, :, early]).all()

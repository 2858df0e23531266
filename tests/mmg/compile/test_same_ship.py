"""What is made of a ship once, and logged columns by compiled code."""

from dataclasses import replace

import numpy as np
import pytest

from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from mmg.compile.same_ship import KEPT, once_per_ship
from mmg.model import columns
from mmg.rollout import Simulator
from mmg.ship import Ship

SHIP = load_ship("esso_osaka_3m")


def test_the_same_object_is_made_once_and_a_copy_anew() -> None:
    asked: list[Ship] = []

    @once_per_ship
    def made(ship: Ship) -> list[str]:
        asked.append(ship)
        return [ship.name]

    first = made(SHIP)
    assert made(SHIP) is first and len(asked) == 1
    heavier = replace(SHIP, particulars={**SHIP.particulars, "m": 1.1})
    assert made(heavier) is not first and len(asked) == 2
    for _ in range(KEPT):
        made(replace(SHIP))
    assert made(SHIP) is not first and len(asked) == 3 + KEPT


@pytest.mark.parametrize("by_point", [False, True])
def test_logged_columns_of_many_states_are_those_of_the_model_one_by_one(by_point: bool) -> None:
    ship = with_effects(SHIP, ["velocity_filter:tau=0.3", "gyro:share=0.02", "antenna_offset"])
    simulator, rng = Simulator(ship), np.random.default_rng(0)
    states = rng.normal(size=(7, len(simulator.model.states), 5))
    theta = ship.values
    if by_point:
        theta = theta[:, None] * rng.uniform(0.9, 1.1, (len(theta), 5))
    every = theta if by_point else np.tile(theta[:, None], (1, 5))
    expected = np.array([
        np.hstack([np.array(simulator.model.columns(z[:, k], every[:, k])) for k in range(5)]) for z in states
    ])  # fmt: skip
    assert np.abs(expected[:, 5] - states[:, 5]).max() > 1e-3  # the gyro's share is seen
    for found in (simulator.columns(states, theta), columns(simulator.model, states, theta)):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)

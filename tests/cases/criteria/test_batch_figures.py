"""Figures of many runs at once are those of each alone, and a push changes what it should."""

from __future__ import annotations

import numpy as np
import pytest

from cases.criteria.standard_runs import figures_of, figures_of_each
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate_batch import simulate_batch, simulate_pushed
from mmg.errors import Unsupported
from mmg.rollout import Simulator

SHIP = load_ship("esso_osaka_3m")
SIMULATOR = Simulator(SHIP)
SCATTERED = {SHIP.free[0]: SHIP.coefficients[SHIP.free[0]].value * np.array([1.0, 0.9, 1.1])}


def calm(k: int, states: np.ndarray) -> np.ndarray:
    """No push."""
    return np.zeros((3, states.shape[1]))


@pytest.mark.parametrize("text", ["turning:35", "zigzag:-10/10", "zigzag:20/20", "crash-stop"])
def test_figures_of_a_batch_are_those_of_each_run(text: str) -> None:
    plan = parse_maneuver(text, SHIP, speed=0.5)
    whole = simulate_batch(SIMULATOR, plan, SCATTERED, 0.5, held=True)
    pushed = simulate_pushed(SIMULATOR, plan, SCATTERED, 0.5, calm)
    assert len(pushed.t) <= len(whole.t)
    for m, last in enumerate(pushed.last):
        rows = slice(0, last + 1)
        np.testing.assert_allclose(pushed.states[rows, :, m], whole.states[rows, :, m], rtol=1e-9, atol=1e-12)
    for m, (alone, short) in enumerate(zip(figures_of_each(whole, plan), figures_of_each(pushed, plan), strict=True)):
        own = figures_of(whole.trial(m), plan)
        assert alone and all(own[name] == pytest.approx(value, rel=1e-9) for name, value in alone.items())
        read = [name for name in short if not name.startswith("overshoot") or int(name.split("_")[1]) <= 2]
        assert {"turning": 5, "zigzag": 2, "crash-stop": 4}[plan.kind] <= len(read)
        assert all(short[name] == pytest.approx(own[name], rel=1e-9) for name in read)


def test_a_constant_push_moves_a_ship_as_its_acceleration_says() -> None:
    plan = parse_maneuver("turning:20", SHIP, speed=0.5)
    push = np.array([[0.0, 1e-4], [0.0, 0.0], [0.0, 0.0]])
    runs = simulate_pushed(SIMULATOR, plan, {SHIP.free[0]: np.full(2, SHIP.coefficients[SHIP.free[0]].value)}, 0.1,
                           lambda k, states: push)  # fmt: skip
    gained = runs.states[:11, 3, 1] - runs.states[:11, 3, 0]  # before damping tells
    np.testing.assert_allclose(gained[1:], 1e-5 * np.arange(1, 11), rtol=0.05)


def test_a_diverging_run_has_no_figures_and_a_spiral_is_refused() -> None:
    plan = parse_maneuver("turning:35", SHIP, speed=0.5)
    one = {SHIP.free[0]: np.full(2, SHIP.coefficients[SHIP.free[0]].value)}

    def blown(k: int, states: np.ndarray) -> np.ndarray:
        return np.array([[0.0, np.nan if k == 20 else 0.0]] * 3)

    first, second = figures_of_each(simulate_pushed(SIMULATOR, plan, one, 0.5, blown), plan)
    assert "advance" in first and second == {}
    with pytest.raises(Unsupported):
        simulate_pushed(SIMULATOR, parse_maneuver("spiral:15/5", SHIP, speed=0.5), one, 0.5, calm)

"""Manoeuvres in batches: the motion of one ship simulated by herself, the end of each run, accuracy of long steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import SimulatedRuns, coefficient_array, simulate_batch, simulate_pushed
from cases.trial import Trial
from mmg.errors import Unsupported, UserError
from mmg.rollout import Simulator

ESSO = load_ship("esso_osaka_3m")
SIMULATORS = {name: Simulator(load_ship(name)) for name in ("esso_osaka_3m", "vectwin_3m")}
SIMULATORS["with memory"] = Simulator(ESSO.with_effect("rudder_lag", {"T": 0.5}))
KNOWN = ("turning:35", "turning:-20", "crash-stop", "random:3", "berthing", "straight", "acceleration")


def assert_same_motion(batch: SimulatedRuns, m: int, trial: Trial, tolerance: float = 1e-9) -> None:
    """Run m of the batch is the trial, which ends with its last row."""
    rows = batch.last[m] + 1
    assert len(trial) == rows
    np.testing.assert_allclose(batch.states[:rows, :, m], trial.states, atol=tolerance)
    for i, name in enumerate(("n", "delta" if "delta" in trial else "delta_port")):
        np.testing.assert_allclose(batch.inputs[: rows - 1, i, m], trial[name][:-1], atol=tolerance)


@pytest.mark.parametrize("name", SIMULATORS)
@pytest.mark.parametrize("text", [*KNOWN, "zigzag:-10/10"])
def test_held_inputs_give_the_motion_of_one_ship_by_herself(name: str, text: str) -> None:
    simulator = SIMULATORS[name]
    plan = parse_maneuver(text, simulator.ship, duration=None if text.startswith(("turning", "zigzag")) else 100)
    batch = simulate_batch(simulator, plan, dt=0.7)
    assert_same_motion(batch, 0, simulate(simulator.ship, plan, 0.7))


@pytest.mark.parametrize("text", ["turning:35", "zigzag:10/10", "random:3"])
def test_a_rudder_that_waits_does_so_in_every_simulation_alike(text: str) -> None:
    late = replace(ESSO, particulars={**ESSO.particulars, "rudder_delay": 0.33})
    alone, prompt = (simulate(ship, parse_maneuver(text, ship), 0.7) for ship in (late, ESSO))
    plan = parse_maneuver(text, late)
    assert_same_motion(simulate_batch(late, plan, dt=0.7), 0, alone)
    rows = min(len(alone), len(prompt))
    assert np.abs(alone["delta"][:rows] - prompt["delta"][:rows]).max() > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("text", ["turning:35", "zigzag:10/10", "crash-stop"])
def test_each_set_of_coefficients_is_a_ship_of_her_own(text: str) -> None:
    simulator = SIMULATORS["esso_osaka_3m"]
    rng, symbols = np.random.default_rng(0), ("N_r", "Y_v", "C_D", "X_0F")
    given = {s: ESSO.coefficients[s].value * (1 + 0.1 * rng.standard_normal(11)) for s in symbols}
    plan = parse_maneuver(text, ESSO)
    batch = simulate_batch(simulator, plan, given, 0.5)
    assert len(np.unique(batch.last)) > 1
    for m in (0, 7, 10):
        ship = ESSO.with_values({s: float(values[m]) for s, values in given.items()})
        assert_same_motion(batch, m, simulate(ship, plan, 0.5))


def test_samples_as_long_as_those_of_a_scatter_come_to_the_turning_of_short_ones() -> None:
    """Inputs held at their means over 0.38 s, which a rudder takes six of to 35 deg, against 0.038 s."""
    ship = load_ship("kvlcc2_l7")
    plan = parse_maneuver("turning:35", ship, speed=1.179, duration=300, rudder_rate=math.radians(15.82))
    theta = ship.values[:, None] * (1 + 0.05 * np.random.default_rng(0).standard_normal((len(ship.values), 20)))
    coarse, fine = (simulate_batch(ship, plan, theta, dt).states for dt in (0.38, 0.038))
    off = coarse - fine[::10][: len(coarse)]
    assert np.hypot(off[:, 0], off[:, 1]).max() < 1e-3 * ship.particulars["L"]


def test_ends_are_those_of_the_orders() -> None:
    simulator = SIMULATORS["esso_osaka_3m"]
    turn = simulate_batch(simulator, parse_maneuver("turning:35", ESSO), dt=0.5)
    k = turn.last[0]
    assert abs(turn.states[k - 1, 2, 0]) < 3 * math.pi <= abs(turn.states[k, 2, 0]) and k < len(turn.t) - 1
    stop = simulate_batch(simulator, parse_maneuver("crash-stop", ESSO), dt=0.5)
    k = stop.last[0]
    assert stop.states[k - 1, 3, 0] > 0 >= stop.states[k, 3, 0]
    straight = simulate_batch(simulator, parse_maneuver("straight", ESSO, duration=10), dt=0.5)
    assert straight.last[0] == 20 and len(straight.t) == 21


def test_coefficients_by_name_or_in_order() -> None:
    np.testing.assert_array_equal(coefficient_array(ESSO, None), ESSO.values)
    assert coefficient_array(ESSO, {}).shape == ESSO.values.shape
    one = coefficient_array(ESSO, {"N_r": -0.06})
    assert one.shape == ESSO.values.shape and one[ESSO.symbols.index("N_r")] == -0.06
    many = coefficient_array(ESSO, {"N_r": np.array([-0.06, -0.05]), "Y_v": -0.4})
    assert many.shape == (len(ESSO.values), 2)
    np.testing.assert_array_equal(many[ESSO.symbols.index("Y_v")], -0.4)
    with pytest.raises(KeyError, match="Z_w"):
        coefficient_array(ESSO, {"Z_w": 1.0})


def test_what_a_batch_cannot_do_is_said() -> None:
    with pytest.raises(Unsupported):
        simulate_batch(ESSO, parse_maneuver("spiral:15/5", ESSO))
    for dt in (0.0, -1.0, math.nan, 1e4):
        with pytest.raises(UserError, match="dt"):
            simulate_batch(ESSO, parse_maneuver("turning:35", ESSO), dt=dt)


def test_a_zigzag_that_has_been_read_is_not_pushed_any_more() -> None:
    plan, two = parse_maneuver("zigzag:20/20", ESSO, speed=0.5), {"N_r": np.full(2, ESSO.coefficients["N_r"].value)}
    push = np.zeros((3, 2))
    push[2, 1] = 2e-3  # one of two is pushed, and ends at another time
    found = simulate_pushed(SIMULATORS["esso_osaka_3m"], plan, two, 0.5, lambda k, states: push)
    first, second = found.last
    assert first != second
    early, last = (0, int(first)) if first < second else (1, int(second))
    assert (found.states[last + 1 :, :, early] == found.states[last + 1, :, early]).all()

"""What no model explains lasts for a ship, passes in a trial, fades at rest, and never keeps a ship from stopping."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases.criteria.scatter import draw_coefficients
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate_batch import simulate_batch
from fitting.prediction.bands import Bands, Process, process_dict
from fitting.prediction.figure_intervals import drawn_figures
from fitting.prediction.novelty import held_dict, held_motion
from fitting.prediction.predict import record_of
from fitting.prediction.unexplained import (
    RESISTANCE,
    UNTRIED,
    accelerations,
    drawn_resistance,
    fading,
    mean_deceleration,
    slow_speed,
)
from mmg.rollout import Simulator
from tests.fitting.prediction.test_novelty import run

SPEED, STEP, COUNT = 0.4, 0.5, 400


def bands(size: float) -> Bands:
    """Of a ship tried in zigzags at about 0.4 m/s, with a process of that ``size`` [m/s^2]."""
    ship = load_ship("esso_osaka_3m")
    records = [record_of(run(name, "esso_osaka_3m"), ship.inputs) for name in ("zigzag:10/10", "zigzag:20/20")]
    held = held_motion(records, ship.inputs, ship.particulars["L"])
    sizes, one = np.zeros((3, 3)), np.ones((1, 6))
    sizes[:, 0] = size, size, size / 3
    process = Process(np.full(3, 2.0), np.full(3, 20.0), sizes, np.zeros(6), one, one, np.array([30.0]))
    return Bands(process, np.zeros((len(ship.symbols), 0)), held)


def stopped(kind: str = "crash-stop") -> tuple[Any, Any, Any]:
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver(kind, ship, speed=SPEED)
    return ship, plan, simulate_batch(Simulator(ship), plan, dt=STEP, held=True)


def test_the_lasting_part_of_a_stop_is_bounded_by_its_deceleration() -> None:
    ship, plan, nominal = stopped()
    push = accelerations(bands(0.05), ship, plan, nominal, COUNT, STEP, 1)
    k = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED))
    ahead = np.tile(nominal.states[0, :, 0][:, None], (1, 2 * COUNT))  # the speed of approach: nothing fades
    own = push(k, ahead)[0, :COUNT]
    bound = UNTRIED * mean_deceleration(nominal, plan.parameters["order_time"])
    assert own.std() == pytest.approx(bound, rel=0.1)


def test_the_lasting_part_fades_with_the_square_of_the_speed() -> None:
    known = bands(0.01)
    assert known.held is not None
    slow = slow_speed(known.held)
    assert 0.2 < slow < SPEED + 0.1
    states = np.zeros((6, 4))
    states[3] = 0.0, 0.5 * slow, -slow, 2 * slow
    assert fading(states, slow) == pytest.approx([0.0, 0.25, 1.0, 1.0])
    assert fading(states, 0.0) == pytest.approx(np.ones(4))
    ship, plan, nominal = stopped()
    push = accelerations(known, ship, plan, nominal, COUNT, STEP, 1)
    k = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED))
    at_rest = push(k, np.zeros((6, 2 * COUNT)))
    assert not at_rest[:, :COUNT].any()
    assert (at_rest[:, COUNT:].std(axis=1) > 0).all()  # gusts do not ask for speed


def test_a_stop_never_tried_ends_however_little_the_model_explains() -> None:
    """The interval of a stop that no trial held is wide, and has an upper end."""
    ship, plan, _ = stopped()
    few = ship.fixing([s for s in ship.free if s != "t_P"])
    reach = {}
    for size in (1e-4, 0.003, 0.02):
        b = bands(size)
        assert b.held is not None
        content = {"bands": process_dict(b.process) | {"held": held_dict(b.held)}}
        found, _ = drawn_figures(Simulator(few), plan, draw_coefficients(few, 200, 3), content, 3)
        reach[size] = found.ship["track_reach"]
        assert np.isfinite(reach[size]).mean() > 0.97
    low, high = np.quantile(reach[0.003], (0.05, 0.95))
    assert np.ptp(np.quantile(reach[1e-4], (0.05, 0.95))) < high - low < 3 * np.median(reach[0.003])


def test_the_resistance_of_a_stop_is_drawn_where_it_is_an_estimate() -> None:
    full = load_ship("kvlcc2_full")
    plan = parse_maneuver("crash-stop", full)
    drawn = drawn_resistance(full, plan, {}, 2000, 0)
    assert set(drawn) == set(plan.factors)
    (symbol,) = plan.factors
    shares = np.log(drawn[symbol] / full.coefficients[symbol].value)
    assert shares.std() == pytest.approx(RESISTANCE, rel=0.1) and abs(shares.mean()) < 0.01
    assert drawn_resistance(full, parse_maneuver("turning:35", full), {}, 10, 0) == {}

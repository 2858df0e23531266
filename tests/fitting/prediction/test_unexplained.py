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
from fitting.prediction.envelope import held_dict, held_motion
from fitting.prediction.figure_intervals import (
    RESISTANCE,
    UNTRIED,
    accelerations,
    drawn_figures,
    drawn_resistance,
    fading,
    greatest_accelerations,
    slow_speed,
)
from fitting.prediction.predict import record_of
from mmg.rollout import Simulator
from tests.fitting.prediction.test_novelty import run

SPEED, STEP, COUNT = 0.4, 0.5, 400


def bands(size: float) -> Any:
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


def test_a_stop_never_tried_has_a_share_of_its_deceleration_as_error() -> None:
    """Each ship's own: what she loses in a step without it, also while it is added to that."""
    ship, plan, nominal = stopped()
    k = int(np.argmax(nominal.states[:, 3, 0] < 0.7 * SPEED))
    here = np.tile(nominal.states[k, :, 0][:, None], (1, 2 * COUNT))
    for known, copies in ((bands(1e-6), 2), (None, 1)):  # of a ship without trials too
        push = accelerations(known, ship, plan, nominal, COUNT, STEP, 1)
        states, loss = here[:, : copies * COUNT].copy(), 0.004
        for step in range(3):
            value = push(k + step, states)
            expected = UNTRIED * loss if step else 0.0
            assert value[0, :COUNT].std() == pytest.approx(expected, rel=0.1, abs=1e-6)
            states[3] += STEP * (value[0] - loss)


def test_no_lasting_part_exceeds_a_share_of_what_turns_the_ship() -> None:
    """However large the errors of the trials grow outside them."""
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver("turning:35", ship, speed=1.2)
    nominal = simulate_batch(Simulator(ship), plan, dt=STEP, held=True)
    most = greatest_accelerations(nominal)
    t, u, r = nominal.t, nominal.states[:, 3, 0], nominal.states[:, 5, 0]
    k = int(np.argmax(np.abs(u * r)))
    assert most[0] == most[1] >= 0.9 * abs(u[k] * r[k]) and 0 < most[2] < 1.0
    assert most[2] == pytest.approx(np.abs(np.diff(r) / np.diff(t)).max(), rel=0.2)
    states = np.tile(nominal.states[k, :, 0][:, None], (1, 2 * COUNT))
    stds = [accelerations(bands(size), ship, plan, nominal, COUNT, STEP, 1)(k, states)[:, :COUNT].std(axis=1)
            for size in (1e-5, 0.1, 10.0)]  # fmt: skip
    assert stds[1] == pytest.approx(UNTRIED * most, rel=0.1) and stds[2] == pytest.approx(stds[1])
    assert (stds[0] < 0.05 * stds[1]).all()


def test_the_lasting_part_fades_with_the_square_of_the_speed() -> None:
    known = bands(0.01)
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
    assert not at_rest[1:, :COUNT].any()
    assert (at_rest[:, COUNT:].std(axis=1) > 0).all()  # gusts do not ask for speed


@pytest.mark.slow
def test_a_stop_never_tried_ends_however_little_the_model_explains() -> None:
    """The interval of a stop that no trial held is wide, and has an upper end."""
    ship, plan, _ = stopped()
    few = ship.fixing([s for s in ship.free if s != "t_P"])
    reach = {}
    for size in (1e-4, 0.02):
        b = bands(size)
        content = {"bands": process_dict(b.process) | {"held": held_dict(b.held)}}
        found, _ = drawn_figures(Simulator(few), plan, draw_coefficients(few, 120, 3), content, 3)
        reach[size] = found.ship["track_reach"]
        assert np.isfinite(reach[size]).mean() > 0.97
    for values in reach.values():
        low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95))
        assert low < 0.8 * middle < 1.4 * middle < high < 4 * middle


def test_the_resistance_of_a_stop_is_drawn_where_it_is_an_estimate() -> None:
    full = load_ship("kvlcc2_full")
    plan = parse_maneuver("crash-stop", full)
    drawn = drawn_resistance(full, plan, {}, 2000, 0)
    assert set(drawn) == set(plan.factors)
    (symbol,) = plan.factors
    shares = np.log(drawn[symbol] / full.coefficients[symbol].value)
    assert shares.std() == pytest.approx(RESISTANCE, rel=0.1) and abs(shares.mean()) < 0.01
    assert drawn_resistance(full, parse_maneuver("turning:35", full), {}, 10, 0) == {}

"""Engines that are stopped and reversed: torques, delays, windmilling, and the stop of a laden tanker."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cases.criteria.imo import imo_figures
from cases.criteria.standard_runs import figures_of, figures_of_each, simulated_run
from cases.maneuvers.definitions import parse_maneuver, stopping_notices
from cases.maneuvers.self_propulsion import USUAL, ZERO_THRUST, Engine, approach, engine_of, engine_words
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import simulate_batch, simulate_pushed
from mmg.components.propeller.four_quadrant import A_Q, B_Q
from mmg.errors import UserError
from mmg.rollout import Simulator
from mmg.ship import Ship


def kvlcc2(**particulars: float) -> Ship:
    ship = load_ship("kvlcc2_full")
    return replace(ship, particulars={**ship.particulars, **particulars})


def engine(**particulars: float) -> Engine:
    ship = kvlcc2(**particulars)
    found = engine_of(ship, *approach(ship, None, None))
    assert found is not None
    return found


def test_the_torque_is_that_of_the_propeller_law_at_the_approach_and_of_the_series_elsewhere() -> None:
    e = engine()
    share = e.n / e.n_mcr
    assert share == pytest.approx(0.965) and share**3 == pytest.approx(0.9, abs=2e-3)
    for times in (1.0, 0.5):
        found = e.torque(np.array([times * share]), np.array([times * e.speed]))
        assert found == pytest.approx([(times * share) ** 2], rel=1e-6)
    beta = math.atan(e.advance)

    def series(angle: float) -> float:
        return sum(
            a * math.cos(k * angle) + b * math.sin(k * angle) for k, (a, b) in enumerate(zip(A_Q, B_Q, strict=True))
        )

    bollard = e.torque(np.array([-0.5]), np.array([0.0]))[0]
    known = 0.25 * series(math.pi) / (series(beta) * (1 + e.advance**2))
    assert bollard == pytest.approx(known, rel=1e-3) and bollard < 0
    assert pytest.approx(1.025, abs=2e-3) == ZERO_THRUST  # B4-70 with P/D = 1


def test_the_fuel_is_cut_after_the_delay_and_the_propeller_turns_on_in_the_wake() -> None:
    e = replace(engine(), restart=0.05)
    shaft, u = e.shaft(), np.array([e.speed])
    held, n = shaft.moved(e.n, u, 60.0)
    assert held is shaft and n == pytest.approx([e.n])
    shaft, n = shaft.moved(-e.n, u, 10.0)
    assert n == pytest.approx([e.n], rel=1e-9)
    for _ in range(60):
        shaft, _ = shaft.moved(-e.n, u, 1.0)
    assert (shaft.ran < 0).all() and 0.2 < shaft.share[0] < 0.6
    balance = e.torque(shaft.share, u)
    assert balance == pytest.approx([-0.05], abs=2e-3)  # it drives the shaft against its friction
    slow = shaft
    for _ in range(60):
        slow, _ = slow.moved(-e.n, 0.05 * u, 1.0)
    assert slow.share[0] < 0 < slow.ran[0]


def test_astern_the_engine_reaches_its_limits_of_revolutions_and_torque() -> None:
    e = engine()
    weak = replace(e, astern_torque=0.1)
    for one, share, least, most in ((e, 0.0, -0.7001, -0.699), (e, 0.9, -0.7, -0.2), (weak, 0.0, -0.7, -0.1)):
        shaft = one.shaft()
        for _ in range(400):
            shaft, mean = shaft.moved(-e.n, np.array([share * e.speed if shaft.ran.max() >= 0 else 0.0]), 1.0)
        assert least <= shaft.share[0] <= most and mean[0] == pytest.approx(shaft.n[0], rel=1e-3)
    assert -weak.torque(shaft.share, np.array([0.0]))[0] == pytest.approx(0.1 - 0.05, abs=0.02)


@pytest.mark.slow
def test_a_laden_tanker_stops_in_ten_lengths_or_more_and_alike_in_every_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ship = load_ship("kvlcc2_full")
    run = simulated_run(ship, "crash-stop", 7.9739)
    assert 10 < run.figures["track_reach"] / 320 < 15
    monkeypatch.setattr("cases.criteria.imo.STANDARD", ("crash-stop",))
    row = next(r for r in imo_figures(ship).rows if r.figure == "track_reach")
    assert row.value is not None and row.value == pytest.approx(run.figures["track_reach"] / 320)
    plan = parse_maneuver("crash-stop", ship)
    fine = figures_of(simulate(ship, plan, 1.0), plan)
    assert fine["track_reach"] == pytest.approx(run.figures["track_reach"], rel=2e-3)
    (batch,) = figures_of_each(simulate_batch(ship, plan, dt=1.0), plan)
    pushed = simulate_pushed(
        Simulator(ship), plan, {"R_0": ship.values[[ship.symbols.index("R_0")]]}, 1.0, lambda k, states: np.zeros(())
    )
    for figure, value in fine.items():
        if figure != "lateral_deviation":
            assert batch[figure] == pytest.approx(value, rel=1e-3)
            assert figures_of_each(pushed, plan)[0][figure] == pytest.approx(value, rel=1e-3)
    words = [m.code for m in simulate(ship, plan, 5.0).notices]
    assert words == ["assumed_engine", "stopping_resistance"] == [m.code for m in stopping_notices(plan)]


@pytest.mark.slow
def test_a_slower_engine_a_weaker_one_and_a_lighter_resistance_need_more_way() -> None:
    def reach(**particulars: float) -> float:
        ship = kvlcc2(**particulars)
        plan = parse_maneuver("crash-stop", ship, duration=4000.0)
        return figures_of_each(simulate_batch(ship, plan, dt=4.0), plan)[0]["track_reach"] / 320

    usual = reach()
    assert reach(engine_delay=60.0) - usual == pytest.approx(50 * 7.97 / 320, rel=0.2)
    assert reach(astern_torque=0.3) > usual + 1 and reach(astern_revolutions=0.4) > usual + 1
    assert reach(restart=0.15) > usual + 1
    assert reach(stopping_resistance=1.0) < usual - 3


def test_coasting_ends_at_its_share_of_the_speed_by_the_resistance_alone() -> None:
    ship = load_ship("kvlcc2_full")
    plan = parse_maneuver("coasting:0.5", ship)
    trial = simulate(ship, plan, 5.0)
    assert trial["u"][-1] == pytest.approx(0.5 * plan.speed, rel=0.01)
    (batch,) = figures_of_each(simulate_batch(ship, plan, dt=5.0), plan)
    found = figures_of(trial, plan)
    assert batch["track_reach"] == pytest.approx(found["track_reach"], rel=1e-3)
    # m u' = -R u^2 gives ln 2 m / R; the propeller that turns in the wake brakes besides
    p, c = ship.particulars, {s: one.value for s, one in plan.ship_of(ship).coefficients.items()}
    mass = p["m"] + c["m_x"] * 0.5 * p["rho"] * p["L"] ** 2 * p["d"]
    free = math.log(2) * mass / (0.5 * p["rho"] * p["L"] * p["d"] * c["R_0"])
    assert 0.7 * free < found["track_reach"] < free
    assert 0 <= trial["n"][-1] < 0.6 * plan.n


def test_what_is_assumed_is_drawn_and_what_is_given_is_not() -> None:
    e = engine(restart=0.25, engine_delay=5.0)
    drawn = e.drawn(2000, 3)
    assert (np.asarray(drawn.restart) == 0.25).all() and (np.asarray(drawn.engine_delay) == 5.0).all()
    assert np.std(drawn.astern_torque) == pytest.approx(USUAL["astern_torque"][1], rel=0.1)
    assert "restart" not in engine_words(e) and "astern_torque" in engine_words(e)
    assert np.asarray(drawn.repeated(2).engine_rise).shape == (4000,)


def test_models_have_a_motor_and_nonsense_is_one_line() -> None:
    assert parse_maneuver("crash-stop", load_ship("esso_osaka_3m")).engine is None
    assert parse_maneuver("turning:35", load_ship("kvlcc2_full")).engine is None
    for wrong in ({"restart": 3.0}, {"astern_revolutions": 0.0}, {"n_MCR": 100.0}, {"stopping_resistance": -1.0}):
        with pytest.raises(UserError, match=next(iter(wrong))):
            parse_maneuver("crash-stop", kvlcc2(**wrong))
    for text in ("coasting:0", "coasting:2", "coasting:x"):
        with pytest.raises(UserError, match="coasting"):
            parse_maneuver(text, load_ship("kvlcc2_full"))

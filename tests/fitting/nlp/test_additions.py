"""What a fit holds beside the coefficients: effects, constants of single runs, points of captive tests. They are
recovered, and bad input is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.effects import freeing_effects, varies, varying_effects, with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from fitting.calibration import Calibration, estimate_coefficients
from fitting.identifiability.data_checks import against_captive
from fitting.nlp.captive import Captive, CaptiveForces, estimate_from_captive, read_captive
from fitting.nlp.fisher_information import information
from fitting.nlp.prior import RunConstants
from fitting.nlp.problem import Prior
from fitting.settings import Settings
from fitting.solvers.solve import solve
from fitting.uncertainty.sandwich import changes_without_each
from mmg.effects import EFFECTS
from mmg.errors import BadValue, UserError
from mmg.model import assemble
from mmg.ship import Ship
from tests.support.synthetic_runs import (
    CURRENTS,
    ESSO,
    SHARED,
    points,
    runs,
    shifted_ship,
    trials_in_currents,
    trials_in_wind,
    with_constants,
    write_points,
)

pytestmark = pytest.mark.usefixtures("blank_figures")
SWITCHED_ON = {
    "bank": "bank:suction=0.3,moment=0.05,distance=6,decay=3",
    "shallow_water": "shallow_water:d_h=0.5",
    "wind_force": "wind_force:X=1.5,Y=0.7,N=1.3",
    "gyro": "gyro:share=-0.02,T=0.6",
    "current": "current:x=0.03,y=-0.02,x_rate=-0.0002",
}
FREED = {"bank": "bank:distance=6,decay=3", "current": "current:x_rate", "gyro": "gyro:T"}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_fit_with_the_effect_freed_recovers_its_parameters(name: str) -> None:
    """Within 4 standard errors, or 4 % of a typical size where the grid of 1 s and the all-pass delay set the limit."""
    truth = with_effects(ESSO, [SWITCHED_ON.get(name, name)])
    start = freeing_effects(ESSO.fixing(ESSO.symbols), [FREED.get(name, name)])
    found = estimate_coefficients(start, trials_in_wind(truth), Settings(compiled=False))
    assert found.converged
    sizes = {f"{name}.{p.symbol}": p.typical for p in EFFECTS[name].parameters(ESSO.namespace, dict(ESSO.components))}
    for symbol in start.free:
        true, c = truth.coefficients[symbol].value, found.ship.coefficients[symbol]
        assert abs(c.value - true) < max(4 * c.std, 0.04 * sizes[symbol]), (symbol, true, c.value, c.std)
        assert c.std < 0.3 * sizes[symbol], f"{symbol} is not determined by these runs"


# Constants of single runs
def start() -> Ship:
    return ESSO.fixing([s for s in ESSO.symbols if s not in SHARED])


@lru_cache(maxsize=2)
def fitted(per_run: bool) -> Calibration:
    ship, constants = varying_effects(start(), ["current"] if per_run else [])
    return estimate_coefficients(ship, trials_in_currents(), Settings(compiled=False), per_run=constants)


def test_captive_tests_know_no_constants_of_runs() -> None:
    p = with_constants(7, True)
    still = shifted_ship()
    common = p.prior.common
    values = np.array([still.coefficients[s].value if s in SHARED else 0.0 for s in common.symbols])
    scaled = (values - common.mean) / common.std
    assert p.captive is not None
    assert p.captive.cost(p.captive_coefficients(np.r_[scaled, np.full(6, 2.0)])) == pytest.approx(0, abs=1e-12)


def test_information_and_its_shared_part_are_those_of_the_whole_program() -> None:
    """Inverse by inverse; the scores are the gradient of the profiled cost: zero with the prior's at the optimum."""
    p = with_constants(7)
    s = solve(p, p.start())
    assert s.converged
    found = information(p, s.x)
    np.testing.assert_allclose(found.score.sum(axis=0) + found.prior_score, 0, atol=1e-3)
    for w, run in enumerate(found.run):
        others = (found.owner >= 0) & (found.owner != run)
        assert not found.fisher[w][others].any() and found.fisher[w][found.owner == run].any()
    shared, n = found.shared(), p.prior.shared
    np.testing.assert_allclose(np.linalg.inv(shared.hessian), np.linalg.inv(found.hessian)[:n, :n], rtol=1e-8)
    moved = found.p[:n] + changes_without_each(found.by_run())[:, :n]
    np.testing.assert_allclose(shared.p + changes_without_each(shared), moved, rtol=1e-2, atol=1e-4)


@pytest.mark.slow
def test_each_run_gets_its_current_and_the_shared_coefficients_do_not_bend() -> None:
    own, without, truth = fitted(True), fitted(False), shifted_ship()
    assert own.converged and own.constants is not None
    rows = own.constants.rows()
    for name, true in zip(("zigzag", "turning", "random"), CURRENTS.values(), strict=True):
        for symbol, value in zip(("current.x", "current.y"), true, strict=True):
            row = rows[name][symbol]
            assert abs(row["value"] - value) < max(3 * row["std"], 2e-4), (name, symbol, row)
            assert row["std"] < 0.004 and row["unit"] == "m/s" and row["prior_std"] == 0.02

    def off(c: Calibration) -> np.ndarray:
        shift = [c.ship.coefficients[s].value - truth.coefficients[s].value for s in SHARED]
        return np.abs(shift) / [abs(truth.coefficients[s].value) for s in SHARED]

    assert off(own).max() < 0.05 and off(own).mean() < 0.3 * off(without).mean()
    assert own.ship.effects == () and set(own.ship.coefficients) == set(ESSO.coefficients)
    n = len(SHARED)
    assert own.prior.symbols == own.ship.free and own.covariance.shape == (n, n)
    assert len(own.iterate["p"]) == n + 6 and len(own.p) == n
    moves, owner = own.spread.moves, own.information.owner
    assert owner is not None and moves[:, owner < 0].any()
    assert (moves[np.arange(3)[:, None] == owner] == 0).all()  # a run left out says nothing of its own constants


def test_equal_names_of_runs_are_told_apart() -> None:
    ship, constants = varying_effects(start(), ["current:x"])
    prior = Prior.of(ship, constants, ("a", "a"))
    made = RunConstants.of(ship, prior, np.zeros(len(prior.mean)), np.eye(len(prior.mean)), ("a", "a"))
    assert made is not None and made.runs == ("a", "a (2)") and made.symbols == ("current.x",)


def test_which_parameters_become_constants() -> None:
    def of(text: str) -> tuple[Ship, tuple[str, ...]]:
        return varying_effects(start(), [text])

    assert of("current")[1] == ("current.x", "current.y")
    assert of("current:x_rate")[1] == ("current.x_rate",)
    ship, constants = of("current:x=0.05,y_rate=0.001")
    assert constants == ("current.x", "current.y") and ship.free == start().free
    at = {s: ship.coefficients[s] for s in ("current.x", "current.y_rate")}
    assert at["current.x"].value == 0.05 and at["current.x"].std == 0.02 and at["current.y_rate"].value == 0.001
    vary = {e for e in EFFECTS if varies(e)}
    assert {"current", "rudder_offset", "wind_sensor_bias", "heading_bias", "draft"} <= vary
    assert not vary & {"rudder_lag", "velocity_filter", "rudder_stall"}
    with pytest.raises(BadValue):  # she has no wind
        varying_effects(load_ship("kvlcc2_l7"), ["wind_sensor_bias"])


# Points of captive tests
HULL = ("X_0F", "Y_v", "Y_r", "N_v", "N_r", "C_D", "X_vr")


def prepared(ship: Ship, tank: Captive) -> tuple[CaptiveForces, np.ndarray, Prior]:
    free = np.array([ship.symbols.index(s) for s in ship.free])
    return CaptiveForces(assemble(ship), free, tank, compiled=False), free, Prior.of(ship)


def test_a_thruster_without_a_column_is_at_rest_and_twin_rudders_follow_one() -> None:
    ship, n, delta = load_ship("vectwin_3m"), np.full(2, 9.0), np.array([0.2, -0.2])
    tank = Captive("tank", np.full((3, 2), 0.1), {"n": n, "delta": delta}, np.zeros((3, 2)), np.ones((3, 2)))
    twins = {"n": n, "delta_port": delta, "delta_starboard": delta}
    bare, still, pushed = (
        CaptiveForces(assemble(ship), np.arange(2), replace(tank, actuators=a), compiled=False).residuals(ship.values)
        for a in (tank.actuators, {**twins, "n_bow": 0 * n}, {**twins, "n_bow": n})
    )
    np.testing.assert_array_equal(bare, still)
    assert (pushed[1:] > still[1:]).all()  # to starboard


def test_captive_points_determine_the_hull_but_never_the_masses() -> None:
    truth = hidden_ship()
    forces, free, prior = prepared(ESSO, points(truth, noise=1.0))
    found, covariance = estimate_from_captive(forces, ESSO.values, free, prior.mean, prior.std)
    spread = dict(zip(prior.symbols, np.sqrt(np.diag(covariance)), strict=True))
    for symbol in ("m_x", "m_y", "I_J_z"):
        assert spread[symbol] == pytest.approx(1.0, abs=1e-9), "a steady force says nothing about a mass"
        assert found[prior.symbols.index(symbol)] == pytest.approx(0.0, abs=1e-9)
    for symbol in ("Y_v", "N_v", "N_r"):
        i = prior.symbols.index(symbol)
        true = (truth.coefficients[symbol].value - prior.mean[i]) / prior.std[i]
        assert spread[symbol] < 0.5
        assert abs(found[i] - true) < 4 * spread[symbol] + 1e-3


@pytest.mark.slow
def test_a_joint_fit_uses_both_and_is_surer() -> None:
    truth, trials = hidden_ship(), runs()[0][:2]
    ship = truth.fixing([s for s in truth.symbols if s not in HULL]).with_values(
        {s: ESSO.coefficients[s].value for s in HULL}
    )
    tank = points(truth, noise=1.0)
    free_running, joint = (estimate_coefficients(ship, trials, Settings(passes=2), captive=c) for c in (None, tank))
    assert joint.converged
    i = joint.prior.symbols.index("N_v")
    true = (truth.coefficients["N_v"].value - joint.prior.mean[i]) / joint.prior.std[i]
    assert joint.covariance[i, i] < 0.5 * free_running.covariance[i, i]
    assert abs(joint.p[i] - true) < 4 * np.sqrt(joint.covariance[i, i])


@pytest.mark.slow
def test_captive_points_at_odds_with_the_prior_are_said() -> None:
    tank = points(ESSO)
    forces, free, prior = prepared(ESSO, tank)
    assert against_captive(forces, ESSO.values, free, prior) == []
    tank.forces[1] *= -4
    forces, free, prior = prepared(ESSO, tank)
    assert any("Y_v" in w for w in against_captive(forces, ESSO.values, free, prior))


UNITS = "u [m/s],v [m/s],r [rad/s],n [rps],delta [deg],X [kN],Y [kN],N [kN m]"


def test_a_table_is_read_with_its_units(tmp_path: Path) -> None:
    tank = points(ESSO)
    read = read_captive(write_points(tmp_path / "tank.csv", UNITS, tank, 1e-3), (1.0, 2.0, 3.0))
    np.testing.assert_allclose(read.forces, tank.forces, rtol=1e-12)
    np.testing.assert_allclose(read.actuators["delta"], tank.actuators["delta"])
    np.testing.assert_array_equal(read.sigma[:, 0], [1.0, 2.0, 3.0])
    rms = np.sqrt((tank.forces**2).mean(axis=1))
    np.testing.assert_allclose(read_captive(tmp_path / "tank.csv").sigma[:, 0], 0.03 * rms)
    pitched = UNITS.replace("n [rps]", "pitch [rad]").replace("r [rad/s]", "r [rad/s],n [rps]")
    rows = np.insert(np.loadtxt(tmp_path / "tank.csv", delimiter=",", skiprows=1), 3, 2.0, axis=1)
    np.savetxt(tmp_path / "pitched.csv", rows, delimiter=",", header=pitched, comments="")
    actuators = read_captive(tmp_path / "pitched.csv").actuators
    assert set(actuators) == {"n", "pitch", "delta"} and (actuators["n"] == 2.0).all()


@pytest.mark.parametrize(
    ("column", "wrong", "words"),
    [("N [kN m]", "M [N m]", "column N"), ("X [kN]", "X [lbf]", "X .*lbf"), ("u [m/s]", "u [yd/s]", "'yd/s'")],
)
def test_bad_tables_are_refused(tmp_path: Path, column: str, wrong: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_captive(write_points(tmp_path / "tank.csv", UNITS.replace(column, wrong), points(ESSO, count=4)))

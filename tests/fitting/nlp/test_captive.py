"""Captive-test points in a calibration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from fitting.calibration import estimate_coefficients
from fitting.identifiability.data_checks import against_captive
from fitting.nlp.captive import Captive, CaptiveForces, estimate_from_captive, read_captive
from fitting.nlp.problem import Prior
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.model import assemble
from mmg.ship import Ship
from tests.fitting.nlp.test_shooting import somewhere
from tests.support.synthetic_runs import assert_exact_derivatives, problem, runs

ESSO = load_ship("esso_osaka_3m")
HULL = ("X_0F", "Y_v", "Y_r", "N_v", "N_r", "C_D", "X_vr")


def points(ship: Ship, noise: float = 0.0, seed: int = 0, count: int = 120) -> Captive:
    """A campaign of oblique tows, turns, revolutions and rudder angles of a ship."""
    rng = np.random.default_rng(seed)
    motion = np.array([rng.uniform(0.2, 0.6, count), rng.uniform(-0.15, 0.15, count), rng.uniform(-0.08, 0.08, count)])
    actuators = {"n": rng.uniform(0, 12, count), "delta": rng.uniform(-0.6, 0.6, count)}
    blank = Captive("tank", motion, actuators, np.zeros((3, count)), np.ones((3, count)))
    F = CaptiveForces(assemble(ship), np.arange(2), blank, compiled=False).residuals(ship.values)
    sigma = np.repeat(0.02 * np.sqrt((F**2).mean(axis=1))[:, None], count, axis=1)
    return Captive("tank", motion, actuators, F + noise * sigma * rng.normal(size=F.shape), sigma)


def prepared(ship: Ship, tank: Captive) -> tuple[CaptiveForces, np.ndarray, Prior]:
    free = np.array([ship.symbols.index(s) for s in ship.free])
    return CaptiveForces(assemble(ship), free, tank, compiled=False), free, Prior.of(ship)


def test_derivatives_agree_with_finite_differences() -> None:
    forces, free, prior = prepared(ESSO, points(hidden_ship()))
    theta, rng = ESSO.values, np.random.default_rng(0)
    d = np.zeros(len(theta))
    d[free] = rng.normal(size=len(free)) * prior.std
    e = 1e-5
    slope = (forces.cost(theta + e * d) - forces.cost(theta - e * d)) / (2 * e)
    assert forces.gradient(theta) @ d[free] == pytest.approx(slope, rel=1e-6)
    bent = (forces.gradient(theta + e * d) - forces.gradient(theta - e * d)) / (2 * e)
    H = forces.hessian(theta)
    np.testing.assert_allclose(H @ d[free], bent, atol=1e-6 * np.abs(bent).max())
    np.testing.assert_allclose(H, H.T)


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


def test_the_problem_with_captive_points_has_exact_derivatives() -> None:
    p = problem(5)
    p = p.with_changes(captive=prepared(ESSO, points(hidden_ship()))[0])
    assert_exact_derivatives(p, somewhere(p))


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


def test_hull_derivatives_are_recovered_and_agree_with_scipy() -> None:
    truth = hidden_ship()
    ship = truth.fixing([s for s in truth.symbols if s not in HULL]).with_values(
        {s: ESSO.coefficients[s].value for s in HULL}
    )
    forces, free, prior = prepared(ship, points(truth))
    found, _ = estimate_from_captive(forces, ship.values, free, prior.mean, prior.std, ridge=1e-6)
    true = [truth.coefficients[s].value for s in prior.symbols]
    np.testing.assert_allclose(prior.mean + prior.std * found, true, atol=1e-5 * prior.std.max(), rtol=1e-4)

    def residuals(p: np.ndarray) -> np.ndarray:
        theta = ship.values
        theta[free] = prior.mean + prior.std * p
        return np.concatenate([(np.sqrt(forces.weight) * forces.residuals(theta)).ravel(), p])

    ours, _ = estimate_from_captive(forces, ship.values, free, prior.mean, prior.std)
    theirs = least_squares(residuals, np.zeros(len(free)), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(ours, theirs.x, atol=1e-5)


@pytest.mark.slow
def test_a_joint_fit_uses_both_and_is_surer() -> None:
    truth = hidden_ship()
    trials = runs()[0][:2]
    tank = points(truth, noise=1.0)
    free_running, joint = (estimate_coefficients(ESSO, trials, Settings(passes=2), captive=c) for c in (None, tank))
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


def write(path: Path, header: str, tank: Captive, scale: float = 1.0) -> Path:
    rows = np.vstack([tank.motion, tank.actuators["n"], np.degrees(tank.actuators["delta"]), tank.forces * scale])
    np.savetxt(path, rows.T, "%.17g", ",", header=header, comments="")
    return path


def test_a_table_is_read_with_its_units(tmp_path: Path) -> None:
    tank = points(ESSO)
    units = "u [m/s],v [m/s],r [rad/s],n [rps],delta [deg],X [kN],Y [kN],N [kN m]"
    read = read_captive(write(tmp_path / "tank.csv", units, tank, 1e-3), (1.0, 2.0, 3.0))
    np.testing.assert_allclose(read.forces, tank.forces, rtol=1e-12)
    np.testing.assert_allclose(read.actuators["delta"], tank.actuators["delta"])
    np.testing.assert_array_equal(read.sigma[:, 0], [1.0, 2.0, 3.0])
    rms = np.sqrt((tank.forces**2).mean(axis=1))
    np.testing.assert_allclose(read_captive(tmp_path / "tank.csv").sigma[:, 0], 0.03 * rms)
    pitched = units.replace("n [rps]", "pitch [rad]").replace("r [rad/s]", "r [rad/s],n [rps]")
    rows = np.insert(np.loadtxt(tmp_path / "tank.csv", delimiter=",", skiprows=1), 3, 2.0, axis=1)
    np.savetxt(tmp_path / "pitched.csv", rows, delimiter=",", header=pitched, comments="")
    actuators = read_captive(tmp_path / "pitched.csv").actuators
    assert set(actuators) == {"n", "pitch", "delta"} and (actuators["n"] == 2.0).all()


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("u [m/s],v [m/s],r [rad/s],n [rps],delta [deg],X [N],Y [N],M [N m]", "column N"),
        ("u [m/s],v [m/s],r [rad/s],n [rps],delta [deg],X [lbf],Y [N],N [N m]", "X .*lbf"),
        ("u [yd/s],v [m/s],r [rad/s],n [rps],delta [deg],X [N],Y [N],N [N m]", "'yd/s'"),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, header: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_captive(write(tmp_path / "tank.csv", header, points(ESSO, count=4)))

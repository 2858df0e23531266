"""Limiting cases of the ship: mirror symmetry, rest, coasting."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.shipfiles.ship_file import load_ship
from mmg.components.coefficients import names
from mmg.components.rigid_body import accelerations, inertia
from mmg.model import Model, assemble
from mmg.motion.flow import Force
from mmg.rollout import Simulator

SHIP = load_ship("esso_osaka_3m")
P = names(dict(SHIP.particulars))
C = names({name: c.value for name, c in SHIP.coefficients.items()})
MIRROR = np.array([1.0, -1.0, -1.0])

speeds = st.floats(-0.5, 0.5) | st.just(0.0)
sways = st.floats(-0.3, 0.3) | st.just(0.0)
yaw_rates = st.floats(-0.2, 0.2) | st.just(0.0)
revolutions = st.floats(-15.0, 15.0) | st.just(0.0)
rudders = st.floats(-0.7, 0.7) | st.just(0.0)
winds = st.floats(-3.0, 3.0) | st.just(0.0)


def symmetric_coefficients() -> np.ndarray:
    """The ship's coefficients without what tells port from starboard: propeller walk, one gamma_R."""
    walk = [f"{letter}_{i}" for letter in "AB" for i in range(1, 9)]
    return SHIP.with_values({**dict.fromkeys(walk, 0.0), "gamma_P": C.gamma_N}).values


@cache
def model(exact: bool) -> Model:
    return assemble(SHIP, exact=exact)


@cache
def all_derivatives() -> ca.Function:
    """Rates, first and second derivatives by state, controls and coefficients: all nonzeros as vectors."""
    x = ca.SX.sym("x", 10 + len(SHIP.symbols))
    rates = model(False).rates(x[:6], x[6:10], x[10:])
    first = ca.jacobian(rates, x)
    second = ca.jacobian(first, x)
    return ca.Function("d", [x], [rates, ca.vertcat(*first.nonzeros()), ca.vertcat(*second.nonzeros())])


# Mirror symmetry


@settings(max_examples=200, deadline=None)
@given(speeds, sways, yaw_rates, revolutions, rudders, winds, winds, st.booleans())
def test_mirrored_motion_gives_mirrored_forces(u, v, r, n, delta, north, east, exact) -> None:
    """F(u, -v, -r, -delta, mirrored wind) = (X, -Y, -N) without propeller walk and with one gamma_R."""
    theta = symmetric_coefficients()
    forces = model(exact).forces
    one = np.array(forces([0, 0, 0, u, v, r], [n, delta, north, east], theta))
    other = np.array(forces([0, 0, 0, u, -v, -r], [n, -delta, north, -east], theta))
    np.testing.assert_allclose(other, one * MIRROR, rtol=1e-9, atol=1e-13)


def test_propeller_walk_and_flow_straightening_do_tell_port_from_starboard() -> None:
    """The symmetry above comes from the chosen coefficients, not from terms that are missing."""
    for n, v in ((-10.0, 0.0), (10.0, 0.1)):
        one = np.array(model(True).forces([0, 0, 0, 0.2, v, 0], [n, 0, 0, 0], SHIP.values))
        other = np.array(model(True).forces([0, 0, 0, 0.2, -v, 0], [n, 0, 0, 0], SHIP.values))
        assert np.abs(other - one * MIRROR).max() > 1e-3


@pytest.mark.parametrize("psi", [0.0, 0.7, -2.0, 3.0])
def test_accelerations_do_not_depend_on_heading_when_the_wind_turns_along(psi: float) -> None:
    state, controls = np.array([5, -3, 0, 0.2, -0.05, 0.03]), np.array([8, 0.2, 1.0, 0.5])
    turned_state, turned = state.copy(), controls.copy()
    turned_state[2] = psi
    turned[2:] = [np.cos(psi) - 0.5 * np.sin(psi), np.sin(psi) + 0.5 * np.cos(psi)]
    own, other = (
        np.array(model(False).rates(*pair, SHIP.values)).ravel()[3:]
        for pair in ((state, controls), (turned_state, turned))
    )
    np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-14)


# Rest


@pytest.mark.parametrize("delta", [0.0, 0.3, -0.6, 1.5])
@pytest.mark.parametrize("wind", [(0.0, 0.0), (1.0, -2.0)])
def test_all_derivatives_are_finite_at_rest(delta: float, wind: tuple[float, float]) -> None:
    x = np.concatenate([np.zeros(7), [delta, *wind], SHIP.values])
    for values in all_derivatives()(x):
        assert np.isfinite(np.array(values)).all()


@settings(max_examples=300, deadline=None)
@given(speeds, sways, yaw_rates, revolutions, rudders, winds, winds)
def test_all_derivatives_are_finite_in_every_quadrant(u, v, r, n, delta, north, east) -> None:
    x = np.concatenate([[0, 0, 0.4, u, v, r, n, delta, north, east], SHIP.values])
    for values in all_derivatives()(x):
        assert np.isfinite(np.array(values)).all()


@pytest.mark.parametrize("n", [-10.0, 0.0, 10.0])
@pytest.mark.parametrize("u", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("v", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize("r", [-0.05, 0.0, 0.05])
def test_all_derivatives_are_finite_on_a_grid_with_zeros(u: float, v: float, r: float, n: float) -> None:
    x = np.concatenate([[0, 0, 0, u, v, r, n, 0, 0, 0], SHIP.values])
    for values in all_derivatives()(x):
        assert np.isfinite(np.array(values)).all()


@pytest.mark.parametrize("delta", [0.0, 0.3, -0.6, 1.5])
def test_nothing_moves_at_rest(delta: float) -> None:
    """Exactly; the smooth model creeps by at most 6e-8 (m/s^2, rad/s^2): u_R is held above a few mm/s.

    That is 1e-5 of the accelerations of slow manoeuvring, and 1e-5 N at the rudder.
    """
    at_rest = ([0.0] * 6, [0.0, delta, 0.0, 0.0], SHIP.values)
    np.testing.assert_array_equal(np.array(model(True).rates(*at_rest)), 0.0)
    np.testing.assert_allclose(np.array(model(False).rates(*at_rest)), 0.0, atol=1e-7)


# Coasting


def kinetic_energy(velocity: np.ndarray) -> np.ndarray:
    """Kinetic energy with added mass [J] of u, v, r (3, ...)."""
    u, v, r = velocity
    unit = 0.5 * P.rho * P.L**2 * P.d
    inertia = C.I_J_z * unit * P.L**2 + P.x_G**2 * P.m
    quadratic = (P.m + C.m_x * unit) * u**2 + (P.m + C.m_y * unit) * v**2 + inertia * r**2
    return 0.5 * quadratic + P.x_G * P.m * v * r


def power(velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """d(kinetic energy)/dt [W]; the energy is quadratic, so its polarisation gives the product."""
    return 0.5 * (kinetic_energy(velocity + acceleration) - kinetic_energy(velocity - acceleration))


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(SHIP)


def coasting_starts(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random states (6, count) and controls with n = 0, no wind and any rudder (4, count)."""
    rng = np.random.default_rng(6)
    start, controls = np.zeros((6, count)), np.zeros((4, count))
    start[3:] = rng.uniform(-1, 1, (3, count)) * np.array([[0.4], [0.2], [0.15]])
    controls[1] = rng.uniform(-0.6, 0.6, count)
    return start, controls


def test_a_coasting_ship_loses_energy(simulator: Simulator) -> None:
    """In every one of 512 runs energy falls at each step, and by 5 % or more in 20 s (measured 11 %)."""
    start, controls = coasting_starts(512)
    path = simulator.run(start, np.tile(controls, (200, 1, 1)), 0.1)
    energy = np.array([kinetic_energy(state[3:]) for state in path])
    assert (energy[-1] < 0.95 * energy[0]).all()
    assert (np.diff(energy, axis=0) < 0).all()


def test_energy_falls_in_every_direction_of_motion(simulator: Simulator) -> None:
    """dE/dt < 0 for n = 0, although single terms of the model do work.

    Those are: the terms in u v r, namely (m_y - m_x) of the equations, which hold no Munk moment, and the
    part of N_v', Y_r', X_vr' that belongs with it; the rudder; and the stopped propeller, whose k_2 u_P^2
    keeps pushing astern in sternway and whose side force there has A_6 u^2. Hull drag outweighs them.
    """
    azimuth, height = np.meshgrid(np.linspace(-np.pi, np.pi, 73), np.linspace(-1, 1, 25))
    for delta in (-0.6, -0.2, 0.0, 0.2, 0.6):
        state = np.zeros((6, azimuth.size))
        state[3] = 0.3 * (np.sqrt(1 - height**2) * np.cos(azimuth)).ravel()
        state[4] = 0.3 * (np.sqrt(1 - height**2) * np.sin(azimuth)).ravel()
        state[5] = 0.3 * height.ravel() / P.L * 2
        controls = np.zeros((4, azimuth.size))
        controls[1] = delta
        lost = power(state[3:], simulator.rates(state, controls)[3:])
        assert (lost < 0).all()


@settings(max_examples=100, deadline=None)
@given(speeds, sways, yaw_rates)
def test_without_forces_only_the_munk_term_does_work(u: float, v: float, r: float) -> None:
    """dE/dt = (m_y - m_x) u v r exactly: the rest of the Coriolis terms does no work."""
    velocity = np.array([u, v, r])
    got = power(velocity, np.array(accelerations(u, v, r, Force(), inertia(P, C))))
    unit = 0.5 * P.rho * P.L**2 * P.d
    assert got == pytest.approx((C.m_y - C.m_x) * unit * u * v * r, rel=1e-9, abs=1e-12)

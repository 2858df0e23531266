"""KVLCC2 against the check values of Yasukawa & Yoshimura (2015): states, propulsion, manoeuvres."""

from __future__ import annotations

import itertools
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.ship_file import load_ship
from mmg.components.hull import polynomial
from mmg.components.propeller import standard, wake
from mmg.components.rudder import standard as rudder
from mmg.model import Model, assemble
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact
from mmg.rollout import Simulator
from tests.support.force_numbers import number, particulars_and_coefficients, smooth, xyn

SHIPS = ("kvlcc2_l7", "kvlcc2_full")
P, C = particulars_and_coefficients("kvlcc2_l7")
SMOOTH = smooth(P)

STATES = ((1.0, -0.1, 0.05, 10.0, 10.0), (1.1, 0.15, -0.08, 12.0, -20.0))
"""u, v [m/s], r [rad/s], n [1/s], rudder [deg]."""

PRINTED = (
    {
        "hull": (-33.8664, 109.689, -63.3876),
        "wake": (0.266835, 0.748878, 0.346703, 0.181005),
        "X_P": (30.7326,),
        "inflow": (1.14729, 0.346935, 0.223146),
        "normal": (-0.0175679, -1.77657),
        "rudder": (0.18911, 2.29546, -7.89653),
        "rates": (-8.45496e-3, -1.019511e-2, -6.361233e-3),
    },
    {
        "hull": (-38.8836, -208.740, 170.351),
        "wake": (-0.377651, 0.631808, 0.268128, 0.209327),
        "X_P": (51.1797,),
        "inflow": (1.25750, -0.493668, -0.216484),
        "normal": (-0.178583, -21.4115),
        "rudder": (-4.4891, 26.3978, -90.8102),
        "rates": (-1.596941e-2, 2.092049e-2, 8.217546e-3),
    },
)
"""X, Y, N of the hull; beta_P, 1 - w_P, J, K_T; X_P; u_R, beta_R, v_R; alpha_R, F_N; rudder; accelerations (SI)."""

QUANTITIES = tuple(PRINTED[0])


@cache
def model(name: str, exact: bool) -> Model:
    return assemble(load_ship(name), exact=exact)


def evaluated(row: int, exact: bool) -> dict[str, tuple[float, ...]]:
    """The quantities of PRINTED from the force models."""
    u, v, r, n, degrees = STATES[row]
    s, delta, nD = Exact() if exact else SMOOTH, np.radians(degrees), n * P.D_P
    flow = Flow(u=u, v=v, r=r, n=n, delta=delta)
    push = standard.force(flow, P, C, s)
    washed = flow.with_(slipstream=push.slipstream)
    u_R, v_R = (number(part) for part in rudder.inflow(washed, P, C, s))
    gamma = C.gamma_R_plus if v_R > 0 else C.gamma_R_minus
    turn = xyn(rudder.force(washed, P, C, s))
    wash = push.slipstream
    state = [0, 0, 0, u, v, r]
    rates = np.array(model("kvlcc2_l7", exact).rates(state, [n, delta, 0, 0], load_ship("kvlcc2_l7").values)).ravel()
    return {
        "hull": tuple(xyn(polynomial.force(flow, P, C, s))),
        "wake": (
            number(wake.inflow_angle(flow, P, C, s)),
            number(wash.one_minus_w),
            number(wash.u_P) / nD,
            number(wash.loading) / nD**2,
        ),
        "X_P": (number(push.X),),
        "inflow": (u_R, v_R / gamma / np.hypot(u, v), v_R),
        "normal": (delta - np.arctan2(v_R, u_R), turn[0] / (-(1 - C.t_R) * np.sin(delta))),
        "rudder": tuple(turn),
        "rates": tuple(rates[3:]),
    }


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize(("exact", "tolerance"), [(True, 1e-5), (False, 2e-4)])
def test_single_states(row: int, quantity: str, exact: bool, tolerance: float) -> None:
    """Exact: 5e-6 or less, the printed digits. Smooth: 1.6e-4 (angle of attack), from |u| in the drift angle."""
    np.testing.assert_allclose(evaluated(row, exact)[quantity], PRINTED[row][quantity], rtol=tolerance)


@pytest.mark.parametrize(("name", "speed", "n"), [("kvlcc2_l7", 1.179, 11.799), ("kvlcc2_full", 7.9739, 1.7785)])
def test_self_propulsion(name: str, speed: float, n: float) -> None:
    assert revolutions_for(load_ship(name), speed) == pytest.approx(n, rel=5e-5)


def test_advance_and_thrust_coefficient_at_self_propulsion() -> None:
    """J 0.2776, K_T 0.2060 at 11.799 rps."""
    push = standard.force(Flow(u=1.179, v=0.0, r=0.0, n=11.799), P, C, Exact())
    nD = 11.799 * P.D_P
    assert number(push.slipstream.u_P) / nD == pytest.approx(0.2776, abs=5e-5)
    assert number(push.slipstream.loading) / nD**2 == pytest.approx(0.2060, abs=5e-5)


# Symmetry, rest, energy of the assembled ship


@settings(max_examples=100, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1, 1), st.floats(-0.5, 0.5), st.floats(-15, 15), st.floats(-0.7, 0.7))
def test_mirrored_motion_gives_mirrored_accelerations(u, v, r, n, delta) -> None:
    ship = load_ship("kvlcc2_l7")
    even = {"gamma_R_plus": 0.5, "gamma_R_minus": 0.5, "C_2_plus": 1.4, "C_2_minus": 1.4}
    theta = ship.with_values(even).values
    rates = model("kvlcc2_l7", False).rates
    one = np.array(rates([0, 0, 0, u, v, r], [n, delta, 0, 0], theta)).ravel()[3:]
    other = np.array(rates([0, 0, 0, u, -v, -r], [n, -delta, 0, 0], theta)).ravel()[3:]
    np.testing.assert_allclose(other, one * (1, -1, -1), rtol=1e-9, atol=1e-12)


def mass_matrix(name: str) -> np.ndarray:
    """Masses with added mass about midship (3, 3)."""
    ship = load_ship(name)
    p, c = ship.particulars, {symbol: row.value for symbol, row in ship.coefficients.items()}
    unit = 0.5 * p["rho"] * p["L"] ** 2 * p["d"]
    mass = np.diag([p["m"] + c["m_x"] * unit, p["m"] + c["m_y"] * unit, c["I_J_z"] * unit * p["L"] ** 2])
    mass[2, 2] += p["x_G"] ** 2 * p["m"]
    mass[1, 2] = mass[2, 1] = p["x_G"] * p["m"]
    return mass


@cache
def simulator(name: str) -> Simulator:
    return Simulator(load_ship(name))


def power(name: str, velocity: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """d(kinetic energy)/dt [W] with the propeller stopped; velocity (3, N), delta (N,)."""
    state, controls = np.zeros((6, len(delta))), np.zeros((4, len(delta)))
    state[3:], controls[1] = velocity, delta
    acceleration = simulator(name).rates(state, controls)[3:]
    return np.einsum("ik,ij,jk->k", velocity, mass_matrix(name), acceleration)


@pytest.mark.parametrize("name", SHIPS)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.sampled_from([1e-3, 0.02, 0.1, 1.0]), zero=st.sampled_from(range(8)))
def test_a_coasting_ship_loses_energy_in_every_direction(name: str, seed: int, size: float, zero: int) -> None:
    """n = 0, any rudder from 1 cm/s of a 7 m model on; rudder midships at any speed; zeros of u, v, r included.

    Below that a rudder over creeps: u_R is held above a few mm/s, which is worth 1e-7 m/s^2.
    """
    rng = np.random.default_rng(seed)
    L = load_ship(name).particulars["L"]
    velocity = rng.normal(size=(3, 200)) * np.array([[1], [1], [4 / L]])
    velocity[[k for k in range(3) if zero >> k & 1]] = 0.0
    norm = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + (velocity[2] * L / 4) ** 2)
    velocity *= size * np.sqrt(L / 7.0) / np.maximum(norm, 1e-300)
    delta = rng.uniform(-0.6, 0.6, 200) if size >= 0.02 else np.zeros(200)
    lost = power(name, velocity, delta)
    assert (lost < 0).all() if zero < 7 else (lost == 0).all()


@pytest.mark.parametrize("name", SHIPS)
def test_energy_falls_along_256_runs_with_the_propeller_stopped(name: str) -> None:
    """At every step; 1 % or more in 60 s of the model, as the slowest start at a few cm/s."""
    rng, L = np.random.default_rng(3), load_ship(name).particulars["L"]
    scale = np.sqrt(L / 7.0)
    start, controls = np.zeros((6, 256)), np.zeros((4, 256))
    start[3:] = rng.uniform(-1, 1, (3, 256)) * np.array([[1.2], [0.5], [0.3 / scale**2]]) * scale
    controls[1] = rng.uniform(-0.6, 0.6, 256)
    path = simulator(name).run(start, np.tile(controls, (300, 1, 1)), 0.2 * scale)
    energy = np.einsum("tik,ij,tjk->tk", path[:, 3:], mass_matrix(name), path[:, 3:])
    assert (np.diff(energy, axis=0) < 0).all()
    assert (energy[-1] < 0.99 * energy[0]).all()


@pytest.mark.parametrize("delta", [0.0, 0.5])
def test_nothing_moves_at_rest(delta: float) -> None:
    theta = load_ship("kvlcc2_l7").values
    at_rest = ([0.0] * 6, [0.0, delta, 0.0, 0.0], theta)
    np.testing.assert_array_equal(np.array(model("kvlcc2_l7", True).rates(*at_rest)), 0.0)
    np.testing.assert_allclose(np.array(model("kvlcc2_l7", False).rates(*at_rest)), 0.0, atol=1e-7)


@pytest.mark.parametrize("name", ["kvlcc2_l7", "mariner"])
def test_derivatives_by_state_controls_and_coefficients_are_finite(name: str) -> None:
    """First and second, at rest, on axes, in all quadrants and at creeping speed."""
    ship = load_ship(name)
    controls, count = len(ship.actuators) + 2, len(ship.symbols)
    x = ca.SX.sym("x", 6 + controls + count)
    rates = assemble(ship).rates(x[:6], x[6 : 6 + controls], x[6 + controls :])
    first = ca.jacobian(rates, x)
    second = ca.jacobian(ca.vertcat(*first.nonzeros()), x)
    every = ca.Function("d", [x], [rates, ca.vertcat(*first.nonzeros()), ca.vertcat(*second.nonzeros())])
    scale = np.array([1.0, 0.3, 0.1, 10.0, 0.4])[: 3 + controls - 2] if controls == 4 else np.array([7.0, 1, 0.01, 0.4])
    for sign in itertools.product((-1.0, 0.0, 1.0), repeat=len(scale)):
        for size in (1.0, 1e-3):
            motion = size * scale * np.array(sign)
            point = np.concatenate([[0, 0, 0.4], motion, [0, 0], ship.values])
            for part in every(point):
                assert np.isfinite(np.array(part)).all(), motion


@pytest.mark.parametrize("name", SHIPS)
def test_the_ship_file_is_complete(name: str) -> None:
    ship = load_ship(name)
    assert ship.notices == ()
    for symbol, c in ship.coefficients.items():
        assert c.source and not c.source.startswith("default"), symbol
        assert c.std > 0 and c.lower < c.value < c.upper and c.description, symbol
    inertia = 0.25**2 * ship.particulars["m"] * ship.particulars["L"] ** 2
    unit = 0.5 * ship.particulars["rho"] * ship.particulars["L"] ** 4 * ship.particulars["d"]
    assert ship.coefficients["I_J_z"].value == pytest.approx(inertia / unit + 0.011, rel=1e-6)
    assert ship.coefficients["beta_t"].value == pytest.approx(standard.reversal(0.721), rel=1e-5)

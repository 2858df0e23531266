"""Tunnel and azimuth thrusters: laws, limits; actuators that follow orders, and the roll option, by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.simulation.simulate import simulate
from mmg.components.coefficients import names
from mmg.components.propeller.four_quadrant import thrust
from mmg.components.roll import linear
from mmg.components.thruster import azimuth, bow, stern
from mmg.model import assemble
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import GRAVITY
from mmg.motion.memory import Memory, clip
from mmg.motion.smooth import Exact, Smooth
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship
from tests.support.force_numbers import table_values, xyn

TAKAOKI = load_ship("vectwin_3m")
P = names({**TAKAOKI.particulars, "D_ST": 0.05, "x_ST": -1.30, "D_az": 0.06, "x_az": -1.4, "y_az": 0.12})
BOW = names({name: c.value for name, c in TAKAOKI.coefficients.items()})
STERN, AZIMUTH = table_values(stern.COEFFICIENTS), table_values(azimuth.coefficients(P))
EXACT, SMOOTH = Exact(), Smooth.for_length(P.L)
BOTH = pytest.mark.parametrize("s", [EXACT, SMOOTH])

A_Y, A_N = (0.2352, -12.701, 67.116), (0.2231, -6.5716, 79.614)


def push(u: float, n: float, s: Exact | Smooth = EXACT, c: SimpleNamespace = BOW) -> np.ndarray:
    return xyn(bow.force(Flow(u=u, v=0.0, r=0.0, n_bow=n), P, c, s))


# Tunnel thrusters


@BOTH
@pytest.mark.parametrize(("n", "K_T"), [(20.0, 0.16684), (-20.0, -0.2213), (0.0, 0.0)])
@pytest.mark.parametrize("u", [0.0, 0.15, -0.15, 0.4, 0.6])
def test_bow_thruster_law(u: float, n: float, K_T: float, s: Exact | Smooth) -> None:
    """T = rho D^4 n^2 K_T, by the quadratic factors in Fr up to their minima at Fr = 0.0946 and 0.0413."""
    Fr = abs(u) / np.sqrt(9.80665 * 3.0)
    T = 998.0 * 0.039**4 * n * n * K_T
    factor_Y, factor_N = (
        1 + a[0] + a[1] * F + a[2] * F**2 for a, lowest in ((A_Y, 0.09462), (A_N, 0.041272)) for F in (min(Fr, lowest),)
    )
    expected = np.array([0.0, factor_Y * T, factor_N * 1.3564 * T])
    np.testing.assert_allclose(push(u, n, s), expected, rtol=1e-6 if s is EXACT else 2e-3, atol=1e-9)


@BOTH
@pytest.mark.parametrize(("n", "K_T"), [(20.0, 0.17), (-15.0, -0.21)])
def test_stern_thruster_law(n: float, K_T: float, s: Exact | Smooth) -> None:
    """ESSO OSAKA's first-order factors, 1 - 2.56 Fr and 1 - 7.46 Fr; the bow goes to port."""
    u = 0.1
    Fr, T = u / np.sqrt(9.80665 * 3.0), 998.0 * 0.05**4 * n * n * K_T
    got = xyn(stern.force(Flow(u=u, v=0.0, r=0.0, n_stern=n), P, STERN, s))
    expected = [0.0, (1 - 2.56 * Fr) * T, (1 - 7.46 * Fr) * -1.30 * T]
    np.testing.assert_allclose(got, expected, rtol=1e-9 if s is EXACT else 2e-3)


def test_no_effect_beyond_the_highest_speed() -> None:
    for u in (0.651, 0.8, -0.8):
        np.testing.assert_array_equal(push(u, 20.0), 0.0)
    assert abs(push(0.75, 20.0, SMOOTH)[1]) < 1e-3 * push(0.55, 20.0, SMOOTH)[1]
    assert push(0.64, 20.0)[1] > 0.09


# Azimuth thruster


def pod(c: SimpleNamespace = AZIMUTH, s: Exact | Smooth = EXACT, **motion: float) -> np.ndarray:
    return xyn(azimuth.force(Flow(**{"u": 0.0, "v": 0.0, "r": 0.0, **motion}), P, c, s))


@BOTH
@pytest.mark.parametrize("degrees", [0, 45, 90, 180, -120])
def test_at_rest_the_pod_pushes_into_its_direction(degrees: float, s: Exact | Smooth) -> None:
    a = np.radians(degrees)
    X, Y, N = pod(s=s, n_azimuth=15.0, azimuth=a)
    T = (1 - AZIMUTH.t_az) * 0.4451 * 998.0 * 15.0**2 * 0.06**4
    np.testing.assert_allclose((X, Y), (T * np.cos(a), T * np.sin(a)), rtol=2e-4, atol=1e-9)
    assert pytest.approx(-1.4 * Y - 0.12 * X, abs=1e-12) == N


def test_pod_sees_the_speed_along_its_axis_at_its_place() -> None:
    """Without drag: the speed into its direction, with yaw, is the advance speed of the four-quadrant screw."""
    c = SimpleNamespace(**{**vars(AZIMUTH), "C_pod": 0.0})
    u, v, r, n, a = 0.3, -0.1, 0.05, 12.0, 2.0
    V = (1 - c.w_az) * ((u - 0.12 * r) * np.cos(a) + (v - 1.4 * r) * np.sin(a))
    T = (1 - c.t_az) * float(ca.DM(thrust(V, n, 0.06, 998.0)))
    X, Y, _ = pod(c, u=u, v=v, r=r, n_azimuth=n, azimuth=a)
    np.testing.assert_allclose((X, Y), (T * np.cos(a), T * np.sin(a)), rtol=1e-9)


def test_each_pod_has_a_thrust_of_its_own() -> None:
    """At rest, aside: the force of four pods is that of one by the sum of their factors, its moment by their places."""
    ship = true_ship("pods")
    factors = np.array([1.0, 0.7, 1.2, 0.9])
    c = names({s: row.value for s, row in ship.coefficients.items()})
    for i, factor in enumerate(factors[1:], start=2):
        setattr(c, f"k_T_az_{i}", factor)
    p = names(dict(ship.particulars))
    endings = ("", "_2", "_3", "_4")
    inputs = {f"n_azimuth{i}": 10.0 for i in endings} | {f"azimuth{i}": np.pi / 2 for i in endings}
    _, Y, N = xyn(azimuth.force(Flow(u=0.0, v=0.0, r=0.0, **inputs), p, c, EXACT))
    T = (1 - c.t_az) * 0.4451 * 998.0 * 10.0**2 * 0.06**4
    assert pytest.approx(T * factors.sum(), rel=2e-4) == Y
    assert pytest.approx(T * factors @ (-1.2, -1.2, 1.2, 1.2), rel=2e-4) == N


# The ship


def test_a_ship_with_all_thrusters_assembles_and_each_one_acts() -> None:
    ship = replace(TAKAOKI, particulars=vars(P)).with_models(stern_thruster="kobayashi", azimuth="azimuth")
    model = assemble(ship)
    rest = dict.fromkeys(model.controls, 0.0)
    expected = {"n_bow": (0, 1, 1), "n_stern": (0, 1, -1), "n_azimuth": (1, 0, -1)}
    still = np.array(model.rates([0.0] * 6, list(rest.values()), ship.values)).ravel()[3:]
    for name, signs in expected.items():
        moved = np.array(model.rates([0.0] * 6, list({**rest, name: 15.0}.values()), ship.values)).ravel()[3:] - still
        for value, sign in zip(moved, signs, strict=True):
            assert sign == 0 or np.sign(value) == sign


def test_a_pod_drags_with_the_square_of_the_flow_at_its_place() -> None:
    """What C_pod adds: 1/2 rho D^2 C_pod |V| (u, v) against the flow, and its moment."""
    motion = {"u": 0.3, "v": -0.1, "r": 0.05, "n_azimuth": 12.0, "azimuth": 2.0}
    without = SimpleNamespace(**{**vars(AZIMUTH), "C_pod": 0.0})
    u, v = 0.3 - 0.12 * 0.05, -0.1 - 1.4 * 0.05
    drag = 0.5 * 998.0 * 0.06**2 * AZIMUTH.C_pod * np.hypot(u, v)
    added = pod(s=EXACT, **motion) - pod(without, s=EXACT, **motion)
    np.testing.assert_allclose(added, (-drag * u, -drag * v, 1.4 * drag * v + 0.12 * drag * u), rtol=1e-9)


@BOTH
@pytest.mark.parametrize(("n", "direction"), [(0.0, 0.0), (12.0, 0.0), (12.0, 2.2), (-12.0, -0.7)])
def test_a_pod_takes_the_momentum_of_the_water_that_crosses_its_axis(
    n: float, direction: float, s: Exact | Smooth
) -> None:
    """k_N rho (pi/4) D^2 W V_N against V_N: W = V where the screw does not push, momentum theory where it does; none
    along the axis, none at rest."""
    along, across = np.array([np.cos(direction), np.sin(direction)]), np.array([-np.sin(direction), np.cos(direction)])

    def added(u: float, v: float) -> np.ndarray:
        flow = Flow(u=u, v=v, r=0.0, n_azimuth=n, azimuth=direction)
        more = SimpleNamespace(**{**vars(AZIMUTH), "k_N_az": 1.0})
        return np.array(xyn(azimuth.force(flow, P, more, s)) - xyn(azimuth.force(flow, P, AZIMUTH, s)))[:2]

    np.testing.assert_allclose(added(*(0.4 * along)), 0.0, atol=1e-9)
    np.testing.assert_allclose(added(0.0, 0.0), 0.0, atol=1e-12)
    speed, disc = 0.3, P.rho * np.pi / 4 * P.D_az**2
    T = (1 - AZIMUTH.t_az) * AZIMUTH.k_T_az * float(thrust(0.0, n, P.D_az, P.rho, EXACT))
    W = 0.5 * speed + np.sqrt(0.25 * speed**2 + 0.5 * abs(T) / disc)
    close = 1e-9 if s is EXACT else 0.02
    np.testing.assert_allclose(added(*(speed * across)), -disc * W * speed * across, rtol=close, atol=close * 1e-3)


# Actuators that follow orders, and roll


ESSO = load_ship("esso_osaka_3m")


def with_role(ship: Ship, role: str, name: str, **particulars: float) -> Ship:
    """The ship with one more component at its default coefficients."""
    return replace(ship, particulars={**ship.particulars, **particulars}).with_models(**{role: name})


def test_the_clip_is_smooth_and_stays_within_its_limits() -> None:
    x = np.linspace(-1, 1, 2001)
    y = np.array([float(clip(v, 0.05, 2e-3)) for v in x])
    assert np.abs(y).max() <= 0.05 + 1e-12
    inside = np.abs(x) < 0.03
    np.testing.assert_allclose(y[inside], x[inside], atol=1e-3)


@pytest.mark.parametrize("name", ["rate_limited", "lag"])
def test_a_ship_with_actuators_follows_orders(name: str) -> None:
    """Orders are steps in the trial; the ship turns later than with an ideal rudder, and it is a ship file."""
    ship = parse_ship(dump_ship(with_role(ESSO, "actuators", name)))
    model = assemble(ship)
    assert model.states[6:] == ("delta", "n")
    plan = parse_maneuver("turning:35", ship, n=10.0, duration=40.0)
    turned = simulate(ship, plan)
    assert set(np.round(np.unique(turned["delta"]), 12)) == {0.0, round(math.radians(35), 12)}
    ideal = simulate(ESSO, plan)
    assert turned["r"][60] < ideal["r"][60]
    assert turned["r"][-1] == pytest.approx(ideal["r"][-1], rel=0.02)


ROLLING = with_role(ESSO, "roll", "linear", GM=0.02)


def test_the_steady_heel_balances_the_moments() -> None:
    plan = parse_maneuver("turning:35", ROLLING, n=10.0, duration=200.0)
    run, plain = simulate(ROLLING, plan), simulate(ESSO, plan)
    assert np.array_equal(run["r"], plain["r"])
    model = assemble(ROLLING)
    state = np.array([0, 0, 0, run["u"][-1], run["v"][-1], run["r"][-1], run["phi"][-1], run["p"][-1]])
    forces = np.array(model.forces(state, [10.0, run["delta"][-1], 0, 0], ROLLING.values))
    c = {s: ROLLING.coefficients[s].value for s in ("z_H", "z_R", "z_A", "z_G")}
    by_role = dict(zip(model.roles, forces[:, 1], strict=True))
    K = -(c["z_H"] * by_role["hull"] + c["z_R"] * by_role["rudder"] + c["z_A"] * by_role["wind"])
    heel = K / (ROLLING.particulars["m"] * GRAVITY * 0.02)
    assert math.sin(run["phi"][-1]) == pytest.approx(heel, rel=1e-3)
    assert run["phi"][-1] != 0


def test_the_rate_of_roll_is_that_of_its_equation() -> None:
    """At one moving, heeled and rolling state, with a centre of gravity below the waterline, worked out by hand."""
    p = SimpleNamespace(m=500.0, GM=0.03, B=0.6, d=0.2)
    c = SimpleNamespace(k_x_roll=0.24, zeta_roll=0.08, z_H=0.1, z_R=0.12, z_A=-0.3, z_G=0.05)
    parts = {
        role: Force(0, Y, 0) for role, Y in zip(("hull", "rudder", "wind", "propeller"), (7, -3, 2, 50), strict=True)
    }
    memory = Memory()
    linear.roll(Flow(u=0.8, v=-0.1, r=0.2), parts, 0.3, memory, p, c)
    rates = ca.Function("f", memory.symbols, [ca.vertcat(*memory.rates)])(0.2, 0.4)
    inertia, stiffness = 500.0 * 0.24**2, 500.0 * GRAVITY * 0.03
    K = -(0.1 * 7.0 + 0.12 * -3.0 - 0.3 * 2.0) + 500.0 * 0.05 * (0.3 + 0.8 * 0.2)
    moment = K - 2 * 0.08 * math.sqrt(inertia * stiffness) * 0.4 - stiffness * math.sin(0.2)
    assert np.array(rates).ravel() == pytest.approx([0.4, moment / inertia])
    assert memory.names == ["phi", "p"] and memory.targets == [0.0, 0.0]

"""Four-quadrant propeller: printed check values of B4-70, limits."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.shipfiles.ship_file import load_ship
from mmg.components.coefficients import names
from mmg.components.propeller import cpp
from mmg.components.propeller import four_quadrant as fq
from mmg.components.rudder import single
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact, Smooth
from tests.support.force_numbers import table_values, xyn

ESSO = load_ship("esso_osaka_3m")
P = names(dict(ESSO.particulars))
C = table_values(fq.COEFFICIENTS)
EXACT, SMOOTH = Exact(), Smooth.for_length(3.0)
D, RHO = 0.084, 998.0


def C_T(degrees: float, smoothing: Exact | Smooth = EXACT, speed: float = 2.0) -> float:
    """C_T* [-] at an advance angle, for V_r = ``speed`` [m/s]."""
    beta = np.radians(degrees)
    V_A, tip = speed * np.sin(beta), speed * np.cos(beta)
    return float(ca.DM(fq.series(V_A, tip, fq.A_T, fq.B_T, smoothing))) / speed**2


def K_T(J: float, n: float = 10.0, k_T: float = 1.0, k_J: float = 1.0) -> float:
    return k_T * float(ca.DM(fq.thrust(J * n * D / k_J, n, D, RHO))) / (RHO * n * n * D**4)


@pytest.mark.parametrize(
    ("degrees", "printed"),
    [
        (0, 0.234362), (30, -0.06076), (60, -0.60702), (90, -0.77011), (120, -0.73177), (150, -0.38562),
        (180, -0.18276), (210, 0.10146), (240, 0.63829), (270, 0.70806), (300, 0.82157), (330, 0.50876),
    ],
)  # fmt: skip
def test_thrust_coefficient_at_the_printed_angles(degrees: float, printed: float) -> None:
    assert C_T(degrees) == pytest.approx(printed, abs=0.51e-5)
    assert C_T(degrees, SMOOTH) == pytest.approx(printed, abs=1e-5)


@pytest.mark.parametrize(("n", "thrust", "torque"), [(10.0, 0.4451, 0.0666), (-10.0, -0.3471, -0.0628)])
def test_bollard_thrust_and_torque(n: float, thrust: float, torque: float) -> None:
    assert K_T(0.0, n) == pytest.approx(thrust, abs=0.51e-4)
    Q_by_rho = np.pi / 8 * D**3 * float(fq.series(0.0, 0.7 * np.pi * n * D, fq.A_Q, fq.B_Q, EXACT))
    assert Q_by_rho / (n * n * D**5) == pytest.approx(torque, abs=0.51e-4)


@pytest.mark.parametrize("s", [EXACT, SMOOTH])
def test_thrust_deduction_and_wake_belong_to_headway(s: Exact | Smooth) -> None:
    """Ahead (1 - t_P) T at u (1 - w_P0); reversed (1 - t_PA) T; no wake with sternway."""
    for u, n, share, wake in ((0.3, 10, C.t_P, C.w_P0), (0.3, -10, C.t_PA, C.w_P0), (-0.3, 10, C.t_P, 0.0)):
        got = fq.force(Flow(u=u, v=0.0, r=0.0, n=n), P, C, s)
        T = float(ca.DM(fq.thrust(u * (1 - wake), n, P.D_P, P.rho)))
        assert xyn(got)[0] == pytest.approx((1 - share) * T, rel=2e-4)
        assert got.slipstream is not None
        assert float(ca.DM(got.slipstream.u_P)) == pytest.approx(u * (1 - wake), rel=1e-4)
        loading = T * (1 if n > 0 else 1 - share) / (P.rho * P.D_P**2)
        assert float(ca.DM(got.slipstream.loading)) == pytest.approx(loading, rel=2e-4)


def test_factors_on_thrust_and_advance() -> None:
    c = SimpleNamespace(**{**vars(C), "k_T": 0.7, "k_J": 0.75})
    X = xyn(fq.force(Flow(u=0.3, v=0.0, r=0.0, n=10.0), P, c, EXACT))[0]
    T = float(ca.DM(fq.thrust(0.3 * (1 - C.w_P0) / 0.75, 10.0, P.D_P, P.rho)))
    assert pytest.approx((1 - C.t_P) * 0.7 * T) == X


def test_wake_fades_with_drift() -> None:
    for v in (0.0, -0.2):
        wash = fq.force(Flow(u=0.3, v=v, r=0.0, n=10.0), P, C, EXACT).slipstream
        assert wash is not None
        by_hand = 1 - C.w_P0 * np.exp(-4 * np.arctan2(-v, 0.3) ** 2)
        assert float(ca.DM(wash.one_minus_w)) == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.parametrize("n", [-10.0, 0.0, 10.0])
@pytest.mark.parametrize("u", [-0.3, 0.0, 0.3])
def test_second_derivatives_do_not_blow_up_towards_rest(u: float, n: float) -> None:
    """They are those of a quadratic law."""
    x = ca.SX.sym("n")
    X = fq.force(Flow(u=1e-4 * u, v=0.0, r=0.0, n=x), P, C, SMOOTH).X
    bend = float(ca.Function("bend", [x], [ca.hessian(X, x)[0]])(1e-4 * n))
    assert abs(bend) < 60 * np.pi / 8 * P.rho * P.D_P**2 * (0.7 * np.pi * P.D_P) ** 2


# Controllable-pitch propeller: the published pieces, their joints, derivatives
P_CPP = names({"L": 3.3663, "rho": 998.0, "D_P": 0.11})
C_CPP = table_values(cpp.COEFFICIENTS)
EXACT_CPP, SMOOTH_CPP = Exact(), Smooth.for_length(P_CPP.L)
UNIT = P_CPP.rho * P_CPP.D_P**4


def published(u: float, n: float, degrees: float) -> tuple[float, float]:
    """K_X and K_Y of the source for n > 0; below the pitch of zero thrust, at 10 degrees, K_X is mirrored."""
    side = 1.0 if degrees > 10.0 else -1.0
    J, above = side * u / (n * P_CPP.D_P), side * (degrees - 10.0)
    alpha = 0.6 / (0.7 * np.pi * np.tan(np.radians(30.0)))
    J_x0, X_0 = 0.7 * np.pi * np.tan(np.radians(above)), 0.4 * above / 30.0
    if J <= -0.5:
        K_X = -alpha * (J + 0.5) + X_0
    elif J <= 0:
        K_X = (alpha * J_x0 - X_0) * J / 0.5 + alpha * J_x0
    else:
        K_X = -alpha * (J - J_x0)
    return side * K_X, 0.0 if side > 0 else 0.178 * (above / 30.0) ** 2


def force(u: float, n: float, degrees: float, s: Exact | Smooth = EXACT_CPP) -> np.ndarray:
    return xyn(cpp.force(Flow(u=u, v=0.0, r=0.0, n=n, pitch=np.radians(degrees)), P_CPP, C_CPP, s))


@settings(max_examples=100, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(1.0, 15.0), st.floats(-20.0, 40.0))
def test_exact_force_is_the_published_one(u: float, n: float, degrees: float) -> None:
    K_X, K_Y = published(u, n, degrees)
    expected = UNIT * n * n * np.array([K_X, K_Y, -0.5 * P_CPP.L * K_Y])
    np.testing.assert_allclose(force(u, n, degrees), expected, rtol=1e-9, atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(3.0, 15.0), st.floats(-20.0, 40.0))
def test_smooth_force_is_close_to_the_exact_one(u: float, n: float, degrees: float) -> None:
    """Measured 0.0024 in K_X at the kinks, 1e-4 in K_Y; within 2.5 deg of zero thrust the two laws blend."""
    if abs(degrees - 10.0) < 2.5:
        return
    difference = (force(u, n, degrees, SMOOTH_CPP) - force(u, n, degrees)) / (UNIT * n * n)
    assert abs(difference[0]) < 0.003
    assert abs(difference[1]) < 2e-4


@pytest.mark.parametrize("s", [EXACT_CPP, SMOOTH_CPP])
def test_reversed_revolutions_give_the_mirrored_surge_force(s: Exact | Smooth) -> None:
    for u, degrees in ((0.3, 25.0), (-0.4, 30.0), (0.3, -10.0), (0.0, 40.0)):
        assert force(-u, -8.0, degrees, s)[0] == pytest.approx(-force(u, 8.0, degrees, s)[0], rel=1e-9)


@pytest.mark.parametrize("s", [EXACT_CPP, SMOOTH_CPP])
def test_a_stopped_propeller_gives_no_force(s: Exact | Smooth) -> None:
    for u in (-0.5, 0.0, 0.5):
        np.testing.assert_allclose(force(u, 0.0, 30.0, s), 0.0, atol=1e-12)


def test_slipstream_holds_open_water_thrust() -> None:
    got = cpp.force(Flow(u=0.3, v=0.0, r=0.0, n=10.0, pitch=np.radians(30)), P_CPP, C_CPP, EXACT_CPP)
    assert got.slipstream is not None
    loading = float(got.slipstream.loading)
    assert loading * (1 - C_CPP.t_P) * P_CPP.rho * P_CPP.D_P**2 == pytest.approx(xyn(got)[0])
    assert float(got.slipstream.u_P) == pytest.approx(0.3 * (1 - C_CPP.w_P0))


def test_astern_pitch_takes_the_wash_off_the_rudder() -> None:
    """The blades reverse, not the shaft: at astern pitch the water at the rudder is slowed, not sped up."""
    rudder_p = names({**vars(P_CPP), "A_R": 0.012, "aspect_ratio": 1.5, "x_R": -1.7})
    c = names({**vars(C_CPP), **vars(table_values(single.COEFFICIENTS))})

    def inflow(degrees: float) -> float:
        flow = Flow(u=0.4, v=0.0, r=0.0, n=10.0, pitch=np.radians(degrees))
        wash = cpp.force(flow, rudder_p, c, SMOOTH_CPP).slipstream
        return float(ca.DM(single.inflow(flow.with_(slipstream=wash), rudder_p, c, SMOOTH_CPP)[0]))

    assert inflow(35.0) > inflow(10.0) > inflow(-15.0)


# Propeller: van Lammeren, van Manen & Oosterveld (1969), B4-70 with P/D = 1.0


def coefficient(beta: float, A: tuple[float, ...], B: tuple[float, ...]) -> float:
    k = np.arange(len(A))
    return float(np.array(A) @ np.cos(k * beta) + np.array(B) @ np.sin(k * beta))


THRUST, TORQUE = (fq.A_T, fq.B_T), (fq.A_Q, fq.B_Q)


@pytest.mark.parametrize("beta", np.linspace(-3.1, 3.1, 23))
def test_thrust_and_torque_are_the_sums_of_their_harmonics(beta: float) -> None:
    """V_r^2 C* with the harmonics evaluated one by one: by sines and cosines of k beta, not by a recursion."""
    V_A, tip = 2.0 * math.sin(beta), 2.0 * math.cos(beta)
    for A, B in (THRUST, TORQUE):
        expected = 4.0 * coefficient(beta, A, B)
        assert float(fq.series(V_A, tip, A, B, Exact())) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    # of thrust the factor, at twice the diameter and n = 1 another angle
    expected = 3 * math.pi / 2 * (V_A**2 + (1.4 * math.pi) ** 2) * coefficient(math.atan2(V_A, 1.4 * math.pi), *THRUST)
    assert float(fq.thrust(V_A, 1.0, 2.0, 3.0)) == pytest.approx(expected, rel=1e-9)


def test_the_printed_harmonics_are_all_there() -> None:
    """Sums that no wrong digit or sign leaves unchanged, of the four rows as printed (in 1e-8)."""
    sums = [round(1e8 * sum(k * value for k, value in enumerate(row, start=1))) for row in (*THRUST, *TORQUE)]
    assert sums == [79546935, -75064575, 11573665, -10054194]

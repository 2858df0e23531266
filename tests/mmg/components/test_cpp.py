"""Controllable-pitch propeller: the published pieces, their joints, derivatives."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmg.components.coefficients import names
from mmg.components.propeller import cpp
from mmg.components.rudder import single
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact, Smooth
from tests.support.force_numbers import table_values, xyn

P = names({"L": 3.3663, "rho": 998.0, "D_P": 0.11})
C = table_values(cpp.COEFFICIENTS)
EXACT, SMOOTH = Exact(), Smooth.for_length(P.L)
UNIT = P.rho * P.D_P**4


def published(u: float, n: float, degrees: float) -> tuple[float, float]:
    """K_X and K_Y of the source, branch by branch, for n > 0."""
    J, above = u / (n * P.D_P), degrees - 10.0
    J_x0 = 0.7 * np.pi * np.tan(np.radians(above))
    alpha = 0.6 / (0.7 * np.pi * np.tan(np.radians(30.0)))
    X_1, X_0 = alpha * J_x0, 0.4 * above / 30.0
    if above > 0:
        if J <= -0.5:
            K_X = -alpha * J + X_0 - alpha * 0.5
        elif J <= 0:
            K_X = (X_1 - X_0) * J / 0.5 + X_1
        else:
            K_X = -alpha * (J - J_x0)
        return K_X, 0.0
    if J >= 0.5:
        K_X = -alpha * J + X_0 + alpha * 0.5
    elif J > 0:
        K_X = -(X_1 - X_0) * J / 0.5 + X_1
    else:
        K_X = -alpha * (J - J_x0)
    return K_X, 0.178 * (above / 30.0) ** 2


def force(u: float, n: float, degrees: float, s: Exact | Smooth = EXACT) -> np.ndarray:
    return xyn(cpp.force(Flow(u=u, v=0.0, r=0.0, n=n, pitch=np.radians(degrees)), P, C, s))


@settings(max_examples=300, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(1.0, 15.0), st.floats(-20.0, 40.0))
def test_exact_force_is_the_published_one(u: float, n: float, degrees: float) -> None:
    K_X, K_Y = published(u, n, degrees)
    expected = UNIT * n * n * np.array([K_X, K_Y, -0.5 * P.L * K_Y])
    np.testing.assert_allclose(force(u, n, degrees), expected, rtol=1e-9, atol=1e-9)


@settings(max_examples=300, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(3.0, 15.0), st.floats(-20.0, 40.0))
def test_smooth_force_is_close_to_the_exact_one(u: float, n: float, degrees: float) -> None:
    """Measured 0.0024 in K_X at the kinks, 1e-4 in K_Y; within 2.5 deg of zero thrust the two laws blend."""
    if abs(degrees - 10.0) < 2.5:
        return
    difference = (force(u, n, degrees, SMOOTH) - force(u, n, degrees)) / (UNIT * n * n)
    assert abs(difference[0]) < 0.003
    assert abs(difference[1]) < 2e-4


def test_full_pitch_at_rest_and_zero_thrust() -> None:
    K = UNIT * 100.0
    assert force(0.0, 10.0, 40.0)[0] == pytest.approx(0.6 * K)
    assert force(0.0, 10.0, 10.0)[0] == pytest.approx(0.0, abs=1e-12)
    J_x0 = 0.7 * np.pi * np.tan(np.radians(15.0))
    assert force(J_x0 * 10.0 * P.D_P, 10.0, 25.0)[0] == pytest.approx(0.0, abs=1e-9)
    assert force(0.0, 10.0, -20.0)[0] == pytest.approx(-0.6 * K)
    assert force(0.0, 10.0, -20.0)[1] == pytest.approx(0.178 * K)
    assert force(0.0, 10.0, -20.0)[2] == pytest.approx(-0.5 * P.L * 0.178 * K)


@pytest.mark.parametrize("s", [EXACT, SMOOTH])
def test_reversed_revolutions_give_the_mirrored_surge_force(s: Exact | Smooth) -> None:
    for u, degrees in ((0.3, 25.0), (-0.4, 30.0), (0.3, -10.0), (0.0, 40.0)):
        assert force(-u, -8.0, degrees, s)[0] == pytest.approx(-force(u, 8.0, degrees, s)[0], rel=1e-9)


@pytest.mark.parametrize("s", [EXACT, SMOOTH])
def test_a_stopped_propeller_gives_no_force(s: Exact | Smooth) -> None:
    for u in (-0.5, 0.0, 0.5):
        np.testing.assert_allclose(force(u, 0.0, 30.0, s), 0.0, atol=1e-12)


def test_slipstream_holds_open_water_thrust() -> None:
    got = cpp.force(Flow(u=0.3, v=0.0, r=0.0, n=10.0, pitch=np.radians(30)), P, C, EXACT)
    assert got.slipstream is not None
    loading = float(got.slipstream.loading)
    assert loading * (1 - C.t_P) * P.rho * P.D_P**2 == pytest.approx(xyn(got)[0])
    assert float(got.slipstream.u_P) == pytest.approx(0.3 * (1 - C.w_P0))


def test_astern_pitch_takes_the_wash_off_the_rudder() -> None:
    """The blades reverse, not the shaft: at astern pitch the water at the rudder is slowed, not sped up."""
    rudder_p = names({**vars(P), "A_R": 0.012, "aspect_ratio": 1.5, "x_R": -1.7})
    c = names({**vars(C), **vars(table_values(single.COEFFICIENTS))})

    def inflow(degrees: float) -> float:
        flow = Flow(u=0.4, v=0.0, r=0.0, n=10.0, pitch=np.radians(degrees))
        wash = cpp.force(flow, rudder_p, c, SMOOTH).slipstream
        return float(ca.DM(single.inflow(flow.with_(slipstream=wash), rudder_p, c, SMOOTH)[0]))

    assert inflow(35.0) > inflow(10.0) > inflow(-15.0)

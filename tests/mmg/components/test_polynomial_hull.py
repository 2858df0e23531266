"""The MMG hull polynomial: the published formula ahead, a continuation that takes energy elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmg.components.hull import polynomial
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact, Smoothing
from tests.support.force_numbers import (
    particulars_and_coefficients,
    smooth,
    xyn,
)

P, C = particulars_and_coefficients("kvlcc2_l7")
SMOOTH = smooth(P)

sways = st.floats(-1.0, 1.0) | st.just(0.0)
yaw_rates = st.floats(-0.5, 0.5) | st.just(0.0)
speeds = st.floats(-1.5, 1.5) | st.just(0.0)


def hull(u: float, v: float, r: float, s: Smoothing) -> np.ndarray:
    return xyn(polynomial.force(Flow(u=u, v=v, r=r), P, C, s))


def published(u: float, v: float, r: float) -> np.ndarray:
    """Yasukawa & Yoshimura (2015) as printed, u > 0."""
    U = np.hypot(u, v)
    v, r = v / U, r * P.L / U
    X = -C.R_0 + C.X_vv * v**2 + C.X_vr * v * r + C.X_rr * r**2 + C.X_vvvv * v**4
    powers = {"v": v, "r": r, "vvv": v**3, "vvr": v * v * r, "vrr": v * r * r, "rrr": r**3}
    Y, N = (sum(getattr(C, f"{letter}_{term}") * power for term, power in powers.items()) for letter in "YN")
    return 0.5 * P.rho * P.L * P.d * U**2 * np.array([X, Y, N * P.L])


@settings(max_examples=300, deadline=None)
@given(st.floats(1e-3, 2.0), sways, yaw_rates)
def test_the_exact_polynomial_is_the_published_one_ahead(u: float, v: float, r: float) -> None:
    """At every u > 0, drift angle and r'; scaled by the sum of the terms, which may cancel."""
    U = np.hypot(u, v)
    size = 0.5 * P.rho * P.L * P.d * (U + abs(v) + abs(r) * P.L) ** 3 / U * 4
    np.testing.assert_allclose(hull(u, v, r, Exact()), published(u, v, r), rtol=1e-12, atol=1e-12 * size * P.L)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.3, 1.5), st.floats(-35, 35), st.floats(-1.0, 1.0))
def test_the_smooth_polynomial_is_the_published_one_where_it_holds(U: float, degrees: float, yaw: float) -> None:
    """To 1e-3 of the largest force at |beta| <= 35 deg, |r'| <= 1 and 0.3 m/s or more (7 m); 7e-4 measured."""
    beta = np.radians(degrees)
    motion = U * np.cos(beta), -U * np.sin(beta), yaw * U / P.L
    got, expected = hull(*motion, SMOOTH), published(*motion)
    unit = 0.5 * P.rho * P.L * P.d * U**2
    assert np.abs((got - expected) / (unit, unit, unit * P.L)).max() < 1e-3 * max(C.R_0, np.abs(expected / unit).max())


@pytest.mark.parametrize("s", [Exact(), SMOOTH])
@settings(max_examples=200, deadline=None)
@given(u=speeds, v=sways, r=yaw_rates)
def test_bow_and_stern_mirror(s: Smoothing, u: float, v: float, r: float) -> None:
    """A hull symmetric fore and aft: F(-u, v, -r) = (-X, Y, -N)."""
    np.testing.assert_allclose(hull(-u, v, -r, s), hull(u, v, r, s) * (-1, 1, -1), rtol=1e-12, atol=1e-12)


def lost_power(u: float, v: float, r: float) -> float:
    """Power [W] of the hull force and of the Munk term of the equations of motion, which belongs with N_v."""
    unit = 0.5 * P.rho * P.L**2 * P.d
    return float(hull(u, v, r, SMOOTH) @ (u, v, r) + (C.m_y - C.m_x) * unit * u * v * r)


@settings(max_examples=500, deadline=None)
@given(
    st.floats(-1, 1) | st.just(0.0),
    st.floats(-1, 1) | st.just(0.0),
    st.floats(-1, 1) | st.just(0.0),
    st.sampled_from([1e-4, 1e-2, 0.1, 1.0]),
)
def test_the_hull_takes_energy_in_every_direction(a: float, b: float, c: float, size: float) -> None:
    """Ahead, astern, abeam, turning on the spot, and at a tenth of a millimetre per second."""
    u, v, r = size * a, size * b, size * c * 4 / P.L
    speed = abs(u) + abs(v) + abs(r) * P.L
    if speed > 1e-3 * size:
        assert lost_power(u, v, r) < 0
    else:
        assert lost_power(u, v, r) <= 1e-12


def test_drag_astern_is_that_ahead() -> None:
    """u|u|: X = -R_0 U^2 ahead, +R_0 U^2 astern; a plain -R_0 U^2 would drive a ship going astern."""
    drag = 0.5 * P.rho * P.L * P.d * C.R_0 * 0.5**2
    assert hull(0.5, 0, 0, SMOOTH)[0] == pytest.approx(-drag, rel=1e-3)
    assert hull(-0.5, 0, 0, SMOOTH)[0] == pytest.approx(drag, rel=1e-3)


def test_turning_on_the_spot_is_braked_without_bound_on_r() -> None:
    """At U = 0 the terms with 1/U see r' = 2 instead of infinity: N = 2 N_rrr' r|r|L^2 / 2, proportional to r^2."""
    one, two = hull(0, 0, 0.1, SMOOTH)[2], hull(0, 0, 0.2, SMOOTH)[2]
    assert one < 0
    assert two / one == pytest.approx(4, rel=0.02)
    expected = 0.5 * P.rho * P.L**2 * P.d * 2 * C.N_rrr * (0.1 * P.L) ** 2
    assert one == pytest.approx(expected, rel=0.05)

"""Frames, apparent and true wind by hand, and the rigid body in cases that can be worked out on paper."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmg.components.rigid_body import accelerations
from mmg.components.rigid_body import inertia as mass_of
from mmg.motion.flow import Force
from mmg.motion.frames import apparent_wind, body_to_earth, earth_to_body, relative_air, true_wind, wind_vector
from mmg.motion.froude import MODEL_LENGTH, force_scale, length_scale, reference_speed, state_scale, time_scale
from mmg.motion.smooth import Exact, Smooth

angles = st.floats(-10.0, 10.0)
velocities = st.floats(-5.0, 5.0)


def assert_same_angle(one: float, other: float, tolerance: float = 1e-9) -> None:
    """Equal modulo 2 pi."""
    assert abs((one - other + np.pi) % (2 * np.pi) - np.pi) < tolerance


# Wind

# true wind speed, coming-from direction, heading [deg], u, v -> apparent speed, angle off the bow [deg]
BY_HAND = {
    "northerly, stopped, heading north: from ahead": (5, 0, 0, 0, 0, 5, 0),
    "northerly, stopped, heading east: from port": (5, 0, 90, 0, 0, 5, 270),
    "northerly, stopped, heading west: from starboard": (5, 0, 270, 0, 0, 5, 90),
    "northerly, stopped, heading south: from astern": (5, 0, 180, 0, 0, 5, 180),
    "easterly, stopped, heading north: from starboard": (5, 90, 0, 0, 0, 5, 90),
    "calm, going ahead: own wind from ahead": (0, 123, 40, 3, 0, 3, 0),
    "calm, going astern: own wind from astern": (0, 123, 40, -3, 0, 3, 180),
    "calm, drifting to starboard: own wind from starboard": (0, 0, 40, 0, 2, 2, 90),
    "head wind adds": (5, 30, 30, 2, 0, 7, 0),
    "following wind takes away": (5, 210, 30, 2, 0, 3, 180),
    "beam wind at the same speed: 45 degrees off the bow": (3, 90, 0, 3, 0, 3 * 2**0.5, 45),
    "3-4-5 from port": (3, 270, 0, 4, 0, 5, 360 - np.degrees(np.arctan2(3, 4))),
}


@pytest.mark.parametrize("case", BY_HAND)
def test_apparent_wind_by_hand(case: str) -> None:
    speed, direction, heading, u, v, expected_speed, expected_degrees = BY_HAND[case]
    got = apparent_wind(speed, np.radians(direction), np.radians(heading), u, v)
    assert got[0] == pytest.approx(expected_speed, rel=1e-12)
    assert_same_angle(got[1], np.radians(expected_degrees), 1e-12)


@settings(max_examples=300, deadline=None)
@given(st.floats(0.0, 20.0), angles, angles, velocities, velocities)
def test_apparent_wind_is_the_air_that_the_force_model_sees_and_leads_back_to_the_true_one(
    speed: float, direction: float, psi: float, u: float, v: float
) -> None:
    """a = -U_A (cos, sin) of the angle it comes from; no direction is asked of a calm."""
    apparent_speed, angle = apparent_wind(speed, direction, psi, u, v)
    a = relative_air(*wind_vector(speed, direction), psi, u, v)
    by_angle = (-apparent_speed * np.cos(angle), -apparent_speed * np.sin(angle))
    np.testing.assert_allclose(a, by_angle, rtol=0, atol=1e-9)
    back_speed, back_direction = true_wind(apparent_speed, angle, psi, u, v)
    assert 0 <= angle <= 2 * np.pi and 0 <= back_direction <= 2 * np.pi
    if speed >= 0.01:
        assert back_speed == pytest.approx(speed, rel=1e-9, abs=1e-12)
        assert_same_angle(back_direction, direction, 1e-10 / speed + 1e-9)


# Frames


@pytest.mark.parametrize(
    ("degrees", "north", "east"), [(0, 1, 0), (90, 0, 1), (180, -1, 0), (270, 0, -1), (45, 2**-0.5, 2**-0.5)]
)
def test_the_bow_points_along_the_heading_and_starboard_is_to_its_right(
    degrees: float, north: float, east: float
) -> None:
    psi = np.radians(degrees)
    np.testing.assert_allclose(body_to_earth(1.0, 0.0, psi), (north, east), atol=1e-15)
    np.testing.assert_allclose(body_to_earth(0.0, 1.0, psi), (-east, north), atol=1e-15)


@settings(max_examples=200, deadline=None)
@given(velocities, velocities, angles)
def test_body_and_earth_are_inverse_and_keep_lengths(x: float, y: float, psi: float) -> None:
    there = body_to_earth(x, y, psi)
    np.testing.assert_allclose(earth_to_body(*there, psi), (x, y), atol=1e-12)
    assert np.hypot(*there) == pytest.approx(np.hypot(x, y), rel=1e-12, abs=1e-15)


# Rigid body

UNIT = 0.5 * 1000.0 * 4.0**2 * 0.25  # 1/2 rho L^2 d of the body below [kg]


def body(x_G: float) -> SimpleNamespace:
    """Particulars of a body of 500 kg, 4 m long."""
    return SimpleNamespace(rho=1000.0, L=4.0, d=0.25, m=500.0, x_G=x_G)


def masses(m_x: float = 0.0, m_y: float = 0.0, inertia: float = 600.0) -> SimpleNamespace:
    """Mass coefficients from added masses [kg] and the yaw inertia about the centre of gravity [kg m^2]."""
    return SimpleNamespace(m_x=m_x / UNIT, m_y=m_y / UNIT, I_J_z=inertia / (UNIT * 16.0))


@pytest.mark.parametrize("x_G", [0.3, 0.0, -0.2])
def test_accelerations_satisfy_the_equations_of_motion(x_G: float) -> None:
    """Yasukawa & Yoshimura (2015), Eq. 4, put back in, m_x and m_y told apart."""
    u, v, r, X, Y, N = 0.8, -0.3, 0.4, 12.0, -30.0, 25.0
    m, m_x, m_y, inertia = 500.0, 40.0, 450.0, 600.0
    du, dv, dr = accelerations(u, v, r, Force(X, Y, N), mass_of(body(x_G), masses(m_x, m_y, inertia)))
    assert (m + m_x) * du - (m + m_y) * v * r - x_G * m * r**2 == pytest.approx(X, rel=1e-12)
    assert (m + m_y) * dv + (m + m_x) * u * r + x_G * m * dr == pytest.approx(Y, rel=1e-12)
    assert (inertia + x_G**2 * m) * dr + x_G * m * (dv + u * r) == pytest.approx(N, rel=1e-12)


# Froude's law: ships of equal Froude number move alike
@pytest.mark.parametrize("length", [1.0, MODEL_LENGTH, 320.0])
def test_equal_froude_numbers_give_similar_motions_and_forces(length: float) -> None:
    lam, k = length_scale(length), time_scale(length)
    assert reference_speed(length) / reference_speed(MODEL_LENGTH) == pytest.approx(k)
    assert lam / k == pytest.approx(k)  # a length in a time is a speed
    assert force_scale(length) == pytest.approx(lam**2 * k**2)  # of a pressure on an area
    np.testing.assert_allclose(state_scale(length), [lam, lam, 1.0, k, k, 1 / k])
    np.testing.assert_array_equal(state_scale(MODEL_LENGTH), np.ones(6))  # the reference


# The smooth blends: what they are at zero and one width from it, and the branches that they become far away
S, E = Smooth(0.02), Exact()
NEAR, FAR = 0.3, 1e4


def test_at_a_distance_of_one_width_they_have_their_formula() -> None:
    w = NEAR
    assert float(S.absolute(w, w)) == pytest.approx(w / math.sqrt(2)) and float(S.absolute(0.0, w)) == 0
    assert float(S.magnitude(w, w)) == pytest.approx(w * math.sqrt(2))
    assert float(S.magnitude(0.0, w)) == pytest.approx(w)
    assert float(S.step(w, w)) == pytest.approx(1 / (1 + math.exp(-2))) and float(S.step(0.0, w)) == 0.5
    assert float(S.step_or_zero(0.0, w)) == pytest.approx(1 / (1 + math.exp(-3)))
    assert float(S.step_or_zero(-1.5 * w, w)) == pytest.approx(0.5)
    assert float(S.sign(w, w)) == pytest.approx(1 / math.sqrt(2)) and float(S.sign(0.0, w)) == 0
    assert float(S.positive(0.0, w)) == pytest.approx(w / 2)
    assert float(S.positive(w, w)) - float(S.positive(-w, w)) == pytest.approx(w)
    assert float(S.root(0.0, w)) == pytest.approx(w) and float(S.root(3 * w * w, w)) == pytest.approx(2 * w)
    assert float(S.signed_root(1e-6, w)) == pytest.approx(1e-6 / w)
    assert float(S.signed_root(w * w, w)) == pytest.approx(w / 2**0.25)
    assert float(S.divide(3.0, 0.0, w)) == pytest.approx(3 / w)
    assert float(S.divide(3.0, w, w)) == pytest.approx(3 / w / math.sqrt(2))
    assert float(S.angle(1.0, 0.0, w)) == pytest.approx(math.atan(w))
    assert float(S.angle(0.0, 5.0, w)) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("x", [-FAR, -1.0, 1.0, FAR])
def test_far_from_zero_they_are_the_branches(x: float) -> None:
    for name in ("absolute", "magnitude", "step", "step_or_zero", "sign", "positive", "signed_root"):
        smooth, exact = (float(getattr(s, name)(x, 1e-3)) for s in (S, E))
        assert smooth == pytest.approx(exact, rel=1e-5, abs=1e-5), name
    assert float(E.positive(x, 1.0)) == max(x, 0.0) and float(E.absolute(x, 1.0)) == abs(x)
    assert float(E.sign(x, 1.0)) == math.copysign(1.0, x) and float(E.step(x, 1.0)) == (x > 0)
    assert float(E.signed_root(x, 1.0)) == pytest.approx(math.copysign(math.sqrt(abs(x)), x))
    assert float(E.angle(x, -2.0, 1.0)) == pytest.approx(abs(math.atan2(-2.0, x)))
    assert float(E.angle(x, 2.0, 1.0)) == pytest.approx(float(S.angle(x, 2.0, 1e-6)))


def test_the_branches_at_zero() -> None:
    assert (float(E.step(0.0, 1.0)), float(E.step_or_zero(0.0, 1.0)), float(E.divide(2.0, 0.0, 1.0))) == (0, 1, 0)
    assert float(E.step(-1.0, 1.0)) == 0 == float(E.step_or_zero(-1.0, 1.0))
    assert float(E.divide(2.0, 4.0, 1.0)) == 0.5 and float(E.root(9.0, 1.0)) == 3
    assert 0 < float(E.magnitude(0.0, 1.0)) < 1e-200


def test_widths_grow_with_the_speed_of_the_ship() -> None:
    """By Froude: 10 mm/s for a model of 3 m, ten times that for a ship a hundred times as long."""
    assert Smooth.for_length(3.0).speed == pytest.approx(0.01)
    assert Smooth.for_length(300.0).speed == pytest.approx(0.1)

"""VecTwin ship of 3 m: check values of propeller and rudders (Kang et al. 2008), hovering, the section, all quadrants.

The check values come from running the public simulator with x_H' put right and its sign of x_P'.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.shipfiles.ship_file import load_ship
from mmg.components.propeller import kang
from mmg.components.rudder import vectwin
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Exact, Smooth
from tests.support.force_numbers import number, particulars_and_coefficients, xyn

SHIP = load_ship("vectwin_3m")
P, C = particulars_and_coefficients("vectwin_3m")
PUBLISHED = SimpleNamespace(**{**vars(C), "x_P": 0.498})
EXACT, SMOOTH = Exact(), Smooth.for_length(P.L)

ROWS = (
    # u, v, r, n, starboard, port [deg] -> X_P, X_R, Y_R, N_R
    ((0.3, 0.0, 0.0, 10, 0, 0), (1.9915, None, -0.1557, 0.2233)),
    ((0.3, 0.0, 0.0, 10, 20, 20), (1.9915, -0.6074, -2.2880, 3.2810)),
    ((0.3, -0.04, 0.03, 10, 35, 20), (1.9905, -0.8819, -2.1231, 3.0446)),
    ((0.0, 0.0, 0.0, 10, 75, -75), (2.7996, -2.5093, 0.0621, None)),
    ((0.0, 0.0, 0.0, 10, 105, -105), (None, -3.0529, None, None)),
)
SMOOTH_TOLERANCE = (2.5e-4, 4e-4, 8e-3, 4e-2, 5e-3)
"""Largest deviation [N, N m] per row (measured 1.6e-4, 2.9e-4, 6.8e-3, 3.7e-2, 4.3e-3). Row 3 has the starboard rudder
at 34.9 deg, inside the blend of the stall at 37.5 deg; row 4 lies on the jump of 1 - t_P at u = 0 (X_P -1.3 %)."""


def flow(u: float, v: float, r: float, n: float, starboard: float, port: float) -> Flow:
    return Flow(u=u, v=v, r=r, n=n, delta_starboard=np.radians(starboard), delta_port=np.radians(port))


def forces(motion: Flow, c: SimpleNamespace, s: Exact | Smooth) -> tuple[Force, Force]:
    push = kang.force(motion, P, c, s)
    return push, vectwin.force(motion.with_(slipstream=push.slipstream), P, c, s)


@pytest.mark.parametrize("row", range(5))
@pytest.mark.parametrize("exact", [True, False])
def test_check_values(row: int, exact: bool) -> None:
    motion, printed = ROWS[row]
    push, rudders = forces(flow(*motion), PUBLISHED, EXACT if exact else SMOOTH)
    got = (xyn(push)[0], *xyn(rudders))
    tolerance = 0.51e-4 if exact else SMOOTH_TOLERANCE[row]
    for value, expected in zip(got, printed, strict=True):
        assert expected is None or value == pytest.approx(expected, abs=tolerance)


def test_check_values_of_wake_advance_and_angles() -> None:
    motion = flow(*ROWS[1][0])
    push = kang.force(motion, P, PUBLISHED, EXACT)
    wash = push.slipstream
    assert wash is not None
    assert number(wash.one_minus_w) == pytest.approx(0.6184, abs=0.51e-4)
    nD = 10 * P.D_P
    assert number(kang.advance_ratio(wash.u_P, nD, EXACT)) == pytest.approx(0.1853, abs=0.51e-4)
    assert number(wash.loading) / nD**2 == pytest.approx(0.2459, abs=0.51e-4)
    for port, printed in ((False, 23.53), (True, 14.56)):
        u_R, v_R, angle = map(number, vectwin.inflow(motion.with_(slipstream=wash), port, P, PUBLISHED, EXACT))
        assert np.degrees(angle - np.arctan2(v_R, u_R)) == pytest.approx(printed, abs=0.51e-2)


def test_sign_of_x_P_matters_in_a_turn() -> None:
    """By the geometry the propeller in a turn sees the swinging stern: less wake, 10 % more thrust in row 3."""
    motion = flow(*ROWS[2][0])
    one, other = (xyn(kang.force(motion, P, c, EXACT))[0] for c in (C, PUBLISHED))
    assert one / other == pytest.approx(1.1045, abs=1e-3)


# Hovering


def surge(angle: float, s: Exact | Smooth) -> float:
    """Net surge force [N] at rest with both rudders outwards by this angle [deg], n = 10."""
    push, rudders = forces(flow(0, 0, 0, 10, angle, -angle), C, s)
    return float(xyn(push)[0] + xyn(rudders)[0])


@pytest.mark.parametrize("s", [EXACT, SMOOTH])
def test_outward_rudders_hold_the_ship_and_drive_it_astern(s: Exact | Smooth) -> None:
    """Net surge by the thrust of 2.8 N: +10 % at 75 deg, zero at 78, least (-19 %) at 86, -9 % at 105 deg."""
    thrust = surge(0.0, s)
    assert thrust > 2.7
    assert 0.05 * thrust < surge(75.0, s) < 0.12 * thrust
    assert abs(surge(78.0, s)) < 0.02 * thrust
    assert -0.21 * thrust < surge(86.0, s) < surge(90.0, s)
    assert surge(105.0, s) < -0.05 * thrust
    assert surge(77.0, s) > 0 > surge(79.0, s)


# Normal force of the section


def normal(angle: float, s: Exact | Smooth) -> float:
    return number(vectwin.normal_coefficient(np.sin(angle), np.cos(angle), s))


def test_normal_coefficient_is_continuous_all_round_and_vanishes_from_behind() -> None:
    """Smooth: no step larger than its steepest slope allows; exact: the published step of 0.028 only."""
    angle = np.linspace(-np.pi, np.pi, 2001)
    smooth, exact = (np.array([normal(a, s) for a in angle]) for s in (SMOOTH, EXACT))
    assert abs(smooth[0]) < 1e-9 and abs(smooth[1000]) < 1e-9
    assert np.abs(np.diff(smooth)).max() < 3.5 * (angle[1] - angle[0])
    steps = np.abs(np.diff(exact)) - 2.7 * (angle[1] - angle[0])
    assert (steps > 0).sum() == 2 and 0.01 < steps.max() < 0.03
    assert np.abs(smooth - exact).max() < 0.02
    assert (np.sign(exact[np.abs(exact) > 1e-9]) == np.sign(np.sin(angle[np.abs(exact) > 1e-9]))).all()


# Where the source ends


def test_no_force_with_sternway_as_published_is_k_A_zero() -> None:
    motion = flow(-0.1, 0.02, 0.01, 10, 40, -30)
    published = SimpleNamespace(**{**vars(C), "k_A": 0.0})
    np.testing.assert_array_equal(xyn(forces(motion, published, EXACT)[1]), 0.0)
    assert np.abs(xyn(forces(motion, C, EXACT)[1])).min() > 1e-2


@pytest.mark.parametrize("s", [EXACT, SMOOTH])
def test_rudders_of_a_stopped_ship_work_the_other_way_astern(s: Exact | Smooth) -> None:
    """n = 0: deflected rudders push the stern to port with headway and to starboard with sternway, and brake."""
    for u in (0.3, -0.3):
        X, Y, _ = xyn(forces(flow(u, 0, 0, 0, 30, 30), C, s)[1])
        assert X * u < -1e-3 and Y * u < -1e-3


def test_sternway_does_not_switch_off_the_hovering_rudders() -> None:
    still, astern = (xyn(forces(flow(u, 0, 0, 10, 80, -80), C, SMOOTH)[1])[0] for u in (0.0, -0.05))
    assert 0.75 * still > astern > still


@pytest.mark.parametrize("s", [EXACT, SMOOTH])
def test_propeller_in_every_quadrant(s: Exact | Smooth) -> None:
    """Reversed it pushes astern, by k_rev at rest; stopped it is a brake."""
    ahead, astern = (xyn(kang.force(flow(0, 0, 0, n, 0, 0), P, C, s))[0] for n in (10, -10))
    assert ahead > 2.7 and astern == pytest.approx(-C.k_rev * 2.7996, rel=0.03)
    for u in (-0.3, 0.3):
        assert xyn(kang.force(flow(u, 0, 0, -10, 0, 0), P, C, s))[0] < 0
        assert xyn(kang.force(flow(u, 0, 0, 0, 0, 0), P, C, s))[0] * u < 0


def advance(speed: float, nD: float, s: Exact | Smooth) -> float:
    return number(kang.advance_ratio(speed, nD, s))


@pytest.mark.parametrize(
    ("speed", "nD", "loss"),
    [(0.3, 1.0, 2.5e-4), (0.3, -1.0, 2.5e-4), (-0.48, 0.8, 4e-3), (0.0, 1.0, 0.0), (0.9, 1.0, 0.017)],
)
def test_advance_ratio(speed: float, nD: float, loss: float) -> None:
    """Exact as it is; smooth a little below it in the range of use."""
    assert advance(speed, nD, EXACT) == pytest.approx(speed / nD, rel=1e-12)
    assert advance(speed, nD, SMOOTH) == pytest.approx(speed / nD, rel=loss)
    assert abs(advance(speed, nD, SMOOTH)) <= abs(speed / nD)


def test_smooth_advance_ratio_is_limited_and_vanishes_at_rest() -> None:
    nD = np.linspace(-1, 1, 401)
    largest = max(advance(0.5, x, SMOOTH) for x in nD)
    assert largest == pytest.approx(kang.LIMIT, rel=2e-3)
    assert min(advance(0.5, x, SMOOTH) for x in nD) == pytest.approx(-kang.LIMIT, rel=2e-3)
    for s in (EXACT, SMOOTH):
        assert advance(0.5, 0.0, s) == advance(0.0, 0.0, s) == 0.0


outward = st.floats(-35.0, 105.0)


# Blades


@settings(max_examples=50, deadline=None)
@given(st.floats(-0.4, 0.5), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), outward, outward)
def test_the_rudders_are_two_blades(u: float, v: float, r: float, one: float, two: float) -> None:
    _, rudders = forces(flow(u, v, r, 10, one, -two), C, SMOOTH)
    assert len(rudders.blades) == 2
    total = sum(xyn(Force(b.X, b.Y, b.N)) for b in rudders.blades)
    np.testing.assert_allclose(total, xyn(rudders), rtol=1e-12, atol=1e-12)
    assert all(0 <= number(b.sin2_alpha) <= 1 for b in rudders.blades)
    without = forces(flow(u, v, r, 10, one, -two), SimpleNamespace(**{**vars(C), "k_N": 0.0}), SMOOTH)[1]
    np.testing.assert_array_equal(xyn(without), 0.0)


def test_sine_of_the_angle_of_attack_belongs_to_its_blade() -> None:
    motion = flow(0.3, 0, 0, 10, 20, 20)
    for blade, degrees in zip(forces(motion, C, EXACT)[1].blades, (23.53, 14.56), strict=True):
        assert number(blade.sin2_alpha) == pytest.approx(np.sin(np.radians(degrees)) ** 2, abs=2e-4)


# The ship


def test_defaults_of_the_models_are_the_values_of_the_file() -> None:
    """The models carry the only published set; what a file leaves out is not something else."""
    assert SHIP.actuators == ("n", "delta_port", "delta_starboard", "n_bow")
    for row in (*kang.COEFFICIENTS, *vectwin.COEFFICIENTS):
        assert SHIP.coefficients[row.symbol].value == row.value
        assert SHIP.coefficients[row.symbol].fixed == row.fixed

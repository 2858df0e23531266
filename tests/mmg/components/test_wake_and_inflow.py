"""Limiting cases of the forces: straight course, windmilling, reversed propeller, cross-flow, rudder inflow."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from mmg.components.hull.unified import cross_flow
from mmg.components.propeller import hachii, wake
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact, Smooth, Smoothing
from mmg.ship import Ship
from tests.support.force_numbers import number, particulars_and_coefficients

P, C = particulars_and_coefficients("esso_osaka_3m")
speeds = st.floats(-0.5, 0.5) | st.just(0.0)
sways = st.floats(-0.3, 0.3) | st.just(0.0)
yaw_rates = st.floats(-0.2, 0.2) | st.just(0.0)


def flow(u: float = 0.0, v: float = 0.0, r: float = 0.0, n: float = 0.0) -> Flow:
    return Flow(u=u, v=v, r=r, n=n)


# Wake and windmilling


@settings(max_examples=200, deadline=None)
@given(speeds, sways, yaw_rates, st.booleans())
def test_wake_stays_between_none_and_all(u: float, v: float, r: float, exact: bool) -> None:
    found = number(hachii.wake(flow(u=u, v=v, r=r), P, C, Exact() if exact else Smooth()))
    assert 0 <= found <= 1 + 3e-5  # the rounded clip exceeds 1 by at most width^2 / 4


@pytest.mark.parametrize("tau_a", [0.0, -0.3])
@pytest.mark.parametrize("side", [1, -1])
def test_wake_is_the_hirano_formula_in_an_oblique_flow(side: int, tau_a: float) -> None:
    u, v, r, c = 0.3, -0.05 * side, 0.01 * side, SimpleNamespace(**{**vars(C), "tau_a": tau_a})
    inflow = (v + c.x_P * P.L * r) / np.hypot(u, v)
    by_hand = 1 - (c.w_P0 - c.tau * abs(inflow) - tau_a * inflow - c.C_P * inflow**2)
    assert 0 < by_hand < 1
    assert number(hachii.wake(flow(u=u, v=v, r=r), P, c, Exact())) == pytest.approx(by_hand, rel=1e-12)


def test_both_wakes_of_a_single_screw_differ_by_the_side_of_the_flow_alike() -> None:
    """The slopes of Yasukawa & Yoshimura (2015) at small angles, (1 - w_P0) C_1 (C_2 - 1), are tau -+ tau_a."""
    p, published = particulars_and_coefficients("kvlcc2_full")
    slopes = [(1 - published.w_P0) * published.C_1 * (x - 1) for x in (published.C_2_plus, published.C_2_minus)]
    rows = {"tau": sum(slopes) / 2, "tau_a": (slopes[1] - slopes[0]) / 2, "C_P": 0.0}
    c = SimpleNamespace(**{**vars(published), **rows})
    for v in (-0.005, 0.005):
        own, other = (number(f(flow(u=1.0, v=v), p, c, Exact())) for f in (wake.hirano, wake.yasukawa_2015))
        assert own - 1 + c.w_P0 == pytest.approx(other - 1 + c.w_P0, rel=0.01)


@pytest.mark.parametrize("u", [0.1, 0.3, 0.5])
@pytest.mark.parametrize(("smoothing", "tolerance"), [(Exact(), 1e-12), (Smooth(), 0.05)])
def test_a_stopped_propeller_windmills_with_the_last_term_of_K_T(
    u: float, smoothing: Smoothing, tolerance: float
) -> None:
    """n = 0 counts as ahead; X_P = (1 - t_P) rho D^2 k_2 u_P^2 < 0.

    Smooth: 4.7 % less, as n = 0 is 1.5 widths inside the blend to the reversed branch, which is zero there.
    """
    force = hachii.force(flow(u=u), P, C, smoothing)
    by_hand = (1 - C.t_P) * P.rho * P.D_P**2 * C.k_2 * (u * (1 - C.w_P0)) ** 2
    assert by_hand < 0
    assert number(force.X) == pytest.approx(by_hand, rel=tolerance)
    assert number(force.Y) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("smoothing", [Exact(), Smooth()])
def test_thrust_changes_sign_where_K_T_does(smoothing: Smoothing) -> None:
    """J_0 = 0.72 for this propeller: thrust at higher revolutions, a brake at lower ones."""
    discriminant = np.sqrt(C.k_1**2 - 4 * C.k_0 * C.k_2)
    J_0 = (-C.k_1 - discriminant) / (2 * C.k_2)
    n_0 = 0.3 * (1 - C.w_P0) / (J_0 * P.D_P)
    assert 0.5 < J_0 < 1.0
    assert number(hachii.force(flow(u=0.3, n=1.02 * n_0), P, C, smoothing).X) > 0
    assert number(hachii.force(flow(u=0.3, n=0.98 * n_0), P, C, smoothing).X) < 0


@pytest.mark.parametrize(
    ("advance", "A", "B"),
    [
        (0.3, lambda J: C.A_5, lambda J: C.B_5),
        (0.0, lambda J: C.A_5, lambda J: C.B_5),
        (-0.2, lambda J: C.A_1 + C.A_2 * J, lambda J: C.B_1 + C.B_2 * J),
        (-0.5, lambda J: C.A_3 + C.A_4 * J, lambda J: C.B_3 + C.B_4 * J),
    ],
)
@pytest.mark.parametrize(("smoothing", "tolerance"), [(Exact(), 1e-12), (Smooth(), 3e-3)])
def test_side_force_of_the_reversing_propeller_on_each_branch(
    advance: float, A, B, smoothing: Smoothing, tolerance: float
) -> None:
    """Hachii (2004). Smooth: 2.2e-3 at J_s = 0, three blends of 0.02 from the branch point; else 4e-7."""
    n = -10.0
    force = hachii.force(flow(u=advance * n * P.D_P, n=n), P, C, smoothing)
    unit = 0.5 * P.rho * P.L * P.d * (n * P.D_P) ** 2
    assert number(force.Y) == pytest.approx(unit * A(advance), rel=tolerance)
    assert number(force.N) == pytest.approx(unit * P.L * B(advance), rel=tolerance)


@pytest.mark.parametrize("advance", [-0.06, -0.233, -0.35])
def test_the_branches_of_the_reversing_propeller_meet(advance: float) -> None:
    """To 0.1 % of the force there, as the published constants are rounded (0.4 % for the thrust at C_10)."""
    n = -10.0
    below, above = (hachii.force(flow(u=J * n * P.D_P, n=n), P, C, Exact()) for J in (advance - 1e-9, advance + 1e-9))
    assert number(above.X) == pytest.approx(number(below.X), rel=4e-3)
    assert number(above.Y) == pytest.approx(number(below.Y), rel=1e-3)
    assert number(above.N) == pytest.approx(number(below.N), rel=1e-3)


# Cross-flow integrals


def integrals_by_quadrature(a: float, b: float) -> tuple[float, float]:
    kink = [-a / b] if b and abs(a / b) < 0.5 else None

    def sway(xi: float) -> float:
        return abs(a + b * xi) * (a + b * xi)

    return (
        quad(sway, -0.5, 0.5, points=kink, epsabs=1e-14)[0],
        quad(lambda xi: sway(xi) * xi, -0.5, 0.5, points=kink, epsabs=1e-14)[0],
    )


@settings(max_examples=200, deadline=None)
@given(sways, st.floats(-1.0, 1.0) | st.just(0.0))
def test_cross_flow_is_the_integral_to_the_square_of_the_width(a: float, b: float) -> None:
    """As it vanishes, and at the 1 mm/s of the model (7e-8 measured); the integrals are of order 1e-2."""
    expected = integrals_by_quadrature(a, b)
    for width, rtol, atol in ((1e-7, 1e-7, 1e-12), (1e-3, 0, 1e-6)):
        found = [float(x) for x in cross_flow(ca.DM(a), ca.DM(b), width)]
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=atol)


def pods() -> Ship:
    sizes = {"L": 33.9, "B": 9.6, "d": 2.7, "C_b": 0.604, "U_0": 5.4, "D_az": 1.9, "x_az": -14.6, "y_az": 0.0}
    return new_ship("pods", sizes).with_values(k_N_az=1.0)


@pytest.mark.parametrize("ship", ["esso_osaka_3m", "kvlcc2_l7", "vectwin_3m", "pods"])
def test_forces_have_no_corner_where_the_thrust_changes_its_sign(ship: str) -> None:
    """A corner's second difference grows tenfold where the step is a tenth; a fit does not converge at one."""
    model = pods() if ship == "pods" else load_ship(ship)
    L, D = model.particulars["L"], model.particulars.get("D_P") or model.particulars["D_az"]
    U = 0.15 * (9.81 * L) ** 0.5
    bends = []
    for step in (1e-3, 1e-4):
        u = U * np.arange(0.3, 2.5, step)  # at n D = U, so that J passes the one of zero thrust
        states = np.zeros((6, len(u)))
        states[3], states[4], states[5] = u, 0.1 * U, 0.2 * U / L
        controls = {name: np.full(len(u), U / D if name.startswith("n") else 0.3) for name in model.actuators}
        rates = np.asarray(model.rhs(states, controls))[3:6]
        bends.append(np.abs(np.diff(rates, 2, axis=1)).max(axis=1) / step**2)
    np.testing.assert_array_less(bends[1], 1.5 * bends[0])

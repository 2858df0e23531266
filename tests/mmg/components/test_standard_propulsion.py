"""Standard propeller and rudder: wakes, thrust in four quadrants, flow straightening, stall, limiting cases."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mmg.components.catalogue import module
from mmg.components.coefficients import names
from mmg.components.propeller import hachii, standard, wake
from mmg.components.rudder import inflow, lindenburg
from mmg.components.rudder import standard as rudder
from mmg.motion.flow import Flow, Force, Slipstream
from mmg.motion.frames import drift_angle
from mmg.motion.smooth import Exact, Smoothing
from tests.support.force_numbers import defaults, number, particulars_and_coefficients, smooth, xyn

P, C = particulars_and_coefficients("kvlcc2_l7")
SMOOTH = smooth(P)
PROPELLERS = ("standard", "standard_kijima", "standard_hirano")
RUDDERS = ("standard", "lindenburg", "single")
WAKES = {"yasukawa_2015": wake.yasukawa_2015, "kijima": wake.kijima, "hirano": wake.hirano}

# Coefficients of all three propellers and rudders at once, those of KVLCC2 where it has them.
MODELS = [("propeller", name) for name in PROPELLERS] + [("rudder", name) for name in RUDDERS]
ALL = names({s: value for model in MODELS for s, value in defaults(*model, P).items()} | vars(C))


def washed(flow: Flow, c: SimpleNamespace, s: Smoothing) -> Flow:
    """The flow behind the standard propeller."""
    return flow.with_(slipstream=standard.force(flow, P, c, s).slipstream)


# Wake


@pytest.mark.parametrize("name", WAKES)
@pytest.mark.parametrize("u", [0.3, 0.7, 1.2])
@pytest.mark.parametrize("s", [Exact(), SMOOTH])
def test_the_wake_straight_ahead_is_w_P0(name: str, u: float, s: Smoothing) -> None:
    """Exactly, smoothed or not; the clip of the Hirano type costs 6e-5."""
    got = number(WAKES[name](Flow(u=u, v=0.0, r=0.0), P, ALL, s))
    assert got == pytest.approx(1 - C.w_P0, rel=2e-4 if name == "hirano" and s is SMOOTH else 1e-14)


@pytest.mark.parametrize("name", WAKES)
@pytest.mark.parametrize(("u", "v"), [(-0.3, 0.0), (-0.5, 0.2)])
@pytest.mark.parametrize("s", [Exact(), SMOOTH])
def test_there_is_no_wake_astern(name: str, u: float, v: float, s: Smoothing) -> None:
    assert number(WAKES[name](Flow(u=u, v=v, r=0.05), P, ALL, s)) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("v", "r", "C_2"), [(-0.2, 0.05, 1.6), (0.2, -0.05, 1.1), (0.0, 0.08, 1.6), (0.1, 0.0, 1.1)])
@pytest.mark.parametrize(("s", "tolerance"), [(Exact(), 1e-12), (SMOOTH, 2e-3)])
def test_the_wake_of_2015_takes_C_2_by_the_side_of_the_flow(
    v: float, r: float, C_2: float, s: Smoothing, tolerance: float
) -> None:
    """(1 - w_P)/(1 - w_P0) = 1 + [1 - exp(-C_1 |beta_P|)] (C_2 - 1) by hand; beta_P > 0 takes C_2_plus."""
    u = 0.9
    beta_P = np.arctan2(-v, u) + 0.48 * r * P.L / np.hypot(u, v)
    assert (beta_P > 0) == (C_2 == 1.6)
    by_hand = (1 - C.w_P0) * (1 + (1 - np.exp(-C.C_1 * abs(beta_P))) * (C_2 - 1))
    assert number(wake.yasukawa_2015(Flow(u=u, v=v, r=r), P, C, s)) == pytest.approx(by_hand, rel=tolerance)


@pytest.mark.parametrize(("s", "tolerance"), [(Exact(), 1e-12), (SMOOTH, 5e-4)])
def test_kijimas_wake_by_hand(s: Smoothing, tolerance: float) -> None:
    u, v, r = 0.9, -0.2, 0.04
    beta_P = np.arctan2(-v, u) + 0.48 * r * P.L / np.hypot(u, v)
    by_hand = 1 - C.w_P0 * np.exp(-4 * beta_P**2)
    assert 1 - C.w_P0 < by_hand - 0.05
    assert number(wake.kijima(Flow(u=u, v=v, r=r), P, C, s)) == pytest.approx(by_hand, rel=tolerance)


def test_hachii_has_the_hirano_wake() -> None:
    assert hachii.wake is wake.hirano


@pytest.mark.parametrize("u", [-0.5, 0.5])
def test_the_drift_angle_is_acute_and_defined_at_rest(u: float) -> None:
    """-v = U sin(beta) ahead and astern; zero at rest, and 90 degrees abeam."""
    v = -0.3
    beta = number(drift_angle(u, v, Exact()))
    assert np.hypot(u, v) * np.sin(beta) == pytest.approx(-v, rel=1e-12)
    assert number(drift_angle(0.0, v, Exact())) == pytest.approx(np.pi / 2)
    for s in (Exact(), SMOOTH):
        assert number(drift_angle(0.0, 0.0, s)) == 0.0


# Thrust


def by_quadrant(u: float, n: float) -> float:
    """X_P [N] of the standard propeller straight ahead or astern, from K_T(J) (Yasukawa 2008)."""
    one_minus_w = 1 - C.w_P0 if u > 0 else 1.0
    J = u * one_minus_w / (n * P.D_P)

    def polynomial(x: float) -> float:
        return C.k_0 + C.k_1 * x + C.k_2 * x * x

    K_T = polynomial(J)
    if J <= -0.5:
        K_T = 1.5 * (C.k_1 * (J + 0.5) - C.k_2 * (J + 0.5) ** 2) + polynomial(-0.5)
    factor = 1 - C.t_P if n > 0 else 0.4811 * 0.721**2 - 1.1116 * 0.721 - 0.1404
    return float(factor * P.rho * n**2 * P.D_P**4 * K_T)


@pytest.mark.parametrize("n", [12.0, 4.0, -4.0, -12.0])
@pytest.mark.parametrize("u", [1.2, 0.5, 0.0, -0.2, -0.6, -1.2])
@pytest.mark.parametrize(("s", "tolerance"), [(Exact(), 1e-6), (SMOOTH, 5e-3)])
def test_thrust_in_four_quadrants_is_K_T_of_J(u: float, n: float, s: Smoothing, tolerance: float) -> None:
    """Both branches, both directions of rotation; 1e-6 is the rounding of beta_t in the ship file."""
    X = xyn(standard.force(Flow(u=u, v=0.0, r=0.0, n=n), P, C, s))
    expected = by_quadrant(u, n)
    scale = P.rho * (n * P.D_P) ** 2 * P.D_P**2 * 0.05
    assert X[0] == pytest.approx(expected, rel=tolerance, abs=tolerance * scale)
    assert X[1] == X[2] == 0.0


@pytest.mark.parametrize("n", [10.0, -10.0])
def test_the_branches_meet_at_J_min(n: float) -> None:
    u = -0.5 * n * P.D_P / (1 - C.w_P0 if n < 0 else 1.0)
    low, high = (xyn(standard.force(Flow(u=u * f, v=0.0, r=0.0, n=n), P, C, Exact()))[0] for f in (1 - 1e-9, 1 + 1e-9))
    assert low == pytest.approx(high, rel=1e-7)


@pytest.mark.parametrize("u", [0.5, 1.2, -0.5, -1.2])
@pytest.mark.parametrize("s", [Exact(), SMOOTH])
def test_a_stopped_propeller_is_a_brake_both_ways(u: float, s: Smoothing) -> None:
    """(1 - t_P) rho D^2 k_2 u_P^2 ahead, -(1 - t_P) rho D^2 alpha_p k_2 u^2 astern; blend to n < 0: 3 %."""
    X = xyn(standard.force(Flow(u=u, v=0.0, r=0.0, n=0.0), P, C, s))[0]
    k = C.k_2 * (1 - C.w_P0) ** 2 if u > 0 else -C.alpha_p * C.k_2
    assert X * u < 0
    assert pytest.approx((1 - C.t_P) * P.rho * P.D_P**2 * k * u * u, rel=1e-12 if s is not SMOOTH else 0.03) == X


def test_pitch_ratio_sets_the_reversed_thrust() -> None:
    assert standard.reversal(0.7151) == pytest.approx(-0.6893, abs=5e-5)
    for ratio in (0.6, 0.9):
        p = names({**vars(P), "pitch_ratio": ratio})
        assert defaults("propeller", "standard", p)["beta_t"] == standard.reversal(ratio)


def test_the_slipstream_holds_what_the_rudder_needs() -> None:
    flow = Flow(u=1.0, v=-0.1, r=0.05, n=10.0)
    push = standard.force(flow, P, C, Exact())
    wash = push.slipstream
    assert isinstance(wash, Slipstream)
    assert number(wash.u_P) == pytest.approx(number(wash.one_minus_w), rel=1e-15)
    assert number(push.X) == pytest.approx((1 - C.t_P) * P.rho * P.D_P**2 * number(wash.loading), rel=1e-12)
    assert number(wash.ahead) == 1.0
    assert number(standard.force(flow.with_(n=-10.0), P, C, Exact()).slipstream.ahead) == 0.0


# Standard rudders: flow straightening, normal force, stall, the single blade, limiting cases
@pytest.mark.parametrize(("v", "r", "gamma"), [(-0.2, 0.05, 0.640), (0.2, -0.05, 0.395), (0.1, 0.0, 0.395)])
@pytest.mark.parametrize(("s", "tolerance"), [(Exact(), 1e-12), (SMOOTH, 1e-3)])
def test_flow_straightening_by_the_sign_of_beta_R(
    v: float, r: float, gamma: float, s: Smoothing, tolerance: float
) -> None:
    """v_R = U gamma_R (beta - ell_R' r'), with the angle itself, not its sine."""
    u = 0.9
    U = np.hypot(u, v)
    beta_R = np.arctan2(-v, u) + 0.710 * r * P.L / U
    assert (beta_R > 0) == (gamma == 0.640)
    flow = washed(Flow(u=u, v=v, r=r, n=10.0), C, s)
    assert number(rudder.inflow(flow, P, C, s)[1]) == pytest.approx(U * gamma * beta_R, rel=tolerance)


@pytest.mark.parametrize("u", [-0.4, -0.1])
@pytest.mark.parametrize("v", [-0.1, 0.1])
def test_astern_the_rudder_moves_through_the_water_as_the_stern_does(u: float, v: float) -> None:
    """v_R has the sign of -v, u_R = u: the water comes from aft and from the side to which the stern moves."""
    flow = washed(Flow(u=u, v=v, r=0.0, n=-8.0), C, Exact())
    u_R, v_R = (number(part) for part in rudder.inflow(flow, P, C, Exact()))
    assert u_R == u
    assert v_R * v < 0 and abs(v_R) < abs(v) * np.pi / 2


@pytest.mark.parametrize("name", RUDDERS)
def test_a_rudder_without_a_slipstream_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="slipstream"):
        module("rudder", name).force(Flow(u=0.3, v=0.0, r=0.0), P, ALL, Exact())


def test_f_alpha_defaults_to_fujii() -> None:
    assert defaults("rudder", "standard", P)["f_alpha"] == pytest.approx(
        6.13 * P.aspect_ratio / (P.aspect_ratio + 2.25)
    )
    assert inflow.fujii(1.539) == pytest.approx(2.4899, abs=1e-4)


@pytest.mark.parametrize("name", RUDDERS)
@pytest.mark.parametrize("s", [Exact(), SMOOTH])
def test_the_single_blade_is_the_whole_force(name: str, s: Smoothing) -> None:
    flow = washed(Flow(u=0.9, v=-0.2, r=0.03, n=10.0, delta=0.4), ALL, s)
    force = module("rudder", name).force(flow, P, ALL, s)
    assert len(force.blades) == 1
    blade = force.blades[0]
    np.testing.assert_array_equal(xyn(force), xyn(Force(blade.X, blade.Y, blade.N)))
    assert abs(xyn(force)[2]) > 1
    by = module("rudder", "single" if name == "single" else "standard")
    u_R, v_R = (number(x) for x in by.inflow(flow, P, ALL, s))
    assert number(blade.sin2_alpha) == pytest.approx(np.sin(0.4 - np.arctan2(v_R, u_R)) ** 2, rel=1e-4)


def test_lindenburgs_normal_force() -> None:
    """C_N at Lambda = 2.208: worked by hand with 1 - exp(-17/Lambda) = 0.999546; slope 2.7243 at zero."""
    for degrees, by_hand in ((10.0, 0.39935), (20.0, 0.67562), (35.0, 0.93256), (90.0, 1.16857)):
        sine = np.sin(np.radians(degrees))
        assert lindenburg.normal_force(sine, sine, 2.208256) == pytest.approx(by_hand, abs=1e-5)
        assert lindenburg.normal_force(-sine, sine, 2.208256) == pytest.approx(-by_hand, abs=1e-5)
    assert lindenburg.normal_force(1e-6, 1e-6, 2.208256) / 1e-6 == pytest.approx(2.7243, abs=1e-3)


@pytest.mark.parametrize("s", [Exact(), SMOOTH])
def test_the_rudder_of_lindenburg_stalls_and_the_other_does_not(s: Smoothing) -> None:
    """0.93256 of Lindenburg against 2.747 sin(35 deg) = 1.57562 of the sine law; like slopes at small angles."""

    def ratio(degrees: float) -> float:
        flow = washed(Flow(u=1.0, v=0.0, r=0.0, n=10.0, delta=np.radians(degrees)), ALL, s)
        one, other = (number(model.force(flow, P, ALL, s).N) for model in (lindenburg, rudder))
        return one / other

    assert ratio(1) == pytest.approx(1.0, abs=0.04)
    assert ratio(35) == pytest.approx(0.93256 / 1.57562, rel=1e-4)

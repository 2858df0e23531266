"""Standard rudders: flow straightening, normal force, stall, the single blade, limiting cases."""

from __future__ import annotations

import numpy as np
import pytest

from mmg.components.catalogue import module
from mmg.components.propeller import standard
from mmg.components.rudder import inflow, lindenburg
from mmg.components.rudder import standard as rudder
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Exact, Smoothing
from tests.mmg.components.test_standard_propulsion import ALL, RUDDERS, SMOOTH, C, P, behind
from tests.support.force_numbers import defaults, number, xyn


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
    flow = Flow(u=u, v=v, r=r, n=10.0)
    flow = flow.with_(slipstream=standard.force(flow, P, C, s).slipstream)
    assert number(rudder.inflow(flow, P, C, s)[1]) == pytest.approx(U * gamma * beta_R, rel=tolerance)


@pytest.mark.parametrize("u", [-0.4, -0.1])
@pytest.mark.parametrize("v", [-0.1, 0.1])
def test_astern_the_rudder_moves_through_the_water_as_the_stern_does(u: float, v: float) -> None:
    """v_R has the sign of -v, u_R = u: the water comes from aft and from the side to which the stern moves."""
    flow = Flow(u=u, v=v, r=0.0, n=-8.0)
    flow = flow.with_(slipstream=standard.force(flow, P, C, Exact()).slipstream)
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
    flow = Flow(u=0.9, v=-0.2, r=0.03, n=10.0, delta=0.4)
    _, force = behind(flow, "standard", name, ALL, s)
    assert len(force.blades) == 1
    blade = force.blades[0]
    np.testing.assert_array_equal(xyn(force), xyn(Force(blade.X, blade.Y, blade.N)))
    assert abs(xyn(force)[2]) > 1
    washed = flow.with_(slipstream=standard.force(flow, P, ALL, s).slipstream)
    u_R, v_R = (
        number(x) for x in module("rudder", "single" if name == "single" else "standard").inflow(washed, P, ALL, s)
    )
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
        flow = Flow(u=1.0, v=0.0, r=0.0, n=10.0, delta=np.radians(degrees))
        one, other = (xyn(behind(flow, "standard", name, ALL, s)[1]) for name in ("lindenburg", "standard"))
        return float(one[2] / other[2])

    assert ratio(1) == pytest.approx(1.0, abs=0.04)
    assert ratio(35) == pytest.approx(0.93256 / 1.57562, rel=1e-4)

"""KVLCC2 against the check values of Yasukawa & Yoshimura (2015): states, propulsion, manoeuvres."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.ship_file import load_ship
from mmg.components.hull import polynomial
from mmg.components.propeller import standard, wake
from mmg.components.rudder import standard as rudder
from mmg.model import Model, assemble
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact
from tests.support.force_numbers import number, particulars_and_coefficients, smooth, xyn

SHIPS = ("kvlcc2_l7", "kvlcc2_full")
P, C = particulars_and_coefficients("kvlcc2_l7")
SMOOTH = smooth(P)

STATES = ((1.0, -0.1, 0.05, 10.0, 10.0), (1.1, 0.15, -0.08, 12.0, -20.0))
"""u, v [m/s], r [rad/s], n [1/s], rudder [deg]."""

# X, Y, N of the hull; beta_P, 1 - w_P, J, K_T; X_P; u_R, beta_R, v_R; alpha_R, F_N; rudder; accelerations (SI).
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
        "wake": (number(wake.inflow_angle(flow, P, C, s)), number(wash.one_minus_w), number(wash.u_P) / nD,
                 number(wash.loading) / nD**2),
        "X_P": (number(push.X),),
        "inflow": (u_R, v_R / gamma / np.hypot(u, v), v_R),
        "normal": (delta - np.arctan2(v_R, u_R), turn[0] / (-(1 - C.t_R) * np.sin(delta))),
        "rudder": tuple(turn),
        "rates": tuple(rates[3:]),
    }  # fmt: skip


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("quantity", PRINTED[0])
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


# The ship file


@pytest.mark.parametrize("name", SHIPS)
def test_inertia_and_reversal_of_the_file_are_those_of_the_particulars(name: str) -> None:
    ship = load_ship(name)
    inertia = 0.25**2 * ship.particulars["m"] * ship.particulars["L"] ** 2
    unit = 0.5 * ship.particulars["rho"] * ship.particulars["L"] ** 4 * ship.particulars["d"]
    assert ship.coefficients["I_J_z"].value == pytest.approx(inertia / unit + 0.011, rel=1e-6)
    assert ship.coefficients["beta_t"].value == pytest.approx(standard.reversal(0.721), rel=1e-5)

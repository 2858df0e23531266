"""Derivatives of the rates from CasADi against finite differences, away from and inside every blend."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from cases.shipfiles.ship_file import load_ship
from mmg.components.coefficients import names
from mmg.components.propeller import hachii
from mmg.components.rudder import single
from mmg.model import assemble
from mmg.motion.flow import Flow
from mmg.motion.smooth import Smooth

SHIP = load_ship("esso_osaka_3m")
COUNT = len(SHIP.symbols)
ARGUMENTS = 10 + COUNT

SCALE = np.concatenate([[1, 1, 1, 0.3, 0.1, 0.05, 10, 0.3, 1, 1], np.maximum(np.abs(SHIP.values), 1e-3)])
"""Size of each argument: state, controls, coefficients."""

STEP = 1e-6
"""Step of the finite differences in units of SCALE: far below the narrowest blend (1 mm/s of 0.3 m/s)."""

TOLERANCE = 1e-7
"""Largest deviation, by the largest derivative of the same rate (both in units of SCALE).

Measured: 4e-10, the round-off of the differences; 2e-8 in the Hessian in dead water at the rudder, where U_R
bends within 0.2 mm/s of u (1 mm/s of blend over a slope du_R/du of 4.2) and the step shows.
"""

KINDS = (
    "open",
    "near rest",
    "on the branches of the reversed propeller",
    "straight, ahead and astern",
    "stopped",
    "dead water at the rudder",
)


def speed_of_dead_water(n: float) -> float:
    """Speed [m/s] at which the reversed propeller just stops the flow at the rudder: U_R is all rounding."""
    p, c = names(dict(SHIP.particulars)), names({name: c.value for name, c in SHIP.coefficients.items()})
    s = Smooth.for_length(p.L)

    def u_R(u: float) -> float:
        motion = Flow(u=u, v=0.0, r=0.0, n=n)
        wash = hachii.force(motion, p, c, s).slipstream
        inflow, _ = single.inflow(Flow(u=u, v=0.0, r=0.0, n=n, slipstream=wash), p, c, s)
        return float(ca.DM(inflow))

    return brentq(u_R, 0.1, 0.8, xtol=1e-12)


def point(kind: str, seed: int) -> np.ndarray:
    """State, controls and coefficients in one vector (10 + P,)."""
    rng = np.random.default_rng(seed)
    u, v, r, n = rng.uniform(-1, 1, 4) * (0.4, 0.15, 0.1, 12)
    if kind == "near rest":
        u, v, r, n = rng.normal(size=4) * (0.01, 0.005, 0.003, 0.1)
    elif kind == "on the branches of the reversed propeller":
        advance = (-0.35, -0.233, -0.06)[seed % 3]
        n = -10.0
        u = advance * n * SHIP.particulars["D_P"] + rng.normal(0, 0.005)
        v = rng.normal(0, 0.005)
        r = v / 1.5 + rng.normal(0, 0.001)
    elif kind == "straight, ahead and astern":
        u, v, r = (-1) ** seed * abs(u), 0.0, 0.0
    elif kind == "stopped":
        n = 0.0
    elif kind == "dead water at the rudder":
        n, v, r = -10.0, 0.0, 0.0
        u = speed_of_dead_water(n)
    return np.concatenate(
        [
            rng.normal(size=2),
            rng.uniform(-np.pi, np.pi, 1),
            (u, v, r, n),
            rng.uniform(-0.6, 0.6, 1),
            rng.normal(0, 0.5, 2),
            SHIP.values * (1 + 0.02 * rng.normal(size=COUNT) * (kind != "dead water at the rudder")),
        ]
    )


@pytest.fixture(scope="module")
def derivatives() -> tuple[ca.Function, ca.Function, ca.Function]:
    """Rates (6,), their Jacobian (6, A) and its Jacobian (6 A, A), each of one vector of all A arguments."""
    x = ca.SX.sym("x", ARGUMENTS)
    rates = assemble(SHIP).rates(x[:6], x[6:10], x[10:])
    jacobian = ca.densify(ca.jacobian(rates, x))
    hessian = ca.densify(ca.jacobian(ca.vec(jacobian), x))
    return tuple(ca.Function(name, [x], [f]) for name, f in (("f", rates), ("J", jacobian), ("H", hessian)))


def central(function: ca.Function, x: np.ndarray) -> np.ndarray:
    """Fourth-order central differences of a function's column-major result, one column per argument."""

    def at(shift: np.ndarray) -> np.ndarray:
        return np.array(function(x + shift)).ravel("F")

    columns = []
    for shift in np.diag(STEP * SCALE):
        first, second = at(shift) - at(-shift), at(2 * shift) - at(-2 * shift)
        columns.append((8 * first - second) / (12 * shift.sum()))
    return np.array(columns).T


def assert_agrees(exact: np.ndarray, difference: np.ndarray, units: np.ndarray) -> None:
    """Both (6, ...) in units of SCALE, each rate by its own largest derivative."""
    for rate in range(6):
        largest = np.abs(exact[rate] * units).max()
        assert largest > 0 or rate == 2  # psi' = r is linear: no second derivative
        np.testing.assert_allclose(
            difference[rate] * units, exact[rate] * units, rtol=0, atol=TOLERANCE * max(largest, 1e-3)
        )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_jacobian_agrees_with_finite_differences(kind: str, seed: int, derivatives: tuple) -> None:
    rates, jacobian, _ = derivatives
    x = point(kind, seed)
    assert_agrees(np.array(jacobian(x)), central(rates, x), SCALE)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_hessian_agrees_with_finite_differences_of_the_jacobian(kind: str, seed: int, derivatives: tuple) -> None:
    _, jacobian, hessian = derivatives
    x = point(kind, seed)
    shape = (6, ARGUMENTS, ARGUMENTS)
    exact = np.array(hessian(x)).reshape(shape, order="F")
    difference = central(jacobian, x).reshape(shape, order="F")
    assert_agrees(exact, difference, np.outer(SCALE, SCALE))


@pytest.mark.parametrize("kind", KINDS)
def test_coefficients_put_in_as_numbers_give_the_same_rates(kind: str) -> None:
    """A model whose arguments are a few coefficients equals the one with all as arguments."""
    chosen = ("Y_v", "w_P0", "gamma_N")
    x = point(kind, 1)
    some, every = assemble(SHIP, chosen), assemble(SHIP)
    own = [SHIP.coefficients[name].value for name in chosen]
    np.testing.assert_allclose(
        np.array(some.rates(x[:6], x[6:10], own)),
        np.array(every.rates(x[:6], x[6:10], SHIP.values)),
        rtol=1e-12,
        atol=1e-16,
    )

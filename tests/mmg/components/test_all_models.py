"""Every force model of the library, alone and in whole ships: finite derivatives, energy, mirror symmetry."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import library, load_ship
from mmg.components.catalogue import FORCES, MODELS, coefficient_table, module
from mmg.components.coefficients import names
from mmg.model import assemble
from mmg.motion.flow import INPUTS, Flow
from mmg.motion.smooth import Smooth
from mmg.ship import Ship

PARTICULARS = {
    "L": 3.0, "B": 0.49, "d": 0.2, "m": 245.0, "x_G": 0.09, "rho": 998.0, "D_P": 0.084, "pitch_ratio": 0.72, "U_0": 0.8,
    "A_R": 0.0106, "aspect_ratio": 1.54, "x_R": -1.5, "A_T": 0.135, "A_L": 0.52, "A_OD": 0.14, "C": -0.013,
    "C_BR": -0.06, "H_BR": 0.29, "H_C": 0.1, "rho_a": 1.225, "D_BT": 0.04, "x_BT": 1.3, "D_ST": 0.04, "x_ST": -1.3,
    "D_az": 0.06, "x_az": -1.3, "y_az": 0.0, "L_OA": 3.1, "A_SS": 0.14, "S_A": 7.0, "GM": 0.02, "C_b": 0.83,
}  # fmt: skip
"""A ship of everything."""

FORCE_MODELS = [(role, name) for role in FORCES if role != "expansion" for name in MODELS[role]]
"""All but the polynomials, which have no terms of their own: ``test_expansion``."""
SIZES = {"u": 0.5, "v": 0.2, "r": 0.1, "a_x": 3.0, "a_y": 3.0, "psi": 3.0}
ACTUATORS = {name: 12.0 if unit == "rps" else 0.6 for name, (_, unit) in INPUTS.items()}
NEEDED_BY = {"rudder": "hachii"}


def symbolic(
    role: str, name: str, particulars: dict[str, float] = PARTICULARS
) -> tuple[ca.Function, ca.Function, ca.Function, int]:
    """Force, first and second derivatives of a model as functions of motion and actuators."""
    components = {"propeller": NEEDED_BY[role]} if role in NEEDED_BY else {}
    components[role] = name
    c = names({s: row.value for s, row in coefficient_table(components, particulars).items()})
    p, s = names(particulars), Smooth.for_length(3.0)
    keys = [*SIZES, *ACTUATORS]
    x = ca.SX.sym("x", len(keys))
    flow = Flow(**{key: x[i] for i, key in enumerate(keys)})
    if role in NEEDED_BY:
        flow = flow.with_(slipstream=module("propeller", NEEDED_BY[role]).force(flow, p, c, s).slipstream)
    force = module(role, name).force(flow, p, c, s)
    y = ca.vertcat(force.X, force.Y, force.N)
    jacobian = ca.jacobian(y, x)
    hessian = ca.jacobian(ca.densify(ca.vec(jacobian)), x)
    return (*(ca.Function("f", [x], [e]) for e in (y, jacobian, hessian)), len(keys))


LOW_RUDDER = {**PARTICULARS, "aspect_ratio": 0.25 * PARTICULARS["aspect_ratio"]}
"""Its rudder is lower than the propeller's diameter, and all of it in the slipstream."""


@pytest.mark.parametrize(
    ("role", "name", "particulars"),
    [(*model, PARTICULARS) for model in FORCE_MODELS]
    + [(*model, LOW_RUDDER) for model in FORCE_MODELS if model[0] == "rudder"],
)
def test_force_and_its_first_and_second_derivatives_are_finite_everywhere(
    role: str, name: str, particulars: dict[str, float]
) -> None:
    """On a grid of zero and non-zero speeds, all quadrants, actuators stopped and moving, wind and calm."""
    f, J, H, size = symbolic(role, name, particulars)
    scale = np.array([*SIZES.values(), *ACTUATORS.values()])
    rng = np.random.default_rng(0)
    points = [np.zeros(size)]
    for signs in np.array(np.meshgrid(*[(-1, 0, 1)] * 4)).reshape(4, -1).T:
        point = rng.uniform(-1, 1, size)
        point[:3] = signs[:3]
        point[len(SIZES) :] *= abs(signs[3])
        points += [point * scale, np.where(rng.random(size) < 0.5, 0.0, point * scale), 1e-5 * point * scale]
    for point in points:
        for function in (f, J, H):
            assert np.isfinite(np.array(function(point))).all(), (function.name(), point)


@pytest.mark.parametrize(("role", "name"), FORCE_MODELS)
def test_first_derivatives_agree_with_finite_differences(role: str, name: str) -> None:
    f, J, _, size = symbolic(role, name)
    scale = np.array([*SIZES.values(), *ACTUATORS.values()])
    rng = np.random.default_rng(1)
    for _ in range(15):
        point, direction = rng.uniform(-1, 1, size) * scale, rng.normal(size=size) * scale
        h = 1e-6
        slope = np.array(f(point + h * direction) - f(point - h * direction)).ravel() / (2 * h)
        exact = np.array(J(point)) @ direction
        np.testing.assert_allclose(exact, slope, rtol=2e-5, atol=2e-5 * np.abs(exact).max() + 1e-8)


TWIN = new_ship("twin", {"L": 3.0, "B": 0.5, "d": 0.17, "C_b": 0.6, "y_P": 0.12, "D_P": 0.07, "U_0": 1.0})


def whole_ships() -> list[Ship]:
    """All but those with an Abkowitz hull: a polynomial about a service speed holds the propeller's push too."""
    ships = [*(load_ship(name) for name in library()), TWIN]
    return [ship for ship in ships if ship.components.get("hull") != "abkowitz"]


@pytest.mark.parametrize("ship", whole_ships(), ids=lambda ship: ship.name)
def test_a_coasting_ship_loses_energy(ship: Ship) -> None:
    """Propeller and thrusters stopped, rudder midships, no wind: power of all forces is negative in any direction."""
    model = assemble(ship)
    k = np.sqrt(ship.particulars["L"] / 3)
    rng = np.random.default_rng(2)
    velocity = rng.normal(size=(3, 400))
    velocity[:, :60] *= rng.random((3, 60)) < 0.5
    velocity[:, 390:] = [
        [1, -1, 0, 0, 0, 0, 1, 1, -1, -1],
        [0, 0, 1, -1, 0, 0, 1, -1, 1, -1],
        [0] * 4 + [1, -1] + [0] * 4,
    ]
    velocity *= 0.3 * k / np.maximum(np.abs(velocity).max(axis=0), 1e-9)
    velocity[2] /= ship.particulars["L"] / 2
    state = np.vstack([np.zeros((3, 400)), velocity])
    controls = np.zeros((len(model.controls), 400))
    forces = np.array(model.forces(state, controls, ship.values)).reshape(len(model.roles), 400, 3)
    total = forces.sum(axis=0)
    lost = (total * velocity.T).sum(axis=1)
    munk = (ship.coefficients["m_y"].value - ship.coefficients["m_x"].value) * 0.5 * ship.particulars["rho"]
    munk *= ship.particulars["L"] ** 2 * ship.particulars["d"] * np.prod(velocity, axis=0)
    moving = np.abs(velocity).max(axis=0) > 0
    assert (lost[moving] + munk[moving] < 0).all(), velocity[:, moving][:, lost[moving] + munk[moving] >= 0][:, :3]


@settings(max_examples=60, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(-12, 12), st.floats(-0.6, 0.6))
def test_a_twin_screw_ship_is_symmetric(u: float, v: float, r: float, n: float, delta: float) -> None:
    """Mirrored motion and rudders give the mirrored force, though each propeller has a side force of its own."""
    model = assemble(TWIN)
    assert model.controls[:4] == ("n", "n_2", "delta_port", "delta_starboard")
    one = np.array(model.rates([0, 0, 0, u, v, r], [n, 0.8 * n, delta, 0.7 * delta, 0, 0], TWIN.values)).ravel()
    other = np.array(model.rates([0, 0, 0, u, -v, -r], [0.8 * n, n, -0.7 * delta, -delta, 0, 0], TWIN.values)).ravel()
    np.testing.assert_allclose(other[3:], one[3:] * (1, -1, -1), rtol=1e-9, atol=1e-12)


def test_unequal_revolutions_turn_a_twin_screw_ship() -> None:
    """More thrust to starboard turns the bow to port, at rest too."""
    model = assemble(TWIN)
    turned = np.array(model.rates(np.zeros(6), [10, 5, 0, 0, 0, 0], TWIN.values)).ravel()
    assert turned[5] < 0 < turned[3]

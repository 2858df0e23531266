"""Every force model of the library, alone and in whole ships: finite derivatives, energy, mirror symmetry."""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import library, load_ship
from mmg.components.catalogue import FORCES, MODELS, coefficient_table, module
from mmg.components.coefficients import names
from mmg.model import assemble
from mmg.motion.flow import INPUTS, Flow
from mmg.motion.smooth import Exact, Smooth
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship
from tests.support.networks import random_network

PARTICULARS = {
    "L": 3.0, "B": 0.49, "d": 0.2, "m": 245.0, "x_G": 0.09, "rho": 998.0, "D_P": 0.084, "pitch_ratio": 0.72, "U_0": 0.8,
    "A_R": 0.0106, "aspect_ratio": 1.54, "x_R": -1.5, "A_T": 0.135, "A_L": 0.52, "A_OD": 0.14, "C": -0.013,
    "C_BR": -0.06, "H_BR": 0.29, "H_C": 0.1, "rho_a": 1.225, "D_BT": 0.04, "x_BT": 1.3, "D_ST": 0.04, "x_ST": -1.3,
    "D_az": 0.06, "x_az": -1.3, "y_az": 0.0, "L_OA": 3.1, "A_SS": 0.14, "S_A": 7.0, "GM": 0.02, "C_b": 0.83,
}  # fmt: skip
"""A ship of everything."""

PROPELLERS = ("standard", "standard_kijima", "standard_hirano", "kang", "cpp")
FORCE_MODELS = [(role, name, "hachii") for role in FORCES if role != "expansion" for name in MODELS[role]]
FORCE_MODELS += [("rudder", "vectwin" if name == "kang" else "standard", name) for name in PROPELLERS]
FORCE_MODELS += [("rudder", name, "standard") for name in ("lindenburg", "single")]
"""Role, model, and the propeller before a rudder. All but the polynomials, which have no terms of their own:
``test_expansion``."""
SIZES = {"u": 0.5, "v": 0.2, "r": 0.1, "a_x": 3.0, "a_y": 3.0, "psi": 3.0}
ACTUATORS = {name: 12.0 if unit == "rps" else 0.6 for name, (_, unit) in INPUTS.items()}
SCALE = np.array([*SIZES.values(), *ACTUATORS.values()])


def force_at(point: Any, model: tuple[str, str, str], low_rudder: bool = False, exact: bool = False) -> Any:
    """Force, and for a rudder the sine of its blades, at a ``point`` (numbers or an expression) of SIZES and ACTUATORS;
    low_rudder: lower than the propeller's diameter, and all of it in the slipstream."""
    role, name, propeller = model
    particulars = {**PARTICULARS, "aspect_ratio": (0.25 if low_rudder else 1.0) * PARTICULARS["aspect_ratio"]}
    components = ({"propeller": propeller} if role == "rudder" else {}) | {role: name}
    c = names({s: row.value for s, row in coefficient_table(components, particulars).items()})
    p, s = names(particulars), Exact() if exact else Smooth.for_length(3.0)
    flow = Flow(**{key: point[i] for i, key in enumerate([*SIZES, *ACTUATORS])})
    if role == "rudder":
        flow = flow.with_(slipstream=module("propeller", propeller).force(flow, p, c, s).slipstream)
    force = module(role, name).force(flow, p, c, s)
    return ca.vertcat(force.X, force.Y, force.N, *[blade.sin2_alpha for blade in force.blades])


@pytest.mark.parametrize(
    ("model", "low_rudder"),
    [(model, False) for model in FORCE_MODELS] + [(model, True) for model in FORCE_MODELS if model[0] == "rudder"],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else ("low" if value else ""),
)
def test_force_and_its_first_and_second_derivatives_are_finite_everywhere(
    model: tuple[str, str, str], low_rudder: bool
) -> None:
    """On a grid of zero and non-zero speeds, all quadrants, actuators stopped and moving, wind and calm."""
    size, rng = len(SCALE), np.random.default_rng(0)
    x = ca.SX.sym("x", size)
    y = force_at(x, model, low_rudder)
    J = ca.densify(ca.jacobian(y, x))
    f = ca.Function("f", [x], [y, J, ca.densify(ca.jacobian(ca.vec(J), x))], {"cse": True})
    points = [np.zeros(size)]
    for signs in np.array(np.meshgrid(*[(-1, 0, 1)] * 4)).reshape(4, -1).T:
        point = rng.uniform(-1, 1, size)
        point[:3] = signs[:3]
        point[len(SIZES) :] *= abs(signs[3])
        points += [point * SCALE, np.where(rng.random(size) < 0.5, 0.0, point * SCALE), 1e-5 * point * SCALE]
        points.append(np.where(np.arange(size) < 3, point * SCALE, 0.0))
    for part in f(np.column_stack(points)):
        assert np.isfinite(np.array(part)).all()


@pytest.mark.parametrize("model", FORCE_MODELS, ids=" ".join)
def test_nothing_acts_at_rest(model: tuple[str, str, str]) -> None:
    """Exactly; the smooth rudders creep by 1e-5 N, as their inflow is held above a few mm/s."""
    at = [*np.zeros(len(SIZES)), *(0.0 if name.startswith("n") else angle for name, angle in ACTUATORS.items())]
    for exact, most in ((True, 0.0), (False, 1e-4)):
        assert np.abs(np.array(ca.DM(force_at(at, model, exact=exact))))[:3].max() <= most


MIRRORED = {"n": "n_2", "n_2": "n", "delta_port": "delta_starboard", "delta_starboard": "delta_port"}
TWIN = new_ship("twin", {"L": 3.0, "B": 0.5, "d": 0.17, "C_b": 0.6, "y_P": 0.12, "D_P": 0.07, "U_0": 1.0})


def equipped(name: str, **components: str) -> Ship:
    """A ship of the library with other force models, at their default coefficients."""
    return load_ship(name).with_models(**components)


def whole_ships() -> list[Ship]:
    """All but those with an Abkowitz hull: a polynomial about a service speed holds the propeller's push too."""
    ships = [*(load_ship(name) for name in library()), TWIN, equipped("esso_osaka_3m", propeller="four_quadrant")]
    ships += [equipped("kvlcc2_full", hull="harbour"), true_ship("pods")]
    return [ship for ship in ships if ship.components.get("hull") != "abkowitz"]


@pytest.mark.parametrize("size", [1.0, 0.07, 0.003])
@pytest.mark.parametrize("ship", whole_ships(), ids=lambda ship: ship.name)
def test_a_coasting_ship_loses_energy(ship: Ship, size: float) -> None:
    """Propeller and thrusters stopped, any rudders, no wind: power of all forces is negative in any direction.

    Below 2 cm/s a rudder over creeps: u_R is held above a few mm/s, which is worth 1e-7 m/s^2.
    """
    model = assemble(ship)
    k = size * np.sqrt(ship.particulars["L"] / 3)
    rng = np.random.default_rng(2)
    velocity = rng.normal(size=(3, 400))
    velocity[:, :60] *= rng.random((3, 60)) < 0.5
    velocity[:, 390:396] = np.kron(np.eye(3), [1, -1])
    velocity[:, 396:] = [[1, 1, -1, -1], [1, -1, 1, -1], [0] * 4]
    velocity *= 0.3 * k / np.maximum(np.abs(velocity).max(axis=0), 1e-9)
    velocity[2] /= ship.particulars["L"] / 2
    state = np.vstack([np.zeros((3, 400)), velocity])
    controls = np.zeros((len(model.controls), 400))
    if size > 0.01:
        rudders = [i for i, name in enumerate(model.controls) if name.startswith("delta")]
        controls[rudders] = rng.uniform(-0.6, 0.6, (len(rudders), 400)) * (rng.random(400) < 0.7)
    forces = np.array(model.forces(state, controls, ship.values)).reshape(len(model.roles), 400, 3)
    total = forces.sum(axis=0)
    lost = (total * velocity.T).sum(axis=1)
    munk = (ship.coefficients["m_y"].value - ship.coefficients["m_x"].value) * 0.5 * ship.particulars["rho"]
    munk *= ship.particulars["L"] ** 2 * ship.particulars["d"] * np.prod(velocity, axis=0)
    moving = np.abs(velocity).max(axis=0) > 0
    assert (lost[moving] + munk[moving] < 0).all(), velocity[:, moving][:, lost[moving] + munk[moving] >= 0][:, :3]


EVEN = {"gamma_R_plus": 0.5, "gamma_R_minus": 0.5, "C_2_plus": 1.4, "C_2_minus": 1.4, "gamma_P": 0.4, "gamma_N": 0.4}
EVEN |= {f"{letter}_{i}": 0.0 for letter in "AB" for i in range(1, 9)}
EVEN |= {f"{letter}_{term}": 0.0 for letter in "YN" for term in ("0", "0u", "0uu")}
"""Values at which nothing tells port from starboard: no propeller walk, no bias of one screw, one gamma_R, one C_2."""
UNEVEN = [load_ship(name) for name in ("esso_osaka_3m", "mariner", "kvlcc2_l7")]
"""Ships that tell the sides apart with their published values."""
SYMMETRIC = [*UNEVEN, TWIN, equipped("esso_osaka_3m", hull="harbour")]
SYMMETRIC += [
    equipped("kvlcc2_l7", propeller=f"standard{of}", rudder=rudder)
    for of, rudder in (("_kijima", "lindenburg"), ("_hirano", "single"), ("_hirano", "standard"), ("", "single"))
]
INPUT_SIZES = {"n": 15.0, "n_2": 15.0, "wind_north": 3.0, "wind_east": 3.0}
"""0.7 for the others."""


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("ship", SYMMETRIC, ids=lambda ship: " ".join([ship.name, *ship.components.values()]))
def test_mirrored_motion_gives_mirrored_forces(ship: Ship, exact: bool) -> None:
    """F(u, -v, -r, -delta, mirrored wind) = (X, -Y, -N); two screws do so with a side force of their own each."""
    model, rng, L = assemble(ship, exact=exact), np.random.default_rng(3), ship.particulars["L"]
    even = ship if ship is TWIN else ship.with_values({s: x for s, x in EVEN.items() if s in ship.symbols})
    sizes = [INPUT_SIZES.get(name, 0.7) for name in model.controls]
    places = [
        i if MIRRORED.get(x) not in model.controls else model.controls.index(MIRRORED[x])
        for i, x in enumerate(model.controls)
    ]
    signs = [-1 if name.startswith("delta") or name == "wind_east" else 1 for name in model.controls]
    uneven = []
    for _ in range(150):
        u, v, r = rng.uniform(-1, 1, 3) * [0.2, 0.1, 0.2 / L] * np.sqrt(9.81 * L) * (rng.random(3) < 0.9)
        controls = rng.uniform(-1, 1, len(sizes)) * sizes * (rng.random(len(sizes)) < 0.9)
        for theta in (even.values, ship.values):
            one = np.array(model.forces([0, 0, 0, u, v, r], controls, theta)).sum(axis=0)
            other = np.array(model.forces([0, 0, 0, u, -v, -r], controls[places] * signs, theta)).sum(axis=0)
            off, largest = np.abs(other * (1, -1, -1) - one).max(), np.abs(one).max()
            if theta is even.values:
                assert off <= 1e-9 * largest + 1e-10
            uneven.append(off / largest)
    assert max(uneven) > 1e-3 or ship not in UNEVEN


@pytest.mark.slow
@pytest.mark.parametrize("name", ["esso_osaka_3m", "kvlcc2_l7", "mariner", "hybrid"])
def test_derivatives_by_state_controls_and_coefficients_are_finite(name: str) -> None:
    """First and second, at rest, on axes, in all quadrants and at creeping speed, in wind and calm."""
    ship = load_ship("esso_osaka_3m" if name == "hybrid" else name)
    ship = ship.with_network(random_network(ship)) if name == "hybrid" else ship
    controls, count = len(ship.actuators) + 2, len(ship.symbols)
    x = ca.SX.sym("x", 6 + controls + count)
    rates = assemble(ship).rates(x[:6], x[6 : 6 + controls], x[6 + controls :])
    first = ca.jacobian(rates, x)
    second = ca.jacobian(ca.vertcat(*first.nonzeros()), x)
    every = ca.Function("d", [x], [rates, ca.vertcat(*first.nonzeros()), ca.vertcat(*second.nonzeros())])
    scale = np.array([1.0, 0.3, 0.1, 10.0, 0.4])[: 3 + controls - 2] if controls == 4 else np.array([7.0, 1, 0.01, 0.4])
    for number, sign in enumerate(itertools.product((-1.0, 0.0, 1.0), repeat=len(scale))):
        for size in (1.0, 1e-3):
            motion, wind = size * scale * np.array(sign), [(0, 0), (1.0, -2.0)][number % 2]
            point = np.concatenate([[0, 0, 0.4], motion, wind, ship.values])
            for part in every(point):
                assert np.isfinite(np.array(part)).all(), motion


@pytest.mark.parametrize("psi", [0.0, 0.7, -2.0, 3.0])
def test_accelerations_do_not_depend_on_heading_when_the_wind_turns_along(psi: float) -> None:
    ship = load_ship("esso_osaka_3m")
    state, controls = np.array([5, -3, 0, 0.2, -0.05, 0.03]), np.array([8, 0.2, 1.0, 0.5])
    turned_state, turned = state.copy(), controls.copy()
    turned_state[2] = psi
    turned[2:] = [np.cos(psi) - 0.5 * np.sin(psi), np.sin(psi) + 0.5 * np.cos(psi)]
    own, other = (
        np.array(assemble(ship).rates(*pair, ship.values)).ravel()[3:]
        for pair in ((state, controls), (turned_state, turned))
    )
    np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-14)


def test_unequal_revolutions_turn_a_twin_screw_ship() -> None:
    """More thrust to starboard turns the bow to port, at rest too."""
    model = assemble(TWIN)
    turned = np.array(model.rates(np.zeros(6), [10, 5, 0, 0, 0, 0], TWIN.values)).ravel()
    assert turned[5] < 0 < turned[3]

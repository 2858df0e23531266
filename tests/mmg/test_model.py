"""A ship as functions: shared by ships that differ in values alone, the same for many points and for one, rates and
derivatives as the simulator has them, forces that sum to the motion, input that is refused."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.errors import UserError
from mmg.model import assemble, states_behind
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.networks import random_network

SHIP = load_ship("esso_osaka_3m")
INSTRUMENTED = SHIP.with_effect("velocity_filter").with_effect("antenna_offset")


def test_values_of_arguments_share_functions_and_what_is_inside_does_not() -> None:
    first, other = (
        assemble(INSTRUMENTED),
        assemble(INSTRUMENTED.with_values({"X_0F": 0.03, "velocity_filter.tau": 2.0})),
    )
    assert first.rates is other.rates and other.ship is not first.ship
    assert other.ship.coefficients["X_0F"].value == 0.03
    fixed, moved = (assemble(ship, symbols=("X_0F",)) for ship in (INSTRUMENTED, other.ship))
    assert fixed.rates is not moved.rates
    assert assemble(INSTRUMENTED, acted=True).rates is not first.rates
    assert assemble(INSTRUMENTED.without_effect("velocity_filter")).states == assemble(INSTRUMENTED).states[:6]


@pytest.mark.parametrize("own", [False, True])
def test_states_behind_columns_of_many_points_are_those_of_few(own: bool) -> None:
    model, rng, many = assemble(INSTRUMENTED), np.random.default_rng(0), 201
    logged, controls = rng.standard_normal((6, many)), rng.standard_normal((len(INSTRUMENTED.inputs), many))
    logged[5, 3] = np.nan
    theta = np.tile(INSTRUMENTED.values[:, None], many) if own else INSTRUMENTED.values
    found = states_behind(model, logged, controls, theta)
    for part in (slice(0, 40), slice(many - 40, many)):
        few = states_behind(model, logged[:, part], controls[:, part], theta[:, part] if own else theta)
        np.testing.assert_allclose(found[:, part], few, rtol=1e-13, atol=1e-13)
    again = model.at_points("columns_by", found, theta[model.measured_by])
    known = np.isfinite(logged).all(axis=0)
    assert known.sum() == many - 1
    np.testing.assert_allclose(again[:, known], logged[:, known], atol=1e-11)


def test_coefficients_put_in_as_numbers_give_the_same_rates() -> None:
    """A model whose arguments are a few coefficients equals the one with all as arguments."""
    chosen, state, controls = ("Y_v", "w_P0", "gamma_N"), [1.0, 2.0, 0.4, 0.3, -0.05, 0.03], [10.0, 0.3, 0.5, -0.2]
    some, every = assemble(INSTRUMENTED, chosen), assemble(INSTRUMENTED)
    own = [INSTRUMENTED.coefficients[name].value for name in chosen]
    state = np.array(every.initial(state, controls, INSTRUMENTED.values)).ravel()
    one, other = some.rates(state, controls, own), every.rates(state, controls, INSTRUMENTED.values)
    np.testing.assert_allclose(np.array(one), np.array(other), rtol=1e-12, atol=1e-16)


# The right-hand side
Z = np.array([1.0, -2.0, 0.4, 0.5, 0.03, 0.02])
ORDERS = {"n": 9.0, "delta": 0.2}


@pytest.mark.parametrize(
    "ship", [SHIP, SHIP.with_effect("hull_memory", {"T": 1.0}), load_ship("vectwin_3m")], ids=["plain", "memory", "two"]
)
def test_rates_and_derivatives_are_those_of_the_simulator(ship: Ship) -> None:
    rhs = ship.rhs
    controls = {name: {"n": 9.0}.get(name, 0.1) for name in ship.actuators}
    full = Simulator(ship).start(Z[:, None], np.array([[*controls.values(), 0.0, 0.0]]).T)[:, 0]
    values = np.array([*controls.values(), 0.0, 0.0])
    expected = Simulator(ship, compiled=False).rates(full[:, None], values[:, None])[:, 0]
    np.testing.assert_allclose(rhs(Z, controls), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.array(rhs.function(full, values)).ravel(), expected, rtol=1e-9, atol=1e-12)
    A, B = ship.jacobian(full, controls)
    assert A.shape == (len(rhs.states),) * 2 and B.shape == (len(rhs.states), len(rhs.controls))
    for matrix, base, at in ((A, full, 0), (B, values, 1)):
        for k in range(len(base)):
            step = 1e-6 * np.eye(len(base))[k]
            both = [[full + s * step, values] if at == 0 else [full, values + s * step] for s in (1, -1)]
            slope = (rhs(*both[0]) - rhs(*both[1])) / 2e-6
            np.testing.assert_allclose(matrix[:, k], slope, rtol=1e-5, atol=1e-7)


def test_many_points_are_single_points_side_by_side() -> None:
    rng = np.random.default_rng(3)
    states = Z[:, None] + 0.05 * rng.standard_normal((6, 40))
    deltas = rng.uniform(-0.5, 0.5, 40)
    found = SHIP.rhs(states, {"n": 9.0, "delta": deltas})
    each = [SHIP.rhs(states[:, k], [9.0, deltas[k], 0.0, 0.0]) for k in range(40)]
    np.testing.assert_allclose(found, np.transpose(each), rtol=1e-12)


def test_six_numbers_are_the_motion_itself_whatever_instruments_make_of_it() -> None:
    """Also of a ship whose effects remember something: no logged columns, from which the motion is another."""
    plain = SHIP.with_effect("heading_bias", {"psi": 0.3})
    remembering = plain.with_effect("hull_memory", {"T": 0.0})
    np.testing.assert_allclose(remembering.rhs(Z, ORDERS)[:6], plain.rhs(Z, ORDERS), rtol=1e-12)


def test_forces_are_by_component_and_a_ship_at_rest_stays() -> None:
    forces = SHIP.rhs.forces(Z, ORDERS)
    assert SHIP.forces(Z, ORDERS).equals(forces)
    assert list(forces.index) == list(SHIP.components) and list(forces.columns) == ["X [N]", "Y [N]", "N [N m]"]
    without = SHIP.without("wind").rhs.forces(Z, ORDERS)
    np.testing.assert_allclose(forces.drop(index="wind"), without, rtol=1e-9)
    rest = SHIP.rhs([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], {"n": 0.0, "delta": 0.0})
    np.testing.assert_allclose(rest, 0.0, atol=1e-8)  # smooth at rest


@pytest.mark.parametrize("effects", [{}, {"shallow_water": {"d_h": 0.6}}], ids=["deep", "shallow"])
def test_forces_of_a_hybrid_sum_to_her_masses_times_accelerations(effects: dict[str, dict[str, float]]) -> None:
    """Masses as the effects make them: those that the ship without the network has at rest, where nothing else acts."""
    ship = SHIP
    for name, values in effects.items():
        ship = ship.with_effect(name, values)
    hybrid, rest = ship.with_network(random_network(ship)), np.zeros(6)
    winds = [{**ORDERS, "wind_north": 8.0, "wind_east": east} for east in (2.0, -6.0, 9.0)]
    a, F = (np.transpose([f(rest, c) for c in winds]) for f in (ship.rhs, lambda z, c: ship.rhs.forces(z, c).sum()))
    masses = F @ np.linalg.inv(a[3:])
    for controls in winds:
        found = hybrid.rhs.forces(rest, controls)
        np.testing.assert_allclose(found.sum(), masses @ hybrid.rhs(rest, controls)[3:], rtol=1e-6)
        assert found.index[-1] == "network" and np.abs(found.loc["network"]).min() > 0


@pytest.mark.parametrize(
    ("state", "controls"),
    [
        (Z[:5], ORDERS), (Z, [9.0]), (Z, {"n": 9.0}), (Z, {**ORDERS, "rudder": 0.1}),
        (np.tile(Z[:, None], 3), np.zeros((4, 2))), (np.zeros((6, 2, 2)), ORDERS),
    ],
    ids=["short state", "short controls", "missing", "unknown", "numbers of points", "three dimensions"],
)  # fmt: skip
def test_other_shapes_and_names_are_refused(state: Any, controls: Any) -> None:
    with pytest.raises(UserError):
        SHIP.rhs(state, controls)


def test_a_ship_goes_to_another_process_also_after_her_equations_were_used() -> None:
    rates = SHIP.rhs(Z, ORDERS)
    for copied in (pickle.loads(pickle.dumps(SHIP)), copy.deepcopy(SHIP)):
        assert copied == SHIP
        np.testing.assert_array_equal(copied.rhs(Z, ORDERS), rates)


def test_copies_by_name() -> None:
    assert SHIP.with_values(N_r=-0.05).coefficients["N_r"].value == -0.05
    assert SHIP.with_effect("current", x=0.1).coefficients["current.x"].value == 0.1
    assert "wind" not in SHIP.without("wind").components and SHIP.with_effect("tow").without("tow").effects == ()
    for wrong in ({"N_rr": 1.0}, {"current.x": 1.0}):
        with pytest.raises(UserError):
            SHIP.with_values(wrong)
    with pytest.raises(UserError):
        SHIP.without("sails")
    assert len(repr(SHIP).splitlines()) == len(repr(SHIP.rhs).splitlines()) == 1

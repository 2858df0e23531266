"""A ship's functions are shared by ships that differ in values alone, and serve many points without a compiler."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.model import assemble, states_behind

SHIP = load_ship("esso_osaka_3m").with_effect("velocity_filter").with_effect("antenna_offset")


def test_values_of_arguments_share_functions_and_what_is_inside_does_not() -> None:
    first, other = assemble(SHIP), assemble(SHIP.with_values({"X_0F": 0.03, "velocity_filter.tau": 2.0}))
    assert first.rates is other.rates and other.ship is not first.ship
    assert other.ship.coefficients["X_0F"].value == 0.03
    fixed, moved = (assemble(ship, symbols=("X_0F",)) for ship in (SHIP, other.ship))
    assert fixed.rates is not moved.rates
    assert assemble(SHIP, acted=True).rates is not first.rates
    assert assemble(SHIP.without_effect("velocity_filter")).states == assemble(SHIP).states[:6]


def test_sizes_of_the_memory_are_those_of_each_ship() -> None:
    slow = SHIP.with_effect("gyro")
    model = assemble(slow)
    assert model.sizes.shape == (len(model.states) - 6,) and (model.sizes > 0).all()


@pytest.mark.parametrize("own", [False, True])
def test_states_behind_columns_of_many_points_are_those_of_few(own: bool) -> None:
    model, rng, many = assemble(SHIP), np.random.default_rng(0), 201
    logged, controls = rng.standard_normal((6, many)), rng.standard_normal((len(SHIP.inputs), many))
    logged[5, 3] = np.nan
    theta = np.tile(SHIP.values[:, None], many) if own else SHIP.values
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
    some, every = assemble(SHIP, chosen), assemble(SHIP)
    own = [SHIP.coefficients[name].value for name in chosen]
    state = np.array(every.initial(state, controls, SHIP.values)).ravel()
    one, other = some.rates(state, controls, own), every.rates(state, controls, SHIP.values)
    np.testing.assert_allclose(np.array(one), np.array(other), rtol=1e-12, atol=1e-16)

"""Units of propeller and rudder: forces add up, the mirror image of a state has the mirror image of the force."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from fitting.selection.candidates import candidate, candidates
from mmg.components.expansion.actuators import parse_devices
from mmg.components.expansion.units import unit_monomials, units_of
from mmg.components.expansion.words import parse_monomial
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship

TWIN = "n+n_2, delta_starboard+delta_port"


def velocities(ship: Ship, motion: list[float], inputs: dict[str, float]) -> np.ndarray:
    """Changes of u, v, r of ``ship`` in a fifth of a second of constant inputs in calm air."""
    simulator = Simulator(ship, compiled=False)
    controls = np.array([inputs.get(name, 0.0) for name in simulator.model.controls])
    start = np.array([0.0, 0.0, 0.0, *motion])[:, None]
    states = simulator.run(start, np.repeat(controls[None, :, None], 20, axis=0), 0.01, ship.values)
    return states[-1, 3:6, 0] - np.array(motion)


@pytest.mark.parametrize(
    ("actuators", "units"),
    [
        (TWIN, (("n", "delta_starboard"), ("n_2", "delta_port"))),
        ("n, delta_port, delta_starboard", (("n", "delta_starboard"), ("n", "delta_port"))),
        ("n, delta", (("n", "delta"),)),
        ("n+n_2", (("n", ""), ("n_2", ""))),
        ("n", (("n", ""),)),
        ("n, delta, n_bow", ()),
        ("n+n_2, delta", ()),
        ("azimuth+azimuth_2", ()),
        ("delta", ()),
    ],
)
def test_units_are_a_propeller_with_the_rudder_behind_it(actuators: str, units: tuple[tuple[str, str], ...]) -> None:
    assert units_of(parse_devices(actuators)) == units


@pytest.mark.parametrize("force", "XYN")
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_no_term_multiplies_actuators_of_two_units_and_all_differ(force: str, order: int) -> None:
    units = units_of(parse_devices(TWIN))
    found = unit_monomials(units, order, force)
    texts = [str(term) for term in found]
    assert len(set(texts)) == len(texts) == len({term.short for term in found})
    assert all(parse_monomial(text) == term for text, term in zip(texts, found, strict=True))
    for term in found:
        actions = [word for word, _ in term.factors if word.inputs]
        assert len(actions) <= 1
        if actions:
            assert [part.inputs <= set(unit) for part, unit in zip(actions[0].parts, units, strict=True)] == [True] * 2


@pytest.mark.parametrize("kind", ["twin", "vectwin", "thrusters", "esso"])
def test_the_mirror_image_of_a_state_has_the_mirror_image_of_the_force(kind: str) -> None:
    own = load_ship("esso_osaka_3m").without_network() if kind == "esso" else true_ship(kind)
    made = candidate(own, "units-order3").ship
    rng = np.random.default_rng(3)
    drawn = {
        s: float(np.clip(rng.normal(0, 0.1 * made.coefficients[s].std), *_bounds(made, s))) for s in made.monomials
    }
    ship = parse_ship(dump_ship(made.with_values(drawn)))
    screws, angles = {"n": 6.0, "n_2": 9.0}, {"delta_starboard": 0.3, "delta_port": -0.5, "delta": 0.4}
    here = velocities(ship, [0.4, 0.1, 0.05], screws | angles)
    swapped = {"n": 9.0, "n_2": 6.0} if "n_2" in ship.actuators else screws
    mirrored = {"delta_starboard": 0.5, "delta_port": -0.3, "delta": -0.4}
    there = velocities(ship, [0.4, -0.1, -0.05], swapped | mirrored)
    assert np.abs(here).min() > 1e-6
    np.testing.assert_allclose(there, here * [1, -1, -1], rtol=1e-9, atol=1e-12)


def test_the_family_is_among_the_candidates_where_there_are_units() -> None:
    names = {one.name: one.unknowns for one in candidates(true_ship("twin"))}
    assert {"units-order2", "units-order3", "units-order4"} <= set(names)
    assert names["units-order3"] < names["full-order3"]
    assert not any(one.name.startswith("units") for one in candidates(true_ship("pods")))


@pytest.mark.parametrize("text", ["times(n)", "times(n,u)", "times(n,times(n,n_2))", "times(n,mean(n,n_2))"])
def test_a_product_is_of_two_or_more_variables_of_actuators(text: str) -> None:
    with pytest.raises(ValueError, match="times"):
        parse_monomial(text)


def _bounds(ship: Ship, symbol: str) -> tuple[float, float]:
    row = ship.coefficients[symbol]
    return row.lower, row.upper

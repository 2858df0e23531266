"""The exported C gives the numbers of Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from fitting.selection.candidates import candidate
from mmg.model import columns, states_behind
from mmg.network import Layers, Network
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship
from tests.support.c_products import Compiled, compiled, product

REMEMBERING = ("rudder_lag", "rudder_backlash", "hull_memory", "velocity_filter", "current", "gyro")


def hybrid(members: int = 1, widths: tuple[int, ...] = (32, 32), name: str = "esso_osaka_3m") -> Ship:
    """A ship of the library with a network of random weights."""
    rng, ship = np.random.default_rng(7), load_ship(name)
    chosen = ship.features[::-1]
    sizes = (len(chosen), *widths, 3)
    layers = []
    for _ in range(members):
        weights = tuple(rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairwise(sizes))
        layers.append(Layers(weights, tuple(rng.normal(size=b) for b in sizes[1:-1])))
    scales, limit = rng.uniform(0.3, 2.0, len(chosen)), np.full(len(chosen), np.inf)
    return ship.with_network(Network(chosen, scales, tuple(layers), np.array([2e-3, 2e-3, 1e-3]), -limit, limit))


def remembering() -> Ship:
    """A ship with effects that remember."""
    ship = load_ship("esso_osaka_3m")
    for name in REMEMBERING:
        ship = ship.with_effect(name)
        first = next(s for s in ship.symbols if s.startswith(f"{name}."))
        c = ship.coefficients[first]
        ship = ship.with_values({first: c.value + 0.1 * c.std})
    return ship


def generated() -> Ship:
    """A ship of generated terms of any size, with the actuators of a library ship."""
    ship, rng = candidate(load_ship("esso_osaka_3m"), "sm2-order2").ship, np.random.default_rng(5)
    return ship.with_values({s: c.value + c.std * rng.normal() for s, c in ship.coefficients.items() if "_" in s[1:2]})


SHIPS: dict[str, Callable[[], Ship]] = {
    **{name: partial(load_ship, name) for name in ("esso_osaka_3m", "kvlcc2_l7", "kvlcc2_full", "mariner")},
    "twin rudders": lambda: load_ship("vectwin_3m"),
    "four pods": lambda: true_ship("pods"),
    "hybrid": hybrid,
    "hybrid of three networks of one layer": lambda: hybrid(3, (6,)),
    "hybrid of three layers": lambda: hybrid(1, (5, 7, 4)),
    "memory effects": remembering,
    "generated": generated,
}


@cache
def ship_of(name: str) -> Ship:
    return SHIPS[name]()


@pytest.fixture(scope="module", params=SHIPS)
def ship(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Compiled:
    return compiled(product(ship_of(request.param)), tmp_path_factory.mktemp("c"))


def points(of: Ship, count: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Logged columns (count, 6) and inputs (count, C) anywhere a ship may be, at rest and astern too."""
    rng, L = np.random.default_rng(3), of.particulars["L"]
    fast = np.sqrt(9.81 * L)
    six = rng.normal(size=(count, 6)) * [L, L, 2.0, 0.15 * fast, 0.05 * fast, 0.1 * fast / L]
    size = {"delta": 0.5, "azimuth": 0.5, "wind": 4.0}
    sizes = [size.get(name.partition("_")[0], 10.0 * np.sqrt(3 / L)) for name in of.inputs]
    inputs = rng.normal(size=(count, len(of.inputs))) * sizes
    six[0] = inputs[0] = 0.0
    return six, inputs


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-12) -> bool:
    """Whether each row differs by at most ``tolerance`` of its largest number."""
    found, expected = np.atleast_2d(found), np.atleast_2d(expected)
    size = np.abs(expected).max(axis=-1, keepdims=True)
    return bool((np.abs(found - expected) <= tolerance * np.maximum(size, 1e-3)).all())


@pytest.mark.slow
def test_rates_forces_columns_memory_and_jacobians_agree_with_python_also_of_other_coefficients(ship: Compiled) -> None:
    model, theta = ship.of.model, ship.of.ship.values
    z, c = ca.SX.sym("z", len(model.states)), ca.SX.sym("c", len(model.controls))
    rates = model.rates(z, c, theta)
    exact = ca.Function("jacobians", [z, c], [ca.jacobian(rates, z), ca.jacobian(rates, c)])
    for six, inputs in zip(*points(ship.of.ship), strict=True):
        state = states_behind(model, six[:, None], inputs[:, None], theta)[:, 0]
        assert close(ship.settle(six, inputs), state)
        assert close(ship.rates(state, inputs), np.array(model.rates(state, inputs, theta)).ravel())
        assert close(ship.forces(state, inputs).T, np.array(model.forces(state, inputs, theta)).T)
        assert close(ship.columns(state), columns(model, state[:, None], theta)[:, 0])
        for found, expected in zip(ship.jacobians(state, inputs), exact(state, inputs), strict=True):
            assert close(found, np.array(expected))
    other = theta * np.random.default_rng(5).uniform(0.9, 1.1, len(theta))
    state = states_behind(model, six[:, None], inputs[:, None], other)[:, 0]
    for values, given in ((other, other), (theta, None)):
        ship.init(given)
        assert close(ship.rates(state, inputs), np.array(model.rates(state, inputs, values)).ravel())


@pytest.mark.slow
def test_600_s_agree_with_the_simulator(ship: Compiled) -> None:
    h, L = 0.5, ship.of.ship.particulars["L"]
    parts = max(1, int(np.ceil(h / ship.of.longest_step - 1e-9)))
    start = np.array([0.0, 0.0, 0.3, 0.1 * np.sqrt(9.81 * L), 0.0, 0.0])
    rng = np.random.default_rng(11)
    held = np.repeat(rng.normal(size=(30, len(ship.of.model.controls))), 40, axis=0)
    names = ship.of.model.controls
    held *= [0.3 if "delta" in n or n == "azimuth" else 1.0 if n.startswith("wind") else 0.0 for n in names]
    revolutions = 0.12 * np.sqrt(9.81 * L) / (0.6 * ship.of.ship.particulars.get("D_P", 1.0))
    held[:, [n in ("n", "n_2") for n in names]] = revolutions
    state = ship.settle(start, held[0])
    python = Simulator(ship.of.ship).run(state[:, None], np.repeat(held, parts, axis=0)[:, :, None], h / parts)
    for k, inputs in enumerate(held, 1):
        state, code = ship.step(state, inputs, h)
        assert code == 0
        assert np.abs(state - python[k * parts, :, 0]).max() < 1e-9, k


@pytest.mark.slow
def test_many_ships_move_as_one_by_one_and_one_that_fails_leaves_the_others_alone(ship: Compiled) -> None:
    six, inputs = points(ship.of.ship, 17)
    starts = np.array([ship.settle(a, b) for a, b in zip(six, inputs, strict=True)])
    starts[:, 2] += np.random.default_rng(2).uniform(-300.0, 300.0, len(starts))
    starts[3, 3], starts[16, 5], starts[5, 2] = np.nan, 1e200, 3e6
    many, failed = ship.step_many(starts, inputs, 0.1)
    alone = [ship.step(start, held, 0.1) for start, held in zip(starts, inputs, strict=True)]
    assert failed == sum(code for _, code in alone) >= 1
    for k, (state, code) in enumerate(alone):
        assert np.array_equal(many[k], starts[k], equal_nan=True) if code else close(many[k], state, 1e-11)
    for h in (-0.1, np.nan, np.inf):
        same, failed = ship.step_many(starts, inputs, h)
        assert failed == 17 and np.array_equal(same, starts, equal_nan=True)
        assert ship.step(starts[0], inputs[0], h)[1] == 1
    assert ship.step_many(starts, inputs, 0.0)[1] == 0

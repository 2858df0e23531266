"""A network on a ship: zero at the origin, bounded, smooth, the same in every form, and refused by another ship."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from cases.shipfiles.network_file import NETWORK, load_network, save_network
from cases.shipfiles.ship_file import dump_ship, load_ship
from mmg.errors import BadValue, Conflict, UserError
from mmg.model import assemble
from mmg.network import Layers, Network
from mmg.rollout import Simulator
from tests.support.networks import random_layers, random_network

pytestmark = pytest.mark.usefixtures("blank_figures")
ESSO = load_ship("esso_osaka_3m")
HYBRID = ESSO.with_network(random_network(ESSO, members=2))


def scattered(ship, M: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """States (6, M) and inputs (C, M) of order 1."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(6, M)) * 0.5, rng.normal(size=(len(ship.inputs), M))


def test_it_is_exactly_zero_at_the_origin_and_nowhere_else():
    network = random_network(ESSO, members=3)
    assert np.all(network.accelerations(np.zeros((7, 4))) == 0.0)
    assert np.all(network.accelerations(np.full((7, 4), 1e-3)) != 0.0)
    hybrid, plain = (Simulator(ship).rates(np.zeros((6, 8)), np.zeros((4, 8))) for ship in (HYBRID, ESSO))
    np.testing.assert_allclose(hybrid, plain, atol=1e-16)


def test_accelerations_follow_the_published_formula():
    W1, W2, W3 = np.array([[0.5, -1.0]]), np.array([[2.0]]), np.array([[1.0], [2.0], [-3.0]])
    layers = Layers((W1, W2, W3), (np.array([0.3]), np.array([-0.7])))
    h = np.tanh(2.0 * (np.tanh(0.5 * 0.1 - 0.2 + 0.3) - np.tanh(0.3)) - 0.7) - np.tanh(-0.7)
    np.testing.assert_allclose(layers(np.array([[0.1], [0.2]]))[:, 0], h * W3[:, 0], rtol=1e-14)


def test_the_bound_holds_for_any_input_and_can_be_reached():
    network = random_network(ESSO, members=2)
    x = np.random.default_rng(0).normal(size=(7, 20000)) * 10.0 ** np.random.default_rng(1).uniform(-2, 6, 20000)
    assert np.all(np.abs(network.accelerations(x)) <= network.bound[:, None])
    one = Layers((np.array([[1.0]]), np.array([[-0.5], [0.0], [2.0]])), (np.array([-0.4]),))
    alone = Network(("n",), np.ones(1), (one,), np.array([2.0, 1.0, 1.0]), -np.ones(1), np.ones(1))
    reached = alone.accelerations(np.array([[1e3]]))[:, 0]
    np.testing.assert_allclose(np.abs(reached), alone.bound, rtol=1e-12)
    np.testing.assert_allclose(alone.bound, (1 + np.tanh(0.4)) * np.array([1.0, 0.0, 2.0]), rtol=1e-12)


def test_rates_are_those_of_the_forces_plus_the_mean_of_the_members():
    state, controls = scattered(ESSO, 16)
    added = Simulator(HYBRID).rates(state, controls) - Simulator(ESSO).rates(state, controls)
    c, s = np.cos(state[2]), np.sin(state[2])
    a_x, a_y = c * controls[2] + s * controls[3] - state[3], c * controls[3] - s * controls[2] - state[4]
    features = np.array([*state[3:6], controls[0], controls[1], a_x, a_y])
    network = HYBRID.network
    assert network is not None
    scaled = features / network.feature_scales[:, None]
    means = [network.output_scales[:, None] * member(scaled) for member in network.members]
    np.testing.assert_allclose(added[3:], np.mean(means, axis=0), atol=1e-13)
    assert np.abs(added[3:]).max() > 1e-3
    np.testing.assert_allclose(added[:3], 0.0, atol=0)


def test_features_are_velocities_through_the_water_and_the_real_rudder():
    ship = ESSO.with_effect("current", {"x": 0.2, "y": -0.1})
    features = assemble(ship, ()).features
    seen = np.array(features([0, 0, 0, 0.5, 0.1, 0.02], [9.0, 0.1, 3.0, 4.0, 0.0], []))[:, 0]
    np.testing.assert_allclose(seen, [0.3, 0.2, 0.02, 9.0, 0.1, 2.5, 3.9], rtol=1e-12)
    for ship, angle in ((ESSO, 0.1), (ESSO.with_effect("rudder_offset", {"delta": 0.05}), 0.15)):
        still = np.array(assemble(ship, ()).features(np.zeros(6), [0.0, 0.1, 0.0, 0.0], []))
        assert still[4] == pytest.approx(angle, abs=1e-12)


def test_copies_of_a_ship_keep_its_network():
    assert HYBRID.with_values({ESSO.symbols[0]: 1.0}).network is HYBRID.network
    assert HYBRID.with_effect("current").without_effect("current").network is HYBRID.network
    assert HYBRID.without_network().network is None


def test_a_feature_beyond_the_training_data_is_flagged():
    network = random_network(ESSO)
    x = np.zeros((7, 3))
    x[3, 1], x[6, 2] = 10.1, -0.6
    assert network.outside(x).tolist() == [False, True, True]


def test_a_ship_refuses_a_network_of_other_actuators_and_one_that_does_not_see_her_thruster():
    ship = load_ship("vectwin_3m")
    with pytest.raises(Conflict):
        ship.with_network(random_network(ESSO))
    network = random_network(ship)
    fewer = replace(network, features=tuple(f for f in network.features if f != ship.actuators[-1]))
    with pytest.raises(Conflict, match=f"{ship.actuators[-1]}"):
        ship.with_network(fewer)


@pytest.mark.parametrize(
    "change",
    [
        {"feature_scales": np.ones(6)}, {"feature_scales": np.zeros(7)}, {"members": ()},
        {"output_scales": np.array([1.0, np.nan, 1.0])}, {"members": (random_layers(6),)},
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused(change):
    with pytest.raises(BadValue):
        ESSO.with_network(replace(random_network(ESSO), **change))


def run_folder(tmp_path: Path) -> Path:
    (tmp_path / "ship.toml").write_text(dump_ship(HYBRID), encoding="utf-8")
    assert HYBRID.network is not None
    save_network(tmp_path / NETWORK, HYBRID.network, HYBRID)
    return tmp_path


def test_a_run_folder_gives_the_ship_with_its_network(tmp_path):
    folder = run_folder(tmp_path)
    read = load_ship(folder)
    state, controls = scattered(ESSO, 8)
    np.testing.assert_array_equal(Simulator(read).rates(state, controls), Simulator(HYBRID).rates(state, controls))
    assert read.network is not None and HYBRID.network is not None
    np.testing.assert_array_equal(read.network.upper, HYBRID.network.upper)
    assert load_ship(folder / "ship.toml").network is None


def test_edited_coefficients_keep_the_network_other_particulars_do_not(tmp_path):
    path = run_folder(tmp_path) / NETWORK
    assert load_network(path, ESSO.with_values({ESSO.symbols[0]: 1.0})).features == ESSO.features
    longer = replace(ESSO, particulars={**ESSO.particulars, "L": 1.01 * ESSO.particulars["L"]})
    with pytest.raises(UserError, match=r"network\.safetensors: .*esso"):
        load_network(path, longer)


def write_damaged(path: Path, about: dict[str, str] | None = None, without: str = "", more: str = "") -> None:
    """Another header, an array less, or one that is larger by 1e30; with none of these the header is lost."""
    with safe_open(path, framework="numpy") as file:
        header = file.metadata()
    arrays = {name: a + 1e30 * (name == more) for name, a in load_file(path).items() if name != without}
    save_file(arrays, path, header | (about or {}) if about or without or more else None)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        ({"about": {"members": "999999999999999999"}}, "999999999999999999"),
        ({"about": {"members": "-1"}}, "-1 members"),
        ({"about": {"members": "9" * 5000}}, "is incomplete"),
        ({"about": {"features": "[" * 100_000}}, "nested"),
        ({"about": {"features": "3"}}, "is incomplete"),
        ({}, None),
        *(({"more": name}, "1e") for name in ("0.weight.0", "1.bias.0", "output_scales")),
        *(({"without": name}, None) for name in ("upper", "0.weight.1", "1.bias.0", "1.weight.2")),
    ],
)
def test_a_damaged_file_is_refused_at_once(tmp_path, damage, said):
    write_damaged(run_folder(tmp_path) / NETWORK, **damage)
    began = time.perf_counter()
    with pytest.raises(UserError, match=said) as caught:
        load_ship(tmp_path)
    assert "\n" not in str(caught.value) and time.perf_counter() - began < 2


@pytest.mark.parametrize("part", [slice(0), slice(40), slice(-9)])
def test_a_file_that_is_cut_or_missing_is_refused_in_one_line(tmp_path, part):
    path = run_folder(tmp_path) / NETWORK
    path.write_bytes(path.read_bytes()[part])
    with pytest.raises(UserError) as caught:
        load_ship(tmp_path)
    assert "\n" not in str(caught.value)
    with pytest.raises(UserError):
        load_network(tmp_path / "missing.safetensors", ESSO)

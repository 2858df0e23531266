"""The serialised functions give the numbers of the model, with CasADi alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from delivery.export import export
from delivery.graphs.casadi_functions import DELAY_APPROXIMATE, write_casadi
from delivery.product import Product, product_of
from mmg.errors import Missing, NotInstalled
from mmg.model import settled
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.c_products import product
from tests.support.networks import random_network


def with_memory() -> Ship:
    ship = load_ship("esso_osaka_3m").with_effect("rudder_lag", {"T": 0.7}).with_effect("heading_bias", {"psi": 0.02})
    return ship.with_effect("current", {"x": 0.05})


def hybrid(members: int = 2) -> Ship:
    ship = load_ship("esso_osaka_3m")
    return ship.with_network(random_network(ship, members=members))


SHIPS = {"plain": lambda: load_ship("kvlcc2_l7"), "hybrid": hybrid, "memory": with_memory}


@pytest.fixture(scope="module", params=SHIPS)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Product, Path]:
    product = replace(product_of("esso_osaka_3m", force=True), ship=SHIPS[request.param]())
    folder = tmp_path_factory.mktemp("casadi") / "ship"
    export(product, "casadi", folder)
    return product, folder


def functions(folder: Path) -> dict[str, ca.Function]:
    return {path.stem: ca.Function.load(str(path)) for path in folder.glob("*.casadi")}


def same(a: ca.DM, b: ca.DM) -> bool:
    return np.allclose(np.array(a), np.array(b), rtol=1e-12, atol=1e-14)


def test_functions_are_those_of_the_model(exported: tuple[Product, Path]) -> None:
    product, folder = exported
    model, loaded, rng = product.model, functions(folder), np.random.default_rng(0)
    theta = product.ship.values
    for _ in range(5):
        z, c = 0.3 * rng.normal(size=len(model.states)), 0.3 * rng.normal(size=len(model.controls))
        c[0] += 8.0
        for name, expected in (
            ("rates", model.rates(z, c, theta)),
            ("forces", model.forces(z, c, theta)),
            ("columns", model.columns(z, theta)),
            ("initial", model.initial(z[:6], c, theta)),
        ):
            given = {"columns": (z,), "initial": (z[:6], c)}.get(name, (z, c))
            assert same(loaded[name](*given), expected), name
        moved = 1.1 * theta
        free = loaded["rates_of_coefficients"](z, c, moved)
        assert same(free, model.rates(z, c, moved))
        assert same(loaded["step_of_coefficients"](z, c, 0.1, theta), loaded["step"](z, c, 0.1))


def test_steps_are_those_of_the_simulator(exported: tuple[Product, Path]) -> None:
    product, folder = exported
    loaded, simulator = functions(folder), Simulator(product.ship, compiled=False)
    controls = np.tile(np.array([8.0, 0.4, 1.0, -1.0, *np.zeros(1)])[: len(product.model.controls)], (50, 1))
    start = np.array([0.0, 0.0, 0.1, 0.4, 0.02, 0.01])
    path = simulator.run(settled(product.model, start[:, None], controls[0], product.ship.values), controls, 0.2)
    z = np.array(loaded["initial"](start, controls[0])).ravel()
    for row in controls:
        z = np.array(loaded["step"](z, row, 0.2)).ravel()
    assert np.allclose(z, path[-1, :, 0], rtol=1e-10, atol=1e-12)


def test_the_description_names_every_row(exported: tuple[Product, Path]) -> None:
    product, folder = exported
    about = json.loads((folder / "model.json").read_text())
    assert [row["name"] for row in about["states"]] == list(product.model.states)
    assert [row["name"] for row in about["controls"]] == list(product.model.controls)
    assert [row["symbol"] for row in about["coefficients"]] == list(product.model.symbols)
    assert about["forces"]["rows"] == list(product.model.roles)
    assert set(about["functions"]) == {path.stem for path in folder.glob("*.casadi")}
    assert all(row["unit"] for row in about["controls"])


def test_a_delay_of_the_inputs_is_said_to_be_approximate(tmp_path: Path) -> None:
    late = load_ship("esso_osaka_3m").with_effect("control_delay", {"tau": 0.4})
    for ship, codes in ((late, [DELAY_APPROXIMATE]), (late.without_effect("control_delay"), [])):
        assert [m.code for m in write_casadi(product(ship), tmp_path)] == codes


# The ONNX graph gives the numbers of the network, and says what it is
NEEDS = "needs onnx and onnxruntime, which the extra dev brings"


@pytest.mark.parametrize("name", ["esso_osaka_3m", "vectwin_3m"])
@pytest.mark.parametrize("members", [1, 4])
def test_onnxruntime_gives_the_accelerations(name: str, members: int, tmp_path: Path) -> None:
    runtime, _ = pytest.importorskip("onnxruntime", reason=NEEDS), pytest.importorskip("onnx", reason=NEEDS)
    ship, path = load_ship(name), tmp_path / "residual.onnx"
    network = random_network(ship, members=members, width=32)
    lower = network.lower.copy()
    lower[0] = -np.inf
    network = replace(network, lower=lower)
    export(product(ship.with_network(network)), "onnx", path)
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    x = 0.8 * np.random.default_rng(0).normal(size=(len(network.features), 400)) * network.feature_scales[:, None]
    found, outside = session.run(None, {"features": np.ascontiguousarray(x.T)})
    expected = network.accelerations(x)
    assert found.dtype == np.float64
    assert np.abs(found.T - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.array_equal(outside, network.outside(x)) and 0 < outside.sum() < outside.size
    alone, _ = session.run(None, {"features": x[:, :1].T.copy()})
    assert np.abs(alone.T - expected[:, :1]).max() <= 1e-12 * np.abs(expected).max()
    about = session.get_modelmeta().custom_metadata_map
    rows = json.loads(about["features"])
    assert [row["name"] for row in rows] == list(network.features)
    assert [row["scale"] for row in rows] == network.feature_scales.tolist()
    assert rows[0]["lower"] is None and [row["upper"] for row in rows] == network.upper.tolist()
    assert all(row["unit"] and row["description"] for row in rows)
    assert [row["unit"] for row in json.loads(about["accelerations"])] == ["m/s^2", "m/s^2", "rad/s^2"]


def test_a_ship_without_a_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Missing, match="mmg train"):
        export(product("esso_osaka_3m"), "onnx", tmp_path / "x.onnx")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("delivery.graphs.onnx_network.find_spec", lambda name: None)
    with pytest.raises(NotInstalled, match=r"mmg-ident\[onnx\]"):
        export(product(hybrid(1)), "onnx", tmp_path / "x.onnx")
    assert list(tmp_path.iterdir()) == []

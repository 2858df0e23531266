"""The ONNX graph gives the numbers of the network, and says what it is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from delivery.export import export
from mmg.errors import NotInstalled
from mmg_ident.commands.main import main
from tests.support.c_products import product
from tests.support.networks import random_network

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


def test_the_file_is_the_same_each_time(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason=NEEDS)
    ship = load_ship("esso_osaka_3m")
    for name in ("a.onnx", "b.onnx"):
        export(product(ship.with_network(random_network(ship))), "onnx", tmp_path / name)
    assert (tmp_path / "a.onnx").read_bytes() == (tmp_path / "b.onnx").read_bytes()


def test_a_ship_without_a_network_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.onnx"
    assert main(["export", "esso_osaka_3m", "--force", "--format", "onnx", "--out", str(path), "--json"]) == 2
    error = capsys.readouterr().err.strip()
    assert error.endswith("[missing]") and "mmg train" in error and "\n" not in error
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ship = load_ship("esso_osaka_3m")
    monkeypatch.setattr("delivery.graphs.onnx_network.find_spec", lambda name: None)
    with pytest.raises(NotInstalled, match=r"mmg-ident\[onnx\]"):
        export(product(ship.with_network(random_network(ship))), "onnx", tmp_path / "x.onnx")
    assert list(tmp_path.iterdir()) == []

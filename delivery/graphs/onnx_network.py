"""The residual network of a hybrid ship as one ONNX graph in double precision, with what a reader must know inside.

Input ``features`` (N, F), output ``accelerations`` (N, 3): du, dv [m/s^2], dr [rad/s^2], to be added to those of the
forces, and ``outside`` (N,) bool: whether a feature lies outside the range of the training data. Scaling, all members
and their mean are inside the graph, with the operators Div, MatMul, Add, Tanh, Sub, Mul, Less, Greater and ReduceMax.
"""

from __future__ import annotations

import json
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from delivery.product import QUANTITIES, Product
from fitting.report.run_folder import plain
from mmg.errors import Missing, NotInstalled
from mmg.network import Layers, Network
from mmg.ship import Ship

# Features that are no states or inputs, though they are called so: words and unit.
WATER = {
    "u": ("surge velocity through the water at midship", "m/s"),
    "v": ("sway velocity through the water at midship", "m/s"),
}
ACCELERATIONS = (("du", "m/s^2"), ("dv", "m/s^2"), ("dr", "rad/s^2"))


def write_onnx(product: Product, target: Path) -> None:
    """Write the network of ``product`` to the file ``target``.

    Raises UserError for a ship without a network, and where the package onnx is missing.
    """
    ship = product.ship
    if ship.network is None:
        raise Missing(
            f"{ship.name}: has no learned residual, and ONNX holds nothing else; train one with mmg train, or export "
            "the ship as c, casadi or fmu"
        )
    if find_spec("onnx") is None:
        raise NotInstalled("the format onnx needs the package onnx; pip install 'mmg-ident[onnx]'")
    model = onnx_model(ship.network, about(ship, ship.network) | {"identifier": product.identifier})
    target.write_bytes(model.SerializeToString(deterministic=True))


def about(ship: Ship, network: Network) -> dict[str, Any]:
    """What stands in the metadata, as plain values: names, words, units, scales and ranges of the features.

    ship: that the ``network`` belongs to. A range that is not known is null.
    """
    rows = []
    for i, name in enumerate(network.features):
        words, unit = WATER.get(name) or QUANTITIES[name]
        row = {"name": name, "unit": unit, "description": words, "scale": network.feature_scales[i]}
        rows.append(row | {"lower": _finite(network.lower[i]), "upper": _finite(network.upper[i])})
    outputs = [
        {"name": name, "unit": unit, "scale": scale, "bound": bound}
        for (name, unit), scale, bound in zip(ACCELERATIONS, network.output_scales, network.bound, strict=True)
    ]
    content = {"ship": ship.called, "title": ship.title, "features": rows, "accelerations": outputs}
    return plain(content | {"members": len(network.members)})


def _finite(bound: float) -> float | None:
    return float(bound) if np.isfinite(bound) else None


def onnx_model(network: Network, metadata: dict[str, Any]) -> Any:
    """The ONNX model of ``network``, its ``metadata`` as JSON under their keys. Raises ImportError without onnx."""
    onnx: Any = import_module("onnx")
    graph = _Graph(onnx.helper)
    F = len(network.features)
    scaled = graph.node("Div", "features", graph.constant("feature_scales", network.feature_scales))
    outputs = [_member(graph, layers, scaled, k) for k, layers in enumerate(network.members)]
    total = outputs[0]
    for output in outputs[1:]:
        total = graph.node("Add", total, output)
    mean = graph.node("Div", total, graph.constant("members", np.array(float(len(outputs)))))
    graph.node("Mul", mean, graph.constant("output_scales", network.output_scales), out="accelerations")
    below = graph.node("Less", "features", graph.constant("lower", network.lower))
    above = graph.node("Greater", "features", graph.constant("upper", network.upper))
    # by way of numbers: no operator reduces Booleans
    beyond = graph.node("Cast", graph.node("Or", below, above), to=onnx.TensorProto.FLOAT)
    most = graph.node("ReduceMax", beyond, axes=[1], keepdims=0)
    graph.node("Cast", most, out="outside", to=onnx.TensorProto.BOOL)
    constants = [onnx.numpy_helper.from_array(a, name) for name, a in graph.arrays.items()]
    info = onnx.helper.make_tensor_value_info
    double, boolean = onnx.TensorProto.DOUBLE, onnx.TensorProto.BOOL
    made = onnx.helper.make_graph(
        graph.nodes,
        "residual",
        [info("features", double, ["N", F])],
        [info("accelerations", double, ["N", 3]), info("outside", boolean, ["N"])],
        constants,
        doc_string="Accelerations that a learned residual adds to those of the forces of a ship.",
    )
    model = onnx.helper.make_model(  # versions that every runtime since 2021 takes
        made, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=8, producer_name="mmg-ident"
    )
    onnx.helper.set_model_props(model, {k: v if isinstance(v, str) else json.dumps(v) for k, v in metadata.items()})
    onnx.checker.check_model(model, full_check=True)
    return model


class _Graph:
    """Nodes and constants as they are made; every node has one output."""

    def __init__(self, helper: Any) -> None:
        self.helper = helper
        self.nodes: list[Any] = []
        self.arrays: dict[str, np.ndarray] = {}

    def constant(self, name: str, values: np.ndarray) -> str:
        self.arrays[name] = np.ascontiguousarray(values, dtype=np.float64)
        return name

    def node(self, kind: str, *inputs: str, out: str = "", **attributes: Any) -> str:
        out = out or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self.helper.make_node(kind, list(inputs), [out], **attributes))
        return out


def _member(graph: _Graph, layers: Layers, x: str, k: int) -> str:
    """Outputs (N, 3) of member ``k`` of scaled features ``x`` (N, F): tanh(W x + b) - tanh(b) by layers."""
    for i, (W, b) in enumerate(zip(layers.weights[:-1], layers.biases, strict=True)):
        product = graph.node("MatMul", x, graph.constant(f"weight_{k}_{i}", W.T))
        bent = graph.node("Tanh", graph.node("Add", product, graph.constant(f"bias_{k}_{i}", b)))
        x = graph.node("Sub", bent, graph.constant(f"rest_{k}_{i}", np.tanh(b)))  # zero at the origin
    return graph.node("MatMul", x, graph.constant(f"weight_{k}_{len(layers.biases)}", layers.weights[-1].T))

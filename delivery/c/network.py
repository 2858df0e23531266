"""The residual network of a hybrid ship in C: loops over arrays of weights, and its derivatives."""

from __future__ import annotations

import numpy as np

from mmg.compile.portable_c import literal
from mmg.network import Network


def array(name: str, values: np.ndarray, kind: str = "real") -> str:
    """C text of the constant array ``name`` of this ``kind`` with ``values`` (N,) in their order."""
    numbers = [literal(float(x)) for x in np.ravel(values)]
    lines = ",\n  ".join(", ".join(numbers[i : i + 4]) for i in range(0, len(numbers), 4))
    return f"static const {kind} {name}[{len(numbers)}] = {{\n  {lines}}};\n"


TANH = """
/* tanh of an array in place: e^(2 x) - 1 of a 64th of the argument by its series, doubled six times */
static void network_tanh(real *x, int count) {
  int i;
  for (i = 0; i < count; i++) {
    const real a = x[i] > R(20.0) ? R(20.0) : (x[i] < R(-20.0) ? R(-20.0) : x[i]);
    const real y = a * R(0.03125);
    real p = R(SERIES13);
    POLYNOMIAL
    p = p * y;
    p = p * (p + R(2.0));
    p = p * (p + R(2.0));
    p = p * (p + R(2.0));
    p = p * (p + R(2.0));
    p = p * (p + R(2.0));
    p = p * (p + R(2.0));
    x[i] = p / (p + R(2.0));
  }
}
"""
"""With |y| <= 0.625 the series of 15 terms is exact to rounding."""
TERMS = 15


def _tanh() -> str:
    from math import factorial

    rows = "\n    ".join(f"p = p * y + R({1 / factorial(k)!r});" for k in range(TERMS - 1, 0, -1))
    return TANH.replace("SERIES13", repr(1 / factorial(TERMS))).replace("POLYNOMIAL", rows)


def network_c(network: Network, places: list[int]) -> str:
    """C functions ``network_add(features, rates)``, which adds the accelerations of ``network`` to rates[3..5], and
    ``network_jacobian(features, by)``, their derivatives by its inputs (3 x F rows).

    places: where in the array of the ship's features each input of the network stands.
    """
    F, text = len(places), [_tanh()]
    widest = max(len(b) for member in network.members for b in member.biases)
    share = network.output_scales / len(network.members)
    forward: list[str] = []
    backward: list[str] = []
    for k, member in enumerate(network.members):
        weights = list(member.weights)
        weights[0] = weights[0] / network.feature_scales[None, :]
        weights[-1] = share[:, None] * weights[-1]
        for i, W in enumerate(weights):
            text.append(array(f"network_{k}_weight_{i}", W.T))
        for i, b in enumerate(member.biases):
            text += [array(f"network_{k}_bias_{i}", b), array(f"network_{k}_offset_{i}", np.tanh(b))]
        forward += _forward(k, [W.shape for W in weights])
        backward += _backward(k, [W.shape for W in weights])
    gather = [f"x[{i}] = features[{place}];" for i, place in enumerate(places)]
    text.append(
        "static void network_layer(const real *weight, const real *bias, int rows, int columns, const real *x,"
        " real *y) {\n  int i, j;\n  for (i = 0; i < rows; i++) y[i] = bias[i];\n"
        "  for (j = 0; j < columns; j++) {\n    const real a = x[j];\n"
        "    for (i = 0; i < rows; i++) y[i] += weight[j * rows + i] * a;\n  }\n  network_tanh(y, rows);\n}\n"
    )
    text.append(
        "static void network_add(const real *features, real *rates) {\n"
        f"  real x[{F}], a[{widest}], b[{widest}];\n  int i;\n  "
        + "\n  ".join([*gather, *forward])
        + ("\n  (void)b;" if all(len(m.biases) == 1 for m in network.members) else "")
        + "\n}\n"
    )
    text.append(
        "static void network_jacobian(const real *features, real *by) {\n"
        f"  real x[{F}], t[{max(len(m.biases) for m in network.members)}][{widest}], g[{3 * max(widest, F)}],"
        f" k[{3 * max(widest, F)}];\n  int i, j, l;\n  "
        + "\n  ".join([*gather, f"for (i = 0; i < {3 * F}; i++) by[i] = R(0.0);", *backward])
        + "\n}\n"
    )
    return "".join(text)


def _forward(k: int, shapes: list[tuple[int, ...]]) -> list[str]:
    """Statements that add the accelerations of member ``k``, whose weights have these shapes."""
    source, lines = "x", []
    for i, (rows, columns) in enumerate(shapes[:-1]):
        target = "a" if source != "a" else "b"
        lines += [
            f"network_layer(network_{k}_weight_{i}, network_{k}_bias_{i}, {rows}, {columns}, {source}, {target});",
            f"for (i = 0; i < {rows}; i++) {target}[i] -= network_{k}_offset_{i}[i];",
        ]
        source = target
    last = len(shapes) - 1
    lines += [
        f"for (i = 0; i < {shapes[-1][1]}; i++) {{",
        *(f"  rates[{3 + j}] += network_{k}_weight_{last}[3 * i + {j}] * {source}[i];" for j in range(3)),
        "}",
    ]
    return lines


def _backward(k: int, shapes: list[tuple[int, ...]]) -> list[str]:
    """Statements that add the derivatives of member ``k``: forward with tanh kept, then backward from the outputs."""
    lines: list[str] = []
    for i, (rows, columns) in enumerate(shapes[:-1]):
        source = "x" if i == 0 else "g"
        lines.append(
            f"network_layer(network_{k}_weight_{i}, network_{k}_bias_{i}, {rows}, {columns}, {source}, t[{i}]);"
        )
        if i < len(shapes) - 2:
            lines.append(f"for (i = 0; i < {rows}; i++) g[i] = t[{i}][i] - network_{k}_offset_{i}[i];")
    last = len(shapes) - 1
    width = shapes[last][1]
    lines.append(
        f"for (j = 0; j < 3; j++) for (i = 0; i < {width}; i++)"
        f" g[j * {width} + i] = network_{k}_weight_{last}[3 * i + j];"
    )
    for layer in range(last - 1, -1, -1):
        rows, columns = shapes[layer]
        lines += [
            f"for (j = 0; j < 3; j++) for (i = 0; i < {rows}; i++)"
            f" g[j * {rows} + i] *= R(1.0) - t[{layer}][i] * t[{layer}][i];",
            f"for (j = 0; j < 3; j++) for (l = 0; l < {columns}; l++) {{",
            "  real sum = R(0.0);",
            f"  for (i = 0; i < {rows}; i++) sum += g[j * {rows} + i] * network_{k}_weight_{layer}[l * {rows} + i];",
            f"  k[j * {columns} + l] = sum;",
            "}",
            f"for (i = 0; i < {3 * columns}; i++) g[i] = k[i];",
        ]
    lines.append(f"for (i = 0; i < {3 * shapes[0][1]}; i++) by[i] += g[i];")
    return lines

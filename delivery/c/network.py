"""The residual network of a hybrid ship in C: loops over arrays of weights, and its derivatives.

Rows are filled up with zeros to whole blocks, whose loops have a fixed length: compilers make vector instructions of
them, and other code stays in registers. ``step_many`` has the network of LANES ships: weights once, lanes inside.
"""

from __future__ import annotations

from functools import reduce
from math import factorial

import numpy as np

from delivery.c.header import TEMPLATES, inserted
from mmg.compile.portable_c import LANES, literal
from mmg.network import Layers, Network

BLOCK = 8
"""Rows of a block."""
TERMS, DOUBLINGS = 15, 6
"""With |y| <= 0.625 a series of 15 terms is exact to rounding; doubled six times it serves |2 x| <= 40."""


def array(name: str, values: np.ndarray, kind: str = "real") -> str:
    """C text of the constant array ``name`` of this ``kind`` with ``values`` (N,) in their order."""
    numbers = [literal(float(x)) for x in np.ravel(values)]
    lines = ",\n  ".join(", ".join(numbers[i : i + 4]) for i in range(0, len(numbers), 4))
    return f"static const {kind} {name}[{len(numbers)}] = {{\n  {lines}}};\n"


def _series() -> str:
    """Statements for p = exp(y) - 1: even and odd terms apart, so that both may be worked at once."""
    terms = [f"R({1 / factorial(k)!r})" for k in range(1, TERMS + 1)]
    even, odd = terms[0::2], terms[1::2]
    horner = [reduce(lambda total, c: f"({total}) * q + {c}", reversed(some)) for some in (even, odd)]
    return f"const real q = y * y;\n    real p = ({horner[0]}) * y + ({horner[1]}) * q;"


def tanh_statements(x: str) -> str:
    """Statements that make p, exp(2 x) - 1, of the number with the name ``x``."""
    doubled = " ".join(["p = p * (p + R(2.0));"] * DOUBLINGS)
    return f"const real h = {x} * R({2.0 ** (1 - DOUBLINGS)!r});\n    {_series().replace('y', 'h')}\n    {doubled}"


def layer_c(rows: int, columns: int) -> str:
    """C function ``network_ROWSxCOLUMNS``: one layer of ``rows`` (whole blocks) and ``columns``."""
    template, sums = (TEMPLATES / "network_layer.c").read_text(encoding="utf-8"), range(BLOCK)
    return inserted(
        template, ROWS=rows, COLUMNS=columns, BLOCK=BLOCK, SHARE=2 ** (DOUBLINGS - 1), DOUBLINGS=DOUBLINGS,
        STARTS=", ".join(f"s{i} = bias[b + {i}]" for i in sums), SUMS=" ".join(f"s{i} += w[{i}] * a;" for i in sums),
        STORES=" ".join(f"y[b + {i}] = s{i};" for i in sums), TANH=tanh_statements("y[i]"),
    )  # fmt: skip


def _filled(rows: int) -> int:
    """The number of rows with those that fill the last block."""
    return -(-rows // BLOCK) * BLOCK


def _blocks(W: np.ndarray, columns: int) -> np.ndarray:
    """Weights (rows, columns) as blocks (B, columns, BLOCK), filled up with zeros to so many ``columns``."""
    padded = np.zeros((_filled(len(W)), columns))
    padded[: len(W), : W.shape[1]] = W
    return padded.reshape(-1, BLOCK, columns).transpose(0, 2, 1)


def _vector(values: np.ndarray) -> np.ndarray:
    """Values (rows,) filled up with zeros."""
    return np.concatenate([values, np.zeros(_filled(len(values)) - len(values))])


class _Member:
    """The code of one network of a hybrid: its arrays, and what adds its accelerations and their derivatives."""

    def __init__(self, k: int, member: Layers, scales: np.ndarray, share: np.ndarray) -> None:
        self.k, self.biases = k, member.biases
        self.weights = [member.weights[0] / scales[None, :], *member.weights[1:-1]]
        self.last = share[:, None] * member.weights[-1]
        self.columns = [len(scales), *(_filled(len(b)) for b in member.biases)]

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """(rows, columns) of its layers, filled up."""
        return list(zip(self.columns[1:], self.columns[:-1], strict=True))

    def arrays(self) -> str:
        """Weights, biases and offsets."""
        text = []
        for i, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            text.append(array(f"network_{self.k}_weight_{i}", _blocks(W, self.columns[i])))
            text += [array(f"network_{self.k}_bias_{i}", _vector(b)),
                     array(f"network_{self.k}_offset_{i}", _vector(np.tanh(b)))]  # fmt: skip
        last = np.zeros((self.columns[-1], 4))
        last[: self.last.shape[1], :3] = self.last.T
        return "".join(text) + array(f"network_{self.k}_last", last)

    def layer(self, i: int, source: str, target: str) -> str:
        """Statement that evaluates layer ``i``."""
        arrays = ", ".join(f"network_{self.k}_{name}_{i}" for name in ("weight", "bias", "offset"))
        return f"network_{self.columns[i + 1]}x{self.columns[i]}({arrays}, {source}, {target});"

    def forward(self) -> list[str]:
        """Statements that add the accelerations to a[0..2]."""
        names = ["x", *(f"y[{i % 2}]" for i in range(len(self.biases)))]
        lines = [self.layer(i, names[i], names[i + 1]) for i in range(len(self.biases))]
        lines.append(f"for (j = 0; j < {self.columns[-1]}; j++)")
        return [*lines, f"  for (i = 0; i < 4; i++) a[i] += network_{self.k}_last[4 * j + i] * {names[-1]}[j];"]

    def backward(self) -> list[str]:
        """Statements that add the derivatives to by[3 x F]: forward, then backward from the outputs."""
        names = ["x", *(f"t[{i}]" for i in range(len(self.biases)))]
        lines = [self.layer(i, names[i], names[i + 1]) for i in range(len(self.biases))]
        width = self.columns[-1]
        lines.append(f"for (j = 0; j < 3; j++) for (i = 0; i < {width}; i++)")
        lines.append(f"  g[j * {width} + i] = network_{self.k}_last[4 * i + j];")
        for layer in range(len(self.biases) - 1, -1, -1):
            rows, columns, weight = self.columns[layer + 1], self.columns[layer], f"network_{self.k}_weight_{layer}"
            lines += [
                f"for (i = 0; i < {rows}; i++) {{",
                f"  const real h = t[{layer}][i] + network_{self.k}_offset_{layer}[i];",
                f"  for (j = 0; j < 3; j++) g[j * {rows} + i] *= R(1.0) - h * h;",
                "}",
                f"for (j = 0; j < 3; j++) for (l = 0; l < {columns}; l++) {{",
                "  real sum = R(0.0);",
                f"  for (i = 0; i < {rows}; i++)",
                f"    sum += g[j * {rows} + i] * {weight}[(i / {BLOCK} * {columns} + l) * {BLOCK} + i % {BLOCK}];",
                f"  k[j * {columns} + l] = sum;",
                "}",
                f"for (i = 0; i < {3 * columns}; i++) g[i] = k[i];",
            ]
        return [*lines, f"for (i = 0; i < {3 * self.columns[0]}; i++) by[i] += g[i];"]


def network_c(network: Network, places: list[int]) -> str:
    """C functions ``network_add(features, rates)``, which adds the accelerations of ``network`` to rates[3..5], and
    ``network_jacobian(features, by)``, their derivatives by its inputs (3 x F rows).

    places: where in the array of the ship's features each input of the network stands.
    """
    share = network.output_scales / len(network.members)
    members = [_Member(k, m, network.feature_scales, share) for k, m in enumerate(network.members)]
    widest, deepest = max(max(m.columns) for m in members), max(len(m.biases) for m in members)
    gather = [f"x[{i}] = features[{place}];" for i, place in enumerate(places)]
    add = [f"real x[{len(places)}], y[2][{widest}], a[4] = {{R(0.0), R(0.0), R(0.0), R(0.0)}};", "int i, j;", *gather]
    add += [line for m in members for line in m.forward()]
    add += [f"rates[{3 + i}] += a[{i}];" for i in range(3)]
    by = [f"real x[{len(places)}], t[{deepest}][{widest}], g[{3 * widest}], k[{3 * widest}];", "int i, j, l;", *gather]
    by += [
        f"for (i = 0; i < {3 * len(places)}; i++) by[i] = R(0.0);",
        *(line for m in members for line in m.backward()),
    ]
    return "".join(
        [
            *(m.arrays() for m in members),
            *(layer_c(*shape) for shape in sorted({shape for m in members for shape in m.shapes})),
            "static void network_add(const real *features, real *rates) {\n  " + "\n  ".join(add) + "\n}\n",
            "static void network_jacobian(const real *features, real *by) {\n  " + "\n  ".join(by) + "\n}\n",
        ]
    )


def lanes_network_c(network: Network) -> str:
    """C function ``lanes_network(x, rates)``, which adds the accelerations of ``network`` to rates[3..5] of LANES ships
    at once, and the layer that it calls."""
    members = [_Member(k, m, network.feature_scales, network.output_scales) for k, m in enumerate(network.members)]
    widest = max(max(shape) for member in members for shape in member.shapes)
    lines = [f"real a[3][{LANES}], y[2][{widest}][{LANES}];", "int i, j, l;"]
    lines.append(f"for (i = 0; i < 3; i++) for (l = 0; l < {LANES}; l++) a[i][l] = R(0.0);")
    for k, member in enumerate(members):
        source = "x"
        for i, (rows, columns) in enumerate(member.shapes):
            arrays = ", ".join(f"network_{k}_{name}_{i}" for name in ("weight", "bias", "offset"))
            target = f"y[{i % 2}]"
            lines.append(f"lanes_layer({arrays}, {rows}, {columns}, {source}, {target});")
            source = target
        lines += [
            f"for (j = 0; j < {member.shapes[-1][0]}; j++) for (i = 0; i < 3; i++) for (l = 0; l < {LANES}; l++)",
            f"  a[i][l] += network_{k}_last[4 * j + i] * {source}[j][l];",
        ]
    lines.append(f"for (i = 0; i < 3; i++) for (l = 0; l < {LANES}; l++) rates[3 + i][l] += a[i][l];")
    layer = inserted(
        (TEMPLATES / "lanes_layer.c").read_text(encoding="utf-8"), BLOCK=BLOCK, LANES=LANES,
        TANH=tanh_statements("s[l]"),
        GROUP_TANH=tanh_statements("(*(const lane_group *)s)").replace("real ", "lane_group "),
    )  # fmt: skip
    body = "\n  ".join(lines)
    return f"{layer}\nstatic void lanes_network(real x[][{LANES}], real rates[][{LANES}]) {{\n  {body}\n}}\n\n"

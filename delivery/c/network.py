"""The residual network of a hybrid ship in C: loops over arrays of weights, and its derivatives.

Rows are filled up with zeros to whole blocks, whose loops have a fixed length: compilers make vector instructions of
them, and other code stays in registers. ``step_many`` has the network of LANES ships: weights once, lanes inside.
"""

from __future__ import annotations

from functools import reduce
from math import factorial
from typing import Any

import numpy as np

from mmg.compile.portable_c import literal
from mmg.network import Layers, Network

BLOCK = 8
"""Rows of a block."""
TERMS, DOUBLINGS = 15, 6
"""With |y| <= 0.625 a series of 15 terms is exact to rounding; doubled six times it serves |2 x| <= 40."""


def array(name: str, values: np.ndarray) -> str:
    """C text of the constant array ``name`` with ``values`` (N,) in their order."""
    numbers = [literal(float(x)) for x in np.ravel(values)]
    lines = ",\n  ".join(", ".join(numbers[i : i + 4]) for i in range(0, len(numbers), 4))
    return f"static const real {name}[{len(numbers)}] = {{\n  {lines}}};\n"


def tanh_statements(x: str) -> str:
    """Statements that make p, exp(2 x) - 1, of the number with the name ``x``.

    Even and odd terms of the series are apart, so that both may be worked at once.
    """
    terms = [f"R({1 / factorial(k)!r})" for k in range(1, TERMS + 1)]
    even, odd = (reduce(lambda total, c: f"({total}) * q + {c}", reversed(terms[i::2])) for i in (0, 1))
    doubled = " ".join(["p = p * (p + R(2.0));"] * DOUBLINGS)
    halved = f"const real h = {x} * R({2.0 ** (1 - DOUBLINGS)!r});\n    const real q = h * h;"
    return f"{halved}\n    real p = ({even}) * h + ({odd}) * q;\n    {doubled}"


def _filled(values: np.ndarray, columns: int = 0) -> np.ndarray:
    """Rows of ``values`` (rows,) or (rows, N) filled up with zeros to whole blocks, and to so many ``columns``."""
    more = [(0, -len(values) % BLOCK), (0, columns - values.shape[-1])][: values.ndim]
    return np.pad(values, more)


class Member:
    """One network of a hybrid: its arrays, and the calls of its layers, as the templates take them.

    number: among the networks; share: by which its outputs are multiplied (3,).
    """

    def __init__(self, number: int, layers: Layers, scales: np.ndarray, share: np.ndarray) -> None:
        self.number, self.depth = number, len(layers.biases)
        columns = [len(scales), *(len(_filled(b)) for b in layers.biases)]
        self.shapes = list(zip(columns[1:], columns[:-1], strict=True))
        """(rows, columns) of its layers, filled up."""
        self.width = columns[-1]
        weights = [layers.weights[0] / scales[None, :], *layers.weights[1:-1]]
        last = np.zeros((self.width, 4))
        last[: len(layers.biases[-1]), :3] = (share[:, None] * layers.weights[-1]).T
        self.arrays = ""
        for i, (W, b) in enumerate(zip(weights, layers.biases, strict=True)):
            blocks = _filled(W, columns[i]).reshape(-1, BLOCK, columns[i]).transpose(0, 2, 1)
            rows = {"weight": blocks, "bias": _filled(b), "offset": _filled(np.tanh(b))}
            self.arrays += "".join(array(f"network_{number}_{name}_{i}", values) for name, values in rows.items())
        self.arrays += array(f"network_{number}_last", last)

    def _constants(self, i: int) -> str:
        return ", ".join(f"network_{self.number}_{name}_{i}" for name in ("weight", "bias", "offset"))

    def layers(self, *results: str) -> list[str]:
        """Calls of its layers one after the other, from x into ``results`` in turn."""
        names = ["x", *(results[i % len(results)] for i in range(self.depth))]
        shapes = enumerate(self.shapes)
        return [f"{rows}x{n}({self._constants(i)}, {names[i]}, {names[i + 1]})" for i, (rows, n) in shapes]

    @property
    def lane_layers(self) -> list[str]:
        """The same calls for several ships at once."""
        names = ["x", *(f"y[{i % 2}]" for i in range(self.depth))]
        shapes = enumerate(self.shapes)
        return [f"layer({self._constants(i)}, {rows}, {n}, {names[i]}, {names[i + 1]})" for i, (rows, n) in shapes]


def network_words(network: Network) -> dict[str, Any]:
    """What the templates of a ``network`` take."""
    share = network.output_scales / len(network.members)
    members = [Member(k, m, network.feature_scales, share) for k, m in enumerate(network.members)]
    deepest = max(member.depth for member in members)
    return {
        "MEMBERS": members, "ARRAYS": [member.arrays for member in members], "DEEPEST": deepest,
        "SHAPES": sorted({shape for member in members for shape in member.shapes}),
        "WIDEST": max(max(map(max, member.shapes)) for member in members), "T": [f"t[{i}]" for i in range(deepest)],
        "BLOCK": BLOCK, "DOUBLINGS": DOUBLINGS, "SHARE": 2 ** (DOUBLINGS - 1), "tanh": tanh_statements,
    }  # fmt: skip

"""A CasADi function at many points without a compiler: each instruction is one numpy operation on a block of points.

CasADi's virtual machine takes one point after the other. numpy's loops over points are compiled code, but each call of
one costs as much as a hundred points do: it pays from FEWEST points on. The work of a block stays in the cache.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

FEWEST = 192
"""Points from which numpy is faster than the virtual machine."""
BLOCK = 2048
"""Points worked on at once."""
Operation = Callable[..., Any]


def _twice(x: np.ndarray, out: np.ndarray) -> None:
    np.add(x, x, out=out)


def _if_else_zero(condition: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    out[...] = np.where(condition != 0.0, x, 0.0)


def _erf(x: np.ndarray, out: np.ndarray) -> None:
    from scipy.special import erf  # late: slow to import, and few ships have one

    erf(x, out=out)


OPERATIONS: dict[int, Operation] = {
    ca.OP_ASSIGN: np.positive, ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply, ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative, ca.OP_SQ: np.square, ca.OP_TWICE: _twice, ca.OP_INV: np.reciprocal, ca.OP_SQRT: np.sqrt,
    ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan, ca.OP_ASIN: np.arcsin, ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan, ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh, ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log, ca.OP_LOG1P: np.log1p, ca.OP_EXPM1: np.expm1, ca.OP_ERF: _erf, ca.OP_FABS: np.fabs,
    ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil, ca.OP_SIGN: np.sign, ca.OP_POW: np.power, ca.OP_CONSTPOW: np.power,
    ca.OP_ATAN2: np.arctan2, ca.OP_FMIN: np.fmin, ca.OP_FMAX: np.fmax, ca.OP_FMOD: np.fmod, ca.OP_HYPOT: np.hypot,
    ca.OP_COPYSIGN: np.copysign, ca.OP_LT: np.less, ca.OP_LE: np.less_equal, ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal, ca.OP_NOT: np.logical_not, ca.OP_AND: np.logical_and, ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
}  # fmt: skip
"""What each CasADi operation is in numpy: a function of its operands that writes into ``out``."""


class VectorisedFunction:
    """An SXFunction as a list of numpy operations on its work arrays."""

    def __init__(self, function: ca.Function) -> None:
        """Raises NotImplementedError for an operation that numpy lacks."""
        self.function = function
        self._steps = [self._step(k) for k in range(function.n_instructions())]

    def _step(self, k: int) -> Callable[[list[np.ndarray], Sequence[np.ndarray], Sequence[np.ndarray]], None]:
        """Instruction ``k`` as a function of work arrays, inputs and results."""
        f, operation = self.function, self.function.instruction_id(k)
        inputs, outputs = f.instruction_input(k), f.instruction_output(k)
        if operation == ca.OP_CONST:
            return partial(_constant, outputs[0], f.instruction_constant(k))
        if operation == ca.OP_INPUT:
            return partial(_read, outputs[0], inputs[0], inputs[1])
        if operation == ca.OP_OUTPUT:
            return partial(_written, inputs[0], outputs[0], outputs[1])
        if operation not in OPERATIONS:
            raise NotImplementedError(f"no numpy function for CasADi operation {operation}")
        if len(inputs) == 1:
            return partial(_one, OPERATIONS[operation], outputs[0], inputs[0])
        return partial(_two, OPERATIONS[operation], outputs[0], inputs[0], inputs[1])

    @np.errstate(all="ignore")
    def __call__(self, points: int, inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Results (nonzeros, points) each, of ``inputs`` (nonzeros, points), or (nonzeros,) that all points share."""
        f = self.function
        results = [np.zeros((f.nnz_out(j), points)) for j in range(f.n_out())]
        work = np.empty((f.sz_w(), min(points, BLOCK)))
        for begin in range(0, points, BLOCK):
            end = min(begin + BLOCK, points)
            w, r = list(work[:, : end - begin]), [each[:, begin:end] for each in results]
            own = [a if a.ndim == 1 else a[:, begin:end] for a in inputs]
            for step in self._steps:
                step(w, own, r)
        return results


def _constant(to: int, value: float, w: list[np.ndarray], _: Sequence[np.ndarray], __: Sequence[np.ndarray]) -> None:
    w[to].fill(value)


def _read(to: int, i: int, k: int, w: list[np.ndarray], x: Sequence[np.ndarray], _: Sequence[np.ndarray]) -> None:
    w[to][...] = x[i][k]


def _written(at: int, i: int, k: int, w: list[np.ndarray], _: Sequence[np.ndarray], r: Sequence[np.ndarray]) -> None:
    r[i][k] = w[at]


def _one(f: Operation, to: int, a: int, w: list[np.ndarray], _: Sequence[np.ndarray], __: Sequence[np.ndarray]) -> None:
    f(w[a], out=w[to])


def _two(
    f: Operation, to: int, a: int, b: int, w: list[np.ndarray], _: Sequence[np.ndarray], __: Sequence[np.ndarray]
) -> None:
    f(w[a], w[b], out=w[to])

"""Torch code from the instruction list of a CasADi function, for any device and floating type, with torch's gradients.

The same list from which ``mmg.compile.codegen`` makes C becomes a sequence of torch operations on vectors of points.
Run eagerly it launches one small kernel per instruction, which is slow: give the result to ``torch.compile``.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import casadi as ca
import torch
from torch import Tensor

from residual.physics.operator import Physics, dense


def _both_tensors(f: Callable[[Tensor, Tensor], Tensor]) -> Callable[[Any, Any], Tensor]:
    """f for operands of which one may be a number."""

    def applied(a: Any, b: Any) -> Tensor:
        like = a if isinstance(a, Tensor) else b
        a, b = (x if isinstance(x, Tensor) else torch.full_like(like, x) for x in (a, b))
        return f(a, b)

    return applied


def _compared(f: Callable[[Tensor, Tensor], Tensor]) -> Callable[[Any, Any], Tensor]:
    """1.0 where f holds, else 0.0, as CasADi's comparisons give."""
    return _both_tensors(lambda a, b: f(a, b).to(a.dtype))


_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
    ca.OP_NEG: operator.neg,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: 2.0 * a,
    ca.OP_INV: lambda a: 1.0 / a,
    ca.OP_SQRT: torch.sqrt,
    ca.OP_SIN: torch.sin,
    ca.OP_COS: torch.cos,
    ca.OP_TAN: torch.tan,
    ca.OP_ASIN: torch.asin,
    ca.OP_ACOS: torch.acos,
    ca.OP_ATAN: torch.atan,
    ca.OP_SINH: torch.sinh,
    ca.OP_COSH: torch.cosh,
    ca.OP_TANH: torch.tanh,
    ca.OP_EXP: torch.exp,
    ca.OP_LOG: torch.log,
    ca.OP_FABS: torch.abs,
    ca.OP_FLOOR: torch.floor,
    ca.OP_CEIL: torch.ceil,
    ca.OP_ERF: torch.erf,
    ca.OP_LOG1P: torch.log1p,
    ca.OP_EXPM1: torch.expm1,
    ca.OP_SIGN: torch.sign,
    ca.OP_POW: torch.pow,
    ca.OP_CONSTPOW: torch.pow,
    ca.OP_ATAN2: _both_tensors(torch.atan2),
    ca.OP_FMIN: _both_tensors(torch.minimum),
    ca.OP_FMAX: _both_tensors(torch.maximum),
    ca.OP_FMOD: torch.fmod,
    ca.OP_HYPOT: _both_tensors(torch.hypot),
    ca.OP_COPYSIGN: _both_tensors(torch.copysign),
    ca.OP_LT: _compared(torch.lt),
    ca.OP_LE: _compared(torch.le),
    ca.OP_EQ: _compared(torch.eq),
    ca.OP_NE: _compared(torch.ne),
    ca.OP_NOT: lambda a: (a == 0).to(a.dtype),
    ca.OP_AND: _compared(torch.logical_and),
    ca.OP_OR: _compared(torch.logical_or),
    ca.OP_IF_ELSE_ZERO: _both_tensors(lambda c, x: torch.where(c != 0, x, 0.0)),
}


def emitted(function: ca.Function) -> Callable[..., tuple[Tensor, ...]]:
    """The SXFunction as a torch callable: inputs (rows, M) or (rows, 1) -> outputs (nonzeros, M).

    Raises NotImplementedError for an operation that torch lacks.
    """
    program: list[tuple[int, Callable[..., Any] | float | None, list[int], list[int]]] = []
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        what = function.instruction_constant(k) if code == ca.OP_CONST else _OPERATIONS.get(code)
        if what is None and code not in (ca.OP_INPUT, ca.OP_OUTPUT):
            raise NotImplementedError(f"no torch operation for CasADi operation {code}")
        program.append((code, what, function.instruction_input(k), function.instruction_output(k)))
    slots, rows = max(function.sz_w(), 1), [function.nnz_out(j) for j in range(function.n_out())]

    def run(*inputs: Tensor) -> tuple[Tensor, ...]:
        points = max(a.shape[1] for a in inputs)
        split = [a.expand(-1, points).unbind(0) for a in inputs]
        work: list[Any] = [None] * slots
        results: list[list[Any]] = [[inputs[0].new_zeros(points)] * n for n in rows]
        for code, what, used, made in program:
            if code == ca.OP_INPUT:
                work[made[0]] = split[used[0]][used[1]]
            elif code == ca.OP_OUTPUT:
                value = work[used[0]]
                results[made[0]][made[1]] = value if isinstance(value, Tensor) else inputs[0].new_full((points,), value)
            else:
                work[made[0]] = what(*[work[i] for i in used]) if callable(what) else what
        return tuple(torch.stack(part) for part in results)

    return run


class TorchPhysics(Physics):
    """The right-hand side of a ship in the type and on the device of its tensors."""

    def make(self, name: str) -> Callable[..., tuple[Tensor, ...]]:
        return emitted(dense(self.functions[name]))

"""A CasADi function at many points without a compiler: each instruction is one numpy operation on a block of points.

CasADi's virtual machine takes one point after the other. numpy's loops over points are compiled code, but each call of
one costs as much as a hundred points do: it pays from FEWEST points on. The work of a block stays in the cache.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from mmg.compile.stages import Program

FEWEST = 160
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


_SHARED, _OWN = 1, 2
"""Stages of values: those that all points share, constants among them, are worked out once a call."""


@dataclass(frozen=True)
class _Plan:
    """Order of work for inputs of which some are shared.

    Values go by their place in the program. constants: 0-d arrays; given_shared, given_own: (place, argument, element)
    of the inputs; shared: (operation, place of the result, places of the operands); own: the same with the buffer of
    the result after its place; results: (output, nonzero, place) of each; buffers: how many of them.
    """

    constants: dict[int, np.ndarray]
    given_shared: list[tuple[int, int, int]]
    given_own: list[tuple[int, int, int]]
    shared: list[tuple[Operation, int, tuple[int, ...]]]
    own: list[tuple[Operation, int, int, tuple[int, ...]]]
    results: list[tuple[int, int, int]]
    buffers: int


class VectorisedFunction:
    """An SXFunction as a list of numpy operations on work arrays."""

    def __init__(self, function: ca.Function) -> None:
        """Raises NotImplementedError for an operation that numpy lacks."""
        self.function = function
        known = {*OPERATIONS, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
        for k in range(function.n_instructions()):
            if function.instruction_id(k) not in known:
                raise NotImplementedError(f"no numpy function for CasADi operation {function.instruction_id(k)}")
        self._plans: dict[tuple[bool, ...], _Plan] = {}

    def _plan(self, shared: tuple[bool, ...]) -> _Plan:
        """The work for inputs that are ``shared`` or not."""
        program = Program.of(self.function, [_SHARED if one else _OWN for one in shared])
        outputs = range(self.function.n_out())
        results = [
            (j, k, place)
            for j in outputs
            for k, place in enumerate(place for place in program.results[j] if place is not None)
        ]
        kept, last = {place for _, _, place in results}, {}
        needed = program.needed(outputs, -1)
        for number, place in enumerate(needed):
            last.update(dict.fromkeys(program.values[place].operands, number))
        constants: dict[int, np.ndarray] = {}
        given: dict[int, list[tuple[int, int, int]]] = {_SHARED: [], _OWN: []}
        plan = _Plan(constants, given[_SHARED], given[_OWN], [], [], results, 0)
        buffer: dict[int, int] = {}
        free: list[int] = []
        count = 0
        for number, place in enumerate(needed):
            value = program.values[place]
            if value.operation == ca.OP_CONST:
                constants[place] = np.array(value.number)
            elif value.argument is not None:
                given[value.stage].append((place, *value.argument))
            elif value.stage < _OWN:
                plan.shared.append((OPERATIONS[value.operation], place, value.operands))
            else:
                for operand in set(value.operands):  # whose buffer the result may take
                    if last[operand] == number and operand in buffer and operand not in kept:
                        free.append(buffer[operand])
                if not free:
                    free.append(count)
                    count += 1
                buffer[place] = free.pop()
                plan.own.append((OPERATIONS[value.operation], place, buffer[place], value.operands))
        return replace(plan, buffers=count)

    @np.errstate(all="ignore")
    def __call__(self, points: int, inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Results (nonzeros, points) each, of ``inputs`` (nonzeros, points), or (nonzeros,) that all points share."""
        f, shared = self.function, tuple(a.ndim == 1 for a in inputs)
        plan = self._plans.get(shared) or self._plans.setdefault(shared, self._plan(shared))
        found = [np.zeros((f.nnz_out(j), points)) for j in range(f.n_out())]
        inputs = [np.asarray(a, dtype=float) for a in inputs]
        same = dict(plan.constants)
        for place, i, k in plan.given_shared:
            same[place] = inputs[i][k, ...]
        for operation, place, operands in plan.shared:
            same[place] = np.empty(())
            operation(*[same[each] for each in operands], same[place])
        work = np.empty((plan.buffers, min(points, BLOCK)))
        for begin in range(0, points, BLOCK):
            end = min(begin + BLOCK, points)
            w, buffers = dict(same), list(work[:, : end - begin])
            for place, i, k in plan.given_own:
                w[place] = inputs[i][k, begin:end]
            for operation, place, to, operands in plan.own:
                out = w[place] = buffers[to]
                if len(operands) == 2:
                    operation(w[operands[0]], w[operands[1]], out)
                else:
                    operation(w[operands[0]], out)
            for j, k, place in plan.results:
                found[j][k, begin:end] = w[place]
        return found


def by_numpy(function: ca.Function) -> VectorisedFunction | None:
    """The SXFunction ``function`` by numpy, None where numpy lacks an operation of it."""
    try:
        return VectorisedFunction(function)
    except NotImplementedError:
        return None

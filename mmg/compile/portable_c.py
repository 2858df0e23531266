"""Portable C99 of a staged program: plain calls of the C library on scalars, one statement per value.

No CasADi, no allocation, no globals, and none of the tricks that rest on the rounding of sums, so that the code may be
compiled with -ffast-math. ``real`` is the type of all numbers and ``R(x)`` a literal of it; ``m_sin`` and the like are
the functions of the C library for that type (``PRELUDE``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import casadi as ca

from mmg.compile.stages import CONSTANT, Program

_ONE: tuple[str, ...] = ("sqrt", "exp", "log", "expm1", "log1p", "erf", "fabs", "floor", "ceil")
_ONE += ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh")
_TWO = ("pow", "atan2", "fmin", "fmax", "fmod", "hypot", "copysign")

EXPRESSIONS: dict[int, str] = {
    **{getattr(ca, f"OP_{name.upper()}"): f"m_{name}({{0}})" for name in _ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"m_{name}({{0}}, {{1}})" for name in _TWO},
    ca.OP_CONSTPOW: "m_pow({0}, {1})",
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "R(2.0) * {0}",
    ca.OP_INV: "R(1.0) / {0}",
    ca.OP_LT: "({0} < {1}) ? R(1.0) : R(0.0)",
    ca.OP_LE: "({0} <= {1}) ? R(1.0) : R(0.0)",
    ca.OP_EQ: "({0} == {1}) ? R(1.0) : R(0.0)",
    ca.OP_NE: "({0} != {1}) ? R(1.0) : R(0.0)",
    ca.OP_NOT: "({0} == R(0.0)) ? R(1.0) : R(0.0)",
    ca.OP_AND: "({0} != R(0.0) && {1} != R(0.0)) ? R(1.0) : R(0.0)",
    ca.OP_OR: "({0} != R(0.0) || {1} != R(0.0)) ? R(1.0) : R(0.0)",
    ca.OP_SIGN: "({0} > R(0.0)) ? R(1.0) : (({0} < R(0.0)) ? R(-1.0) : R(0.0))",
    ca.OP_IF_ELSE_ZERO: "({0} != R(0.0)) ? {1} : R(0.0)",
}
"""C expression of each CasADi operation on its operands."""
_POWERS = {2.0: "{0} * {0}", 3.0: "{0} * {0} * {0}", 4.0: "({0} * {0}) * ({0} * {0})", 0.5: "m_sqrt({0})"}
"""Powers that need no call, or a cheaper one."""


def functions_used(program: Program, outputs: Iterable[int]) -> list[str]:
    """Names of the C library's functions that lead to ``outputs`` of a ``program``, in alphabetical order."""
    used = {program.values[i].operation for i in program.needed(outputs)}
    texts = " ".join(EXPRESSIONS.get(operation, "") for operation in used) + " m_sqrt("
    return sorted(name for name in (*_ONE, *_TWO) if f"m_{name}(" in texts)


def literal(number: float) -> str:
    """C literal of a number of the type ``real``. Raises NotImplementedError for one that is not finite: under
    -ffast-math it has no meaning."""
    if not math.isfinite(number):
        raise NotImplementedError(f"the equations hold the number {number}")
    return f"R({number!r})"


class Emitter:
    """Writes statements for the values of a program.

    program: staged; arguments: argument -> C text of its elements, such as "state[{0}]"; kept: place -> C text of
    what an earlier stage has left behind. Another language overrides ``expressions`` and what follows: powers that need
    no call, the form of a statement, the number of the first element of an array, literals.
    """

    expressions, powers, statement, first = EXPRESSIONS, _POWERS, "const real w{0} = {1};", 0

    def __init__(self, program: Program, arguments: Mapping[int, str], kept: Mapping[int, str]) -> None:
        self.program, self.arguments, self.kept = program, arguments, dict(kept)

    def literal(self, number: float) -> str:
        """Text of a ``number``."""
        return literal(number)

    def name(self, place: int | None) -> str:
        """C text of the value at a ``place`` that is known by now; a structural zero (None) is zero."""
        if place is None:
            return self.literal(0.0)
        value = self.program.values[place]
        if value.stage == CONSTANT and not value.operands:
            return self.literal(value.number)
        if value.argument:
            return self.arguments[value.argument[0]].format(value.argument[1] + self.first)
        return self.kept.get(place, f"w{place}")

    def statements(self, places: Sequence[int]) -> list[str]:
        """One statement ``const real w12 = ...;`` for each value of ``places`` that is neither kept nor an argument;
        constants that they are made of come first. Raises NotImplementedError for an operation without C."""
        values, folded = self.program.values, set()
        todo = [i for place in places for i in values[place].operands]
        while todo:  # values that are made of constants alone
            place = todo.pop()
            if values[place].stage == CONSTANT and values[place].operands and place not in folded:
                folded.add(place)
                todo += values[place].operands
        chosen = sorted({*folded, *places})
        return [
            self.statement.format(place, self._expression(place))
            for place in chosen
            if place not in self.kept and values[place].argument is None
        ]

    def _expression(self, place: int) -> str:
        value, values = self.program.values[place], self.program.values
        names = [self.name(i) for i in value.operands]
        if value.operation in (ca.OP_POW, ca.OP_CONSTPOW):
            exponent = values[value.operands[1]]
            if exponent.stage == CONSTANT and not exponent.operands and exponent.number in self.powers:
                return self.powers[exponent.number].format(*names)
        if value.operation not in self.expressions:
            raise NotImplementedError(f"no C for CasADi operation {value.operation}")
        return self.expressions[value.operation].format(*names)


def prelude(functions: Sequence[str], single: str) -> str:
    """Macros for literals and for the ``functions`` of the C library, of float where the macro ``single`` is defined,
    else of double."""
    lines = [f"#ifdef {single}", *(f"#define m_{name} {name}f" for name in functions)]
    lines += ["#else", *(f"#define m_{name} {name}" for name in functions), "#endif", "#define R(x) ((real)(x))"]
    return "\n".join(lines) + "\n"

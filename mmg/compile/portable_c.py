"""Portable C99 of a staged program: plain calls of the C library on scalars, one statement per value.

No CasADi, no allocation, no globals, and none of the tricks that rest on the rounding of sums, so that the code may be
compiled with -ffast-math. ``real`` is the type of all numbers and ``R(x)`` a literal of it; ``m_sin`` and the like are
the functions of the C library for that type (``PRELUDE``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

import casadi as ca

from mmg.compile import codegen
from mmg.compile.codegen import ARITHMETIC, COMPARISONS, CONSTANT, LANES, OF_ONE, OF_TWO, Program, calls

# C expression of each CasADi operation on its operands.
EXPRESSIONS: dict[int, str] = {
    **calls("m_"),
    **ARITHMETIC,
    **{operation: f"({{0}} {sign} {{1}}) ? R(1.0) : R(0.0)" for operation, sign in COMPARISONS.items()},
    ca.OP_DIV: "{0} / {1}",
    ca.OP_TWICE: "R(2.0) * {0}",
    ca.OP_INV: "R(1.0) / {0}",
    ca.OP_NOT: "({0} == R(0.0)) ? R(1.0) : R(0.0)",
    ca.OP_AND: "({0} != R(0.0) && {1} != R(0.0)) ? R(1.0) : R(0.0)",
    ca.OP_OR: "({0} != R(0.0) || {1} != R(0.0)) ? R(1.0) : R(0.0)",
    ca.OP_SIGN: "({0} > R(0.0)) ? R(1.0) : (({0} < R(0.0)) ? R(-1.0) : R(0.0))",
    ca.OP_IF_ELSE_ZERO: "({0} != R(0.0)) ? {1} : R(0.0)",
}
# Powers that need no call, or a cheaper one.
_POWERS = {2.0: "{0} * {0}", 3.0: "{0} * {0} * {0}", 4.0: "({0} * {0}) * ({0} * {0})", 0.5: "m_sqrt({0})"}


def functions_used(program: Program, outputs: Iterable[int]) -> list[str]:
    """Names of the C library's functions that lead to ``outputs`` of a ``program``, in alphabetical order."""
    used = {program.values[i].operation for i in program.needed(outputs)}
    texts = " ".join(EXPRESSIONS.get(operation, "") for operation in used) + " m_sqrt("
    return sorted(name for name in (*OF_ONE, *OF_TWO) if f"m_{name}(" in texts)


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
        while todo:  # values that are made of constants alone: no list of a stage holds them
            place = todo.pop()
            if values[place].stage == CONSTANT and values[place].operands and place not in folded:
                folded.add(place)
                todo += values[place].operands
        chosen = sorted({*folded, *places})  # places are in the order of the program: operands come first
        return [
            self.statement.format(place, self._expression(place))
            for place in chosen
            if place not in self.kept and values[place].argument is None
        ]

    def _expression(self, place: int) -> str:
        value, values = self.program.values[place], self.program.values
        names = [self.name(i) for i in value.operands]
        if value.operation in (ca.OP_POW, ca.OP_CONSTPOW):
            exponent = values[value.operands[1]]  # CasADi keeps it as an operand, also where it is a number
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


# Operations of which LANES values are made at once, where the C library has one value a call.
OWN = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TANH: "tanh", ca.OP_ATAN2: "atan2"}


class LaneEmitter(Emitter):
    """Writes statements for LANES points: arguments and kept values that differ between points end in ``[l]``."""

    def name(self, place: int | None) -> str:
        """C text of the value at a ``place``, that of lane l."""
        text = super().name(place)
        return f"{text}[l]" if text.startswith("w") else text

    def lines(self, places: list[int]) -> list[str]:
        """Statements for the values of ``places`` and the constants behind them."""
        return [self._loop(line) for line in self.statements(places)]

    def _loop(self, line: str) -> str:
        name, value = line.removeprefix("const real ").split(" = ", 1)
        operation = self.program.values[int(name[1:])].operation
        head = f"real {name}[{LANES}]; "
        if operation not in OWN:
            return f"{head}for (l = 0; l < {LANES}; l++) {name}[l] = {value}"
        parts = [self.name(i) for i in self.program.values[int(name[1:])].operands]
        copies = " ".join(f"a{k}[l] = {text};" for k, text in enumerate(parts))
        arrays = ", ".join(f"a{k}" for k in range(len(parts)))
        return f"{head}for (l = 0; l < {LANES}; l++) {{ {copies} }} odd |= lanes_{OWN[operation]}({arrays}, {name});"


def lane_functions(program: Program, outputs: list[int], tanh: str) -> str:
    """C text of the functions for LANES points that lead to ``outputs`` of a ``program``. tanh: statements that make p,
    exp(2 x) - 1, of x[l]."""
    used = {OWN[o] for o in {program.values[i].operation for i in program.needed(outputs, CONSTANT)} if o in OWN}
    series = {"sine": codegen.SINE, "cosine": codegen.COSINE, "arc": codegen.ARC}
    polynomials = {name: codegen.horner(c, "({0} * z + {1})", "R({0})") for name, c in series.items()}
    # the functions of the file, by what follows lanes_ in their names, are divided by empty lines
    parts = codegen.c_file(__file__, "lanes.c", lanes=LANES, **polynomials).strip().split("\n\n")
    by_name = {re.findall(r" lanes_(\w+)", part)[0]: f"{part}\n" for part in parts}
    called = (["odd"] if used - {"tanh"} else []) + (["wave"] if used & {"sin", "cos"} else [])
    return "".join(by_name[name] for name in [*called, *sorted(used)]).replace("@tanh@", tanh)

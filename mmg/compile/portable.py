"""Portable C99 of a staged program: plain calls of the C library on scalars, one statement per value; and the same in
statements of MATLAB and Octave.

No CasADi, no allocation, no globals, and none of the tricks that rest on the rounding of sums, so that the code may be
compiled with -ffast-math. ``real`` is the type of all numbers and ``R(x)`` a literal of it; ``m_sin`` and the like are
the functions of the C library for that type (``PRELUDE``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

import casadi as ca

from mmg.compile import codegen
from mmg.compile.codegen import ARITHMETIC, COMPARISONS, CONSTANT, LANES, OF_ONE, OF_TWO, Emitter, Program, calls

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


class PortableEmitter(Emitter):
    """Writes statements of portable C."""

    expressions, powers, statement = EXPRESSIONS, _POWERS, "const real w{0} = {1};"

    def literal(self, number: float) -> str:
        """C text of a ``number``."""
        return literal(number)


def prelude(functions: Sequence[str], single: str) -> str:
    """Macros for literals and for the ``functions`` of the C library, of float where the macro ``single`` is defined,
    else of double."""
    lines = [f"#ifdef {single}", *(f"#define m_{name} {name}f" for name in functions)]
    lines += ["#else", *(f"#define m_{name} {name}" for name in functions), "#endif", "#define R(x) ((real)(x))"]
    return "\n".join(lines) + "\n"


# Operations of which LANES values are made at once, where the C library has one value a call.
OWN = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TANH: "tanh", ca.OP_ATAN2: "atan2"}


class LaneEmitter(PortableEmitter):
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


# M expression of each CasADi operation; ``when`` is a function of the file that holds the statements.
M_EXPRESSIONS: dict[int, str] = {
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}})" for name in OF_ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}}, {{1}})" for name in ("atan2", "hypot")},
    **ARITHMETIC,
    ca.OP_FABS: "abs({0})",  # functions of another name than in C
    ca.OP_FMIN: "min({0}, {1})",
    ca.OP_FMAX: "max({0}, {1})",
    ca.OP_FMOD: "rem({0}, {1})",
    ca.OP_COPYSIGN: "abs({0}) * (1 - 2 * ({1} < 0))",
    ca.OP_POW: "{0} ^ {1}",
    ca.OP_CONSTPOW: "{0} ^ {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_TWICE: "2 * {0}",
    ca.OP_INV: "1 / {0}",
    ca.OP_LT: "double({0} < {1})",
    ca.OP_LE: "double({0} <= {1})",
    ca.OP_EQ: "double({0} == {1})",
    ca.OP_NE: "double({0} ~= {1})",  # MATLAB's sign, which Octave knows too
    ca.OP_NOT: "double({0} == 0)",
    ca.OP_AND: "double({0} ~= 0 && {1} ~= 0)",
    ca.OP_OR: "double({0} ~= 0 || {1} ~= 0)",
    ca.OP_SIGN: "sign({0})",
    ca.OP_IF_ELSE_ZERO: "when({0}, {1})",
}
WHEN = """
function x = when(condition, x)
  if condition == 0
    x = 0;
  end
end
"""


def m_number(number: float) -> str:
    """M text of a ``number``, a negative one in parentheses."""
    if math.isnan(number) or math.isinf(number):
        return "NaN" if math.isnan(number) else "Inf" if number > 0 else "(-Inf)"
    return repr(float(number)) if math.copysign(1.0, number) > 0 else f"({float(number)!r})"


class MEmitter(Emitter):
    """Writes statements of MATLAB: arguments count from 1."""

    expressions, powers, statement, first = M_EXPRESSIONS, {2.0: "{0} * {0}"}, "w{0} = {1};", 1

    def literal(self, number: float) -> str:
        """M text of a ``number``."""
        return m_number(number)

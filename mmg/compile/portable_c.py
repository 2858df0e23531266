"""Portable C99 of a staged program: plain calls of the C library on scalars, one statement per value.

No CasADi, no allocation, no globals, and none of the tricks that rest on the rounding of sums, so that the code may be
compiled with -ffast-math. ``real`` is the type of all numbers and ``R(x)`` a literal of it; ``m_sin`` and the like are
the functions of the C library for that type (``PRELUDE``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import casadi as ca

from mmg.compile.codegen import ARC, LANES, OF_ONE, OF_TWO, inverse_factorials
from mmg.compile.stages import CONSTANT, Program

# C expression of each CasADi operation on its operands.
EXPRESSIONS: dict[int, str] = {
    **{getattr(ca, f"OP_{name.upper()}"): f"m_{name}({{0}})" for name in OF_ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"m_{name}({{0}}, {{1}})" for name in OF_TWO},
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


# Operations that are not left to the C library.
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
        left, right = line.removeprefix("const real ").split(" = ", 1)
        operation = self.program.values[int(left[1:])].operation
        head = f"real {left}[{LANES}]; "
        if operation not in OWN:
            return f"{head}for (l = 0; l < {LANES}; l++) {left}[l] = {right}"
        parts = [self.name(i) for i in self.program.values[int(left[1:])].operands]
        copies = " ".join(f"a{k}[l] = {text};" for k, text in enumerate(parts))
        arrays = ", ".join(f"a{k}" for k in range(len(parts)))
        return f"{head}for (l = 0; l < {LANES}; l++) {{ {copies} }} odd |= lanes_{OWN[operation]}({arrays}, {left});"


def _horner(coefficients: Sequence[float], variable: str) -> str:
    text = f"R({coefficients[-1]!r})"
    for c in reversed(coefficients[:-1]):
        text = f"({text} * {variable} + R({c!r}))"
    return text


_SINE = _horner([-c for c in inverse_factorials(3, 2, 8, True)], "z")
_COSINE = _horner(inverse_factorials(4, 2, 7, True), "z")

_ODD = f"""/* whether an argument is beyond what the functions below serve */
static int lanes_odd(const real *x, real most) {{
  int l, odd = 0;
  for (l = 0; l < {LANES}; l++) odd |= !(x[l] < most && x[l] > -most);
  return odd;
}}
"""
_TURN = f"""/* sin(x + quarter pi / 2): x less a whole number of quarter turns, a series each for sine and cosine */
static int lanes_wave(const real *x, int quarter, real *y) {{
  int l;
  if (lanes_odd(x, R(1e5))) return 1;
  for (l = 0; l < {LANES}; l++) {{
    const int turns = (int)(x[l] * R(0.6366197723675814) + R(1048576.5)) - 1048576;
    const real n = (real)turns;
    const real r = ((x[l] - n * R(1.5707963267341256)) - n * R(6.077100506303966e-11)) - n * R(2.0222662487959506e-21);
    const real z = r * r;
    const real s = r + r * z * {_SINE};
    const real c = R(1.0) - R(0.5) * z + z * z * {_COSINE};
    const real odd = (real)((turns + quarter) & 1), side = (real)(1 - ((turns + quarter) & 2));
    y[l] = side * (s + odd * (c - s));
  }}
  return 0;
}}
"""
_FUNCTIONS = {
    "sin": "static int lanes_sin(const real *x, real *y) { return lanes_wave(x, 0, y); }\n",
    "cos": "static int lanes_cos(const real *x, real *y) { return lanes_wave(x, 1, y); }\n",
    "tanh": f"""static int lanes_tanh(real *x, real *y) {{
  int l, odd = 0;
  for (l = 0; l < {LANES}; l++) {{
    odd |= !(x[l] < R(1e30) && x[l] > R(-1e30));
    if (x[l] > R(20.0)) x[l] = R(20.0);
    if (x[l] < R(-20.0)) x[l] = R(-20.0);
  }}
  for (l = 0; l < {LANES}; l++) {{
    TANH
    y[l] = p / (p + R(2.0));
  }}
  return odd;
}}
""",
    "atan2": f"""static int lanes_atan2(const real *y, const real *x, real *angle) {{
  int l;
  if (lanes_odd(x, R(1e30)) | lanes_odd(y, R(1e30))) return 1;
  for (l = 0; l < {LANES}; l++) {{
    const real a = m_fabs(x[l]), b = m_fabs(y[l]);
    const real larger = b > a ? b : a, smaller = b > a ? a : b;
    const real steep = b > a ? R(1.0) : R(0.0), wide = smaller > R(0.41421356237309503) * larger ? R(1.0) : R(0.0);
    const real over = smaller - wide * larger, under = larger + wide * smaller + R(1e-30);
    const real t = over / under, z = t * t;
    const real e = wide * R(0.7853981633974483) + (t + t * z * {_horner(ARC, "z")});
    const real first = steep * R(1.5707963267948966) + (R(1.0) - R(2.0) * steep) * e;
    const real behind = x[l] < R(0.0) ? R(1.0) : R(0.0);
    const real all = behind * R(3.141592653589793) + (R(1.0) - R(2.0) * behind) * first;
    angle[l] = y[l] < R(0.0) ? -all : all;
  }}
  return 0;
}}
""",
}


def lane_functions(program: Program, outputs: list[int], tanh: str) -> str:
    """C text of the functions for LANES points that lead to ``outputs`` of a ``program``. tanh: statements that make p,
    exp(2 x) - 1, of x[l]."""
    used = {OWN[o] for o in {program.values[i].operation for i in program.needed(outputs, CONSTANT)} if o in OWN}
    text = _ODD if used - {"tanh"} else ""
    text += _TURN if used & {"sin", "cos"} else ""
    return text + "".join(_FUNCTIONS[name].replace("TANH", tanh) for name in sorted(used))

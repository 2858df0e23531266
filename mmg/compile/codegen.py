"""C text of what an instruction of a CasADi function does, on a vector of LANES points (GCC/Clang vector extension).

CasADi's own C evaluates one point per call. Here each instruction acts on a vector, so that simulation, sensitivities
and Hessians of thousands of points run at SIMD speed from the very expression that defines the ship.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

# Points per vector: 8 doubles fill an AVX-512 register, two AVX2 ones, four NEON ones.
LANES = 8  # set by hand: speed, and rounding

# Functions of the C library that CasADi has an operation for, of one and of two arguments.
OF_ONE = ("sqrt", "exp", "log", "expm1", "log1p", "erf", "fabs", "floor", "ceil", "sin", "cos", "tan", "asin", "acos",
          "atan", "sinh", "cosh", "tanh")  # fmt: skip
OF_TWO = ("pow", "atan2", "fmin", "fmax", "fmod", "hypot", "copysign")
# Operations on operands that are written alike in C and in MATLAB, and the signs of comparisons in C.
ARITHMETIC = {ca.OP_ASSIGN: "{0}", ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}",
              ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}"}  # fmt: skip
COMPARISONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}


def calls(prefix: str) -> dict[int, str]:
    """CasADi operation -> C text of a call of the function of OF_ONE or OF_TWO, each behind ``prefix``."""
    one = {getattr(ca, f"OP_{name.upper()}"): f"{prefix}{name}({{0}})" for name in OF_ONE}
    two = {getattr(ca, f"OP_{name.upper()}"): f"{prefix}{name}({{0}}, {{1}})" for name in OF_TWO}
    return {**one, **two, ca.OP_CONSTPOW: f"{prefix}pow({{0}}, {{1}})"}


# C expression of each CasADi operation on its operands; a truth is 1 or 0, as CasADi has it.
EXPRESSIONS: dict[int, str] = {
    **calls("v_"),
    **ARITHMETIC,
    **{operation: f"compare({{0}} {sign} {{1}})" for operation, sign in COMPARISONS.items()},
    ca.OP_DIV: "quotient({0}, {1})",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "quotient(fill(1.0), {0})",
    ca.OP_NOT: "compare({0} == 0.0)",
    ca.OP_AND: "compare(({0} != 0.0) & ({1} != 0.0))",  # &, not &&: vectors have no logical operators
    ca.OP_OR: "compare(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_SIGN: "compare({0} > 0.0) - compare({0} < 0.0)",
    ca.OP_IF_ELSE_ZERO: "when({0}, {1})",
}

# What a function is that Python calls.
EXPORT = """#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif
"""
# What a function is that is called from another unit of the same library alone.
HIDDEN = """#if defined(_WIN32) || !defined(__GNUC__)
#define HIDDEN
#else
#define HIDDEN __attribute__((visibility("hidden")))
#endif
"""
_COMMON = (
    "#include <math.h>\n#include <string.h>\n#define INLINE static inline __attribute__((always_inline))\n" + EXPORT
)
_OWN = ("sqrt", "exp", "tanh", "sin", "cos", "atan2")  # Functions that do without the C library

# exp, tanh, sin, cos and atan2 on vectors, free of branches, within a few units of the last bit: a C library
# evaluates one number per call, with branches that scattered ships mispredict. Arguments are reduced by multiples of
# ln 2 or pi / 2 given in parts (Cody & Waite 1980), the rest are Taylor polynomials. exp gives 0 below -708; sin and
# cos of more than 1e5 rad are the C library's. The reduction needs every product rounded: compile with -ffp-
# contract=off.


def horner(coefficients: Sequence[float], term: str, number: str) -> str:
    """C expression of the polynomial c_0 + z (c_1 + z (...)) of ``coefficients``. term: text of {0} z + {1}; number: of
    a literal."""
    text = number.format(repr(coefficients[-1]))
    for c in coefficients[-2::-1]:
        text = term.format(text, number.format(repr(c)))
    return text


def inverse_factorials(first: int, step: int, count: int, alternate: bool) -> list[float]:
    """1 / k! for ``count`` numbers k = first, first + step, ..., with signs that ``alternate`` or not."""
    return [(-1.0) ** (i if alternate else 0) / math.factorial(first + step * i) for i in range(count)]


# Taylor coefficients behind the first terms: of expm1(z) / z^2 - 1 / z, and of sin and cos by even powers. So many that
# the first one left out is below the last bit for |z| <= ln(2) / 2 and |z| <= pi / 4, to which arguments are reduced.
EXPM1 = inverse_factorials(2, 1, 12, False)
SINE = [-c for c in inverse_factorials(3, 2, 8, True)]
COSINE = inverse_factorials(4, 2, 7, True)
# (atan(t) / t - 1) / z as a polynomial of z = t^2 up to tan^2(pi / 8), interpolated at the Chebyshev nodes. The degree
# was set by hand.
ARC = (
    -0.3333333333333333, 0.19999999999999804, -0.14285714285659779, 0.11111111105150588, -0.09090908753259112,
     0.07692296368042296, -0.0666642476020052, 0.05878927554473807, -0.05230443640686948, 0.045515447340221615,
     -0.03456931506332609, 0.016284375050043393
)  # fmt: skip


def c_file(module: str, name: str, **values: object) -> str:
    """The C file ``name`` beside the file of a ``module``, each "@key@" replaced by its value among ``values``."""
    text = Path(module).with_name(name).read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", str(value))
    return text


def prelude() -> str:
    """What all C files begin with: the type V of LANES points and the functions on it."""
    one, two = (sorted(set(names) - set(_OWN)) for names in (OF_ONE, OF_TWO))
    by_lane = [f"static V v_{f}(V x) {{ LANEWISE({f}(x[i])); }}" for f in one]
    by_lane += [f"static V v_{f}(V a, V b) {{ LANEWISE({f}(a[i], b[i])); }}" for f in two]
    series = {"expm1": EXPM1, "sin": SINE, "cos": COSINE, "arc": ARC}
    polynomials = {name: horner(c, "more(z, {0}, {1})", "fill({0})") for name, c in series.items()}
    reduced = {"per_ln2": 1 / math.log(2), "per_quarter": 2 / math.pi}  # arguments are counted in these
    functions = c_file(__file__, "functions.h", **polynomials, **reduced)
    return _COMMON + c_file(__file__, "vector.h", lanes=LANES) + functions + "\n".join(by_lane) + "\n"


def expression(operation: int, operands: list[str]) -> str:
    """C expression of one instruction on its operands. operation: CasADi's number of it; NotImplementedError for one
    without C."""
    if operation not in EXPRESSIONS:
        raise NotImplementedError(f"no C for CasADi operation {operation}")
    return EXPRESSIONS[operation].format(*operands)


def constant(value: float) -> str:
    """C literal of a number: Python writes an infinite or undefined ``value`` in words that C does not know."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(value)

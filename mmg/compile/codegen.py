"""C code for many evaluations at once, emitted from the instruction list of a CasADi function.

CasADi's own C evaluates one point per call. Here each instruction acts on a vector of LANES points (GCC/Clang vector
extension), so that simulation, sensitivities and Hessians of thousands of points run at SIMD speed from the very
expression that defines the ship. Inputs and outputs are arrays of shape (rows, points), points contiguous; an input
of shape (rows,) is shared by all points. An output holds the nonzeros of a sparse result, in CasADi's order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca

from mmg.compile.vector_math import MATH

LANES = 8
"""Points per vector: 8 doubles fill an AVX-512 register, two AVX2 ones, four NEON ones."""

_ONE: tuple[str, ...] = ("sqrt", "exp", "log", "expm1", "log1p", "erf", "fabs", "floor", "ceil")
_ONE += ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh")
_TWO = ("pow", "atan2", "fmin", "fmax", "fmod", "hypot", "copysign")
"""Functions of the C library that CasADi has an operation for, of one and of two arguments."""

EXPRESSIONS: dict[int, str] = {
    **{getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}})" for name in _ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}}, {{1}})" for name in _TWO},
    ca.OP_CONSTPOW: "v_pow({0}, {1})",
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_LT: "compare({0} < {1})",
    ca.OP_LE: "compare({0} <= {1})",
    ca.OP_EQ: "compare({0} == {1})",
    ca.OP_NE: "compare({0} != {1})",
    ca.OP_NOT: "compare({0} == 0.0)",
    ca.OP_AND: "compare(({0} != 0.0) & ({1} != 0.0))",
    ca.OP_OR: "compare(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_SIGN: "compare({0} > 0.0) - compare({0} < 0.0)",
    ca.OP_IF_ELSE_ZERO: "when({0}, {1})",
}
"""C expression of each CasADi operation on its operands."""

_COMMON = """#include <math.h>
#include <string.h>
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif
"""
_VECTOR = f"""#define LANES {LANES}
typedef double V __attribute__((vector_size(8 * LANES)));
typedef long long M __attribute__((vector_size(8 * LANES)));
typedef unsigned long long U __attribute__((vector_size(8 * LANES)));
#define bits(x) ((U)(x))
#define real(x) ((V)(x))
#define LANEWISE(e) V y; for (int i = 0; i < LANES; i++) y[i] = (e); return y
static inline V load(const double* p) {{ V x; memcpy(&x, p, sizeof x); return x; }}
static inline void store(double* p, V x) {{ memcpy(p, &x, sizeof x); }}
static inline V fill(double a) {{ return a - (V){{0}}; }}
static inline V choose(M m, V a, V b) {{ return real(((U)m & bits(a)) | (~(U)m & bits(b))); }}
static inline int any(M m) {{ long long y = 0; for (int i = 0; i < LANES; i++) y |= m[i]; return y != 0; }}
static inline V v_sqrt(V x) {{ LANEWISE(__builtin_sqrt(x[i])); }}
static V each_sin(V x) {{ LANEWISE(sin(x[i])); }}
static V each_cos(V x) {{ LANEWISE(cos(x[i])); }}
static V each_atan2(V y_, V x) {{ LANEWISE(atan2(y_[i], x[i])); }}
"""
_SCALAR = """#define LANES 1
typedef double V;
typedef int M;
typedef unsigned long long U;
static inline U bits(V x) { U y; memcpy(&y, &x, sizeof y); return y; }
static inline V real(U x) { V y; memcpy(&y, &x, sizeof y); return y; }
#define load(p) (*(p))
#define store(p, x) (*(p) = (x))
#define fill(a) (a)
#define choose(m, a, b) ((m) ? (a) : (b))
#define any(m) (m)
#define v_sqrt sqrt
#define each_sin sin
#define each_cos cos
#define each_atan2 atan2
"""
_LAST = """#define compare(m) choose(m, fill(1.0), fill(0.0))
#define when(c, x) choose((c) != 0.0, x, fill(0.0))
"""
_OWN = ("sqrt", "exp", "tanh", "sin", "cos", "atan2")
"""Functions that do without the C library."""


def prelude(lanes: int = LANES) -> str:
    """What all C files begin with: the type V of ``lanes`` points (LANES or 1) and the functions on it."""
    one, two = (sorted(set(names) - set(_OWN)) for names in (_ONE, _TWO))
    if lanes == 1:
        calls = [f"#define v_{f} {f}" for f in (*one, *two)]
    else:
        calls = [f"static V v_{f}(V x) {{ LANEWISE({f}(x[i])); }}" for f in one]
        calls += [f"static V v_{f}(V a, V b) {{ LANEWISE({f}(a[i], b[i])); }}" for f in two]
    return _COMMON + (_SCALAR if lanes == 1 else _VECTOR) + _LAST + MATH + "\n".join(calls) + "\n"


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


def kernel(function: ca.Function) -> str:
    """C source of ``void NAME(long points, const double** arg, const long* ld, double** res)``.

    ``points`` is a multiple of LANES. ``arg[i]`` has row stride ``ld[i]``, or is shared when ``ld[i]`` is 0;
    every result has row stride ``points``. A null ``res[j]`` is skipped. The function must be an SXFunction.
    """
    body = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            body.append(f"w[{outputs[0]}] = fill({constant(function.instruction_constant(k))});")
        elif operation == ca.OP_INPUT:
            body.append(f"w[{outputs[0]}] = IN({inputs[0]}, {inputs[1]});")
        elif operation == ca.OP_OUTPUT:
            body.append(f"OUT({outputs[0]}, {outputs[1]}, w[{inputs[0]}]);")
        else:
            text = expression(operation, [f"w[{i}]" for i in inputs])
            body.append(f"w[{outputs[0]}] = {text};")
    lines = "\n    ".join(body)
    return f"""
#define IN(i, k) (ld[i] ? load(arg[i] + (k) * ld[i] + at) : fill(arg[i][k]))
#define OUT(j, k, x) if (res[j]) store(res[j] + (k) * points + at, x)
EXPORT void {function.name()}(long long points, const double* const* arg, const long long* ld, double* const* res) {{
  V w[{max(function.sz_w(), 1)}];
  for (long long at = 0; at < points; at += LANES) {{
    {lines}
  }}
}}
#undef IN
#undef OUT
"""


def source(functions: Sequence[ca.Function]) -> str:
    """One C file with a batch kernel for each of the ``functions`` (SXFunctions with distinct names)."""
    return prelude() + "".join(kernel(f) for f in functions)

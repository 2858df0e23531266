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

LANES = 8
"""Points per vector: 8 doubles fill an AVX-512 register, two AVX2 ones, four NEON ones."""

_INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
_CALLS = {
    ca.OP_SQRT: "sqrt",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_FABS: "fabs",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_ERF: "erf",
    ca.OP_LOG1P: "log1p",
    ca.OP_EXPM1: "expm1",
}
_CALLS2 = {
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_ATAN2: "atan2",
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
    ca.OP_FMOD: "fmod",
    ca.OP_HYPOT: "hypot",
    ca.OP_COPYSIGN: "copysign",
}
_COMPARE = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}

PRELUDE = f"""#include <math.h>
#include <string.h>
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif
#define LANES {LANES}
typedef double V __attribute__((vector_size(8 * LANES)));
static inline V load(const double* p) {{ V x; memcpy(&x, p, sizeof x); return x; }}
static inline void store(double* p, V x) {{ memcpy(p, &x, sizeof x); }}
static inline V fill(double a) {{ V x; for (int i = 0; i < LANES; i++) x[i] = a; return x; }}
#define LANEWISE(e) V y; for (int i = 0; i < LANES; i++) y[i] = (e); return y
"""


def _expression(operation: int, operands: list[str]) -> str:
    """C expression of one instruction on its operands."""
    first = operands[0]
    if operation in _INFIX:
        return f"{first} {_INFIX[operation]} {operands[1]}"
    if operation in _CALLS:
        return f"v_{_CALLS[operation]}({first})"
    if operation in _CALLS2:
        return f"v_{_CALLS2[operation]}({first}, {operands[1]})"
    if operation in _COMPARE:
        return f"compare({first} {_COMPARE[operation]} {operands[1]})"
    simple = {
        ca.OP_ASSIGN: "{0}",
        ca.OP_NEG: "-{0}",
        ca.OP_SQ: "{0} * {0}",
        ca.OP_TWICE: "2.0 * {0}",
        ca.OP_INV: "1.0 / {0}",
        ca.OP_NOT: "compare({0} == 0.0)",
        ca.OP_SIGN: "compare({0} > 0.0) - compare({0} < 0.0)",
    }
    if operation in simple:
        return simple[operation].format(first)
    if operation == ca.OP_AND:
        return f"compare(({first} != 0.0) & ({operands[1]} != 0.0))"
    if operation == ca.OP_OR:
        return f"compare(({first} != 0.0) | ({operands[1]} != 0.0))"
    if operation == ca.OP_IF_ELSE_ZERO:
        return f"when({first}, {operands[1]})"
    raise NotImplementedError(f"no C for CasADi operation {operation}")


def _constant(value: float) -> str:
    """C literal of a number: Python writes inf and nan in words that C does not know."""
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
            body.append(f"w[{outputs[0]}] = fill({_constant(function.instruction_constant(k))});")
        elif operation == ca.OP_INPUT:
            body.append(f"w[{outputs[0]}] = IN({inputs[0]}, {inputs[1]});")
        elif operation == ca.OP_OUTPUT:
            body.append(f"OUT({outputs[0]}, {outputs[1]}, w[{inputs[0]}]);")
        else:
            expression = _expression(operation, [f"w[{i}]" for i in inputs])
            body.append(f"w[{outputs[0]}] = {expression};")
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
    """One C file with a batch kernel for each function (SXFunctions with distinct names)."""
    one = "\n".join(f"static V v_{f}(V x) {{ LANEWISE({f}(x[i])); }}" for f in _CALLS.values() if f != "sqrt")
    two = "\n".join(f"static V v_{f}(V a, V b) {{ LANEWISE({f}(a[i], b[i])); }}" for f in sorted(set(_CALLS2.values())))
    helpers = f"""{one}
{two}
static inline V v_sqrt(V x) {{ LANEWISE(__builtin_sqrt(x[i])); }}
typedef long long M __attribute__((vector_size(8 * LANES)));
static inline V compare(M m) {{ LANEWISE(m[i] ? 1.0 : 0.0); }}
static inline V when(V c, V x) {{ LANEWISE(c[i] != 0.0 ? x[i] : 0.0); }}
"""
    return PRELUDE + helpers + "".join(kernel(f) for f in functions)

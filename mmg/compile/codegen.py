"""C text of what an instruction of a CasADi function does, on a vector of LANES points (GCC/Clang vector extension).

CasADi's own C evaluates one point per call. Here each instruction acts on a vector, so that simulation, sensitivities
and Hessians of thousands of points run at SIMD speed from the very expression that defines the ship.
"""

from __future__ import annotations

import math

import casadi as ca

LANES = 8
"""Points per vector: 8 doubles fill an AVX-512 register, two AVX2 ones, four NEON ones."""

OF_ONE: tuple[str, ...] = ("sqrt", "exp", "log", "expm1", "log1p", "erf", "fabs", "floor", "ceil")
OF_ONE += ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh")
OF_TWO = ("pow", "atan2", "fmin", "fmax", "fmod", "hypot", "copysign")
"""Functions of the C library that CasADi has an operation for, of one and of two arguments."""

EXPRESSIONS: dict[int, str] = {
    **{getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}})" for name in OF_ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"v_{name}({{0}}, {{1}})" for name in OF_TWO},
    ca.OP_CONSTPOW: "v_pow({0}, {1})",
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "quotient({0}, {1})",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "quotient(fill(1.0), {0})",
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

EXPORT = """#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif
"""
"""What a function is that Python calls."""
HIDDEN = """#if defined(_WIN32) || !defined(__GNUC__)
#define HIDDEN
#else
#define HIDDEN __attribute__((visibility("hidden")))
#endif
"""
"""What a function is that is called from another unit of the same library alone."""
_COMMON = (
    "#include <math.h>\n#include <string.h>\n#define INLINE static inline __attribute__((always_inline))\n" + EXPORT
)
_VECTOR = f"""#define LANES {LANES}
typedef double V __attribute__((vector_size(8 * LANES)));
typedef long long M __attribute__((vector_size(8 * LANES)));
typedef unsigned long long U __attribute__((vector_size(8 * LANES)));
#define bits(x) ((U)(x))
#define real(x) ((V)(x))
#define LANEWISE(e) V y; for (int i = 0; i < LANES; i++) y[i] = (e); return y
INLINE V load(const double* p) {{ V x; memcpy(&x, p, sizeof x); return x; }}
static inline void store(double* p, V x) {{ memcpy(p, &x, sizeof x); }}
INLINE V fill(double a) {{ return a - (V){{0}}; }}
INLINE V choose(M m, V a, V b) {{ return real(((U)m & bits(a)) | (~(U)m & bits(b))); }}
#if defined(__AVX512DQ__) && defined(__GNUC__) && !defined(__clang__)
#define ALL_LANES (unsigned char)-1
#define any(m) (__builtin_ia32_cvtq2mask512(m) != 0)
INLINE V more(V a, V b, V c) {{ return __builtin_ia32_vfmaddpd512_mask(a, b, c, ALL_LANES, 4); }}
#else
INLINE int any(M m) {{ long long y = 0; for (int i = 0; i < LANES; i++) y |= m[i]; return y != 0; }}
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
INLINE V more(V a, V b, V c) {{ LANEWISE(__builtin_fma(a[i], b[i], c[i])); }}
#else
INLINE V more(V a, V b, V c) {{ return a * b + c; }}
#endif
#endif
INLINE V each_sqrt(V x) {{ LANEWISE(__builtin_sqrt(x[i])); }}
static V each_sin(V x) {{ LANEWISE(sin(x[i])); }}
static V each_cos(V x) {{ LANEWISE(cos(x[i])); }}
static V each_atan2(V y_, V x) {{ LANEWISE(atan2(y_[i], x[i])); }}
#define v_sqrt each_sqrt
"""
_SCALAR = """#define LANES 1
typedef double V;
typedef int M;
typedef unsigned long long U;
INLINE U bits(V x) { U y; memcpy(&y, &x, sizeof y); return y; }
INLINE V real(U x) { V y; memcpy(&y, &x, sizeof y); return y; }
#define load(p) (*(p))
#define store(p, x) (*(p) = (x))
#define fill(a) (a)
#define choose(m, a, b) ((m) ? (a) : (b))
#define any(m) (m)
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
#define more(a, b, c) __builtin_fma(a, b, c)
#else
#define more(a, b, c) ((a) * (b) + (c))
#endif
#define each_sin sin
#define each_cos cos
#define each_atan2 atan2
#define v_sqrt sqrt
"""
_LAST = """#define MATH static V
#define quotient(a, b) ((a) / (b))
#define compare(m) choose(m, fill(1.0), fill(0.0))
#define when(c, x) choose((c) != 0.0, x, fill(0.0))
"""
_OWN = ("sqrt", "exp", "tanh", "sin", "cos", "atan2")
"""Functions that do without the C library."""


# exp, tanh, sin, cos and atan2 on vectors, free of branches, within a few units of the last bit: a C library
# evaluates one number per call, with branches that scattered ships mispredict. Arguments are reduced by multiples of
# ln 2 or pi / 2 given in parts (Cody & Waite 1980), the rest are Taylor polynomials. exp gives 0 below -708; sin and
# cos of more than 1e5 rad are the C library's. The reduction needs every product rounded: compile with -ffp-
# contract=off.


def _horner(coefficients: list[float]) -> str:
    """C expression of c_0 + z (c_1 + z (...))."""
    text = f"fill({coefficients[-1]!r})"
    for c in coefficients[-2::-1]:
        text = f"more(z, {text}, fill({c!r}))"
    return text


def inverse_factorials(first: int, step: int, count: int, alternate: bool) -> list[float]:
    """1 / k! for ``count`` numbers k = first, first + step, ..., with signs that ``alternate`` or not."""
    return [(-1.0) ** (i if alternate else 0) / math.factorial(first + step * i) for i in range(count)]


_EXPM1 = _horner(inverse_factorials(2, 1, 12, False))
_SIN = _horner([-c for c in inverse_factorials(3, 2, 8, True)])
_COS = _horner(inverse_factorials(4, 2, 7, True))
ARC = (
    -0.3333333333333333, 0.19999999999999804, -0.14285714285659779, 0.11111111105150588, -0.09090908753259112,
     0.07692296368042296, -0.0666642476020052, 0.05878927554473807, -0.05230443640686948, 0.045515447340221615,
     -0.03456931506332609, 0.016284375050043393
)  # fmt: skip
"""(atan(t) / t - 1) / z as a polynomial of z = t^2 up to tan^2(pi / 8), interpolated at the Chebyshev nodes."""

MATH = f"""
#define MAGNITUDE 0x7fffffffffffffffULL
#define ROUND 6755399441055744.0
INLINE V absolute(V x) {{ return real(bits(x) & MAGNITUDE); }}
INLINE V signed_as(V x, V y) {{ return real((bits(x) & MAGNITUDE) | (bits(y) & ~MAGNITUDE)); }}
INLINE V power_of_2(V shifted) {{ return real((bits(shifted) + 1023) << 52); }}
INLINE V beyond_ln2(V x, V n) {{ return (x - n * 0x1.62e42feep-1) - n * 0x1.a39ef35793c76p-33; }}
INLINE V expm1_small(V z) {{ return more(z * z, {_EXPM1}, z); }}
MATH v_exp(V x) {{
  const V y = choose(x > 710.0, fill(710.0), choose(x < -708.0, fill(-708.0), x));
  const V shifted = y * {1 / math.log(2)!r} + ROUND, n = shifted - ROUND;
  const V e = (1.0 + expm1_small(beyond_ln2(y, n))) * power_of_2(shifted - 1.0) * 2.0;
  return choose(x < -708.0, fill(0.0), e);
}}
MATH v_tanh(V x) {{
  const V a = 2.0 * absolute(x), y = choose(a > 44.0, fill(44.0), a);
  const V shifted = y * {1 / math.log(2)!r} + ROUND, n = shifted - ROUND, p = power_of_2(shifted);
  const V e = more(p, expm1_small(beyond_ln2(y, n)), p - 1.0);
  return signed_as(quotient(e, e + 2.0), x);
}}
INLINE V wave(V x, unsigned long long quarter) {{
  const V shifted = x * {2 / math.pi!r} + ROUND, n = shifted - ROUND;
  const V r = ((x - n * 0x1.921fb544p+0) - n * 0x1.0b4611a6p-34) - n * 0x1.3198a2e037073p-69;
  const V z = r * r;
  const U k = bits(shifted) + quarter;
  const V s = more(r * z, {_SIN}, r);
  const V c = more(z * z, {_COS}, 1.0 - 0.5 * z);
  const V even = choose((k & 1) == 0, s, c);
  return real(bits(even) ^ ((k & 2) << 62));
}}
MATH v_sin(V x) {{
  const V y = wave(x, 0);
  const M large = absolute(x) > 1e5;
  return any(large) ? choose(large, each_sin(x), y) : y;
}}
MATH v_cos(V x) {{
  const V y = wave(x, 1);
  const M large = absolute(x) > 1e5;
  return any(large) ? choose(large, each_cos(x), y) : y;
}}
MATH v_atan2(V y, V x) {{
  const V a = absolute(x), b = absolute(y);
  const M steep = b > a;
  const V larger = choose(steep, b, a), smaller = choose(steep, a, b);
  const M wide = smaller > 0.41421356237309503 * larger;
  const V over = choose(wide, smaller - larger, smaller), under = choose(wide, smaller + larger, larger);
  const V t = over / choose(under == 0.0, fill(1.0), under), z = t * t;
  const V arc = more(t * z, {_horner(list(ARC))}, t);
  const V e = choose(wide, 0x1.921fb54442d18p-1 + (0x1.1a62633145c07p-55 + arc), arc);
  const V first = choose(steep, 0x1.921fb54442d18p+0 - (e - 0x1.1a62633145c07p-54), e);
  const V all = choose((bits(x) >> 63) != 0, 0x1.921fb54442d18p+1 - (first - 0x1.1a62633145c07p-53), first);
  const V angle = signed_as(all, y);
  const M large = smaller > 1e300;
  return any(large) ? choose(large, each_atan2(y, x), angle) : angle;
}}
"""


def prelude(lanes: int = LANES) -> str:
    """What all C files begin with: the type V of ``lanes`` points (LANES or 1) and the functions on it."""
    one, two = (sorted(set(names) - set(_OWN)) for names in (OF_ONE, OF_TWO))
    if lanes == 1:
        calls = [f"#define v_{f} {f}" for f in (*one, *two)]
    else:
        calls = [f"static V v_{f}(V x) {{ LANEWISE({f}(x[i])); }}" for f in one]
        calls += [f"static V v_{f}(V a, V b) {{ LANEWISE({f}(a[i], b[i])); }}" for f in two]
    kind = _SCALAR if lanes == 1 else _VECTOR
    return _COMMON + kind + _LAST + MATH + "\n".join(calls) + "\n"


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

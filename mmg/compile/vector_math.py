"""C source of exp, tanh, sin, cos and atan2 on vectors, free of branches, within a few units of the last bit.

A C library evaluates one number per call, with branches that scattered ships mispredict; these act on all points of a
vector at once. Written for ``mmg.compile.codegen.prelude``: V (doubles), U (their bits), choose, bits, real, fill,
quotient, more (a * b + c rounded once), MATH (how a function is declared); with one lane the same operations give the
same bits. Arguments are reduced by multiples of ln 2 or pi / 2 given in parts (Cody & Waite 1980), the rest are Taylor
polynomials. exp gives 0 below -708; sin and cos of more than 1e5 rad are the C library's. The reduction needs every
product rounded: compile with -ffp-contract=off.
"""

from __future__ import annotations

import math


def _horner(coefficients: list[float]) -> str:
    """C expression of c_0 + z (c_1 + z (...))."""
    text = f"fill({coefficients[-1]!r})"
    for c in coefficients[-2::-1]:
        text = f"more(z, {text}, fill({c!r}))"
    return text


def _factorials(first: int, step: int, count: int, alternate: bool) -> list[float]:
    """1 / k! for k = first, first + step, ..., with alternating signs."""
    return [(-1.0) ** (i if alternate else 0) / math.factorial(first + step * i) for i in range(count)]


_EXPM1 = _horner(_factorials(2, 1, 12, False))
_SIN = _horner([-c for c in _factorials(3, 2, 8, True)])
_COS = _horner(_factorials(4, 2, 7, True))
_ATAN = _horner(
    [-0.3333333333333333, 0.19999999999999804, -0.14285714285659779, 0.11111111105150588, -0.09090908753259112,
     0.07692296368042296, -0.0666642476020052, 0.05878927554473807, -0.05230443640686948, 0.045515447340221615,
     -0.03456931506332609, 0.016284375050043393]
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
  const V arc = more(t * z, {_ATAN}, t);
  const V e = choose(wide, 0x1.921fb54442d18p-1 + (0x1.1a62633145c07p-55 + arc), arc);
  const V first = choose(steep, 0x1.921fb54442d18p+0 - (e - 0x1.1a62633145c07p-54), e);
  const V all = choose((bits(x) >> 63) != 0, 0x1.921fb54442d18p+1 - (first - 0x1.1a62633145c07p-53), first);
  const V angle = signed_as(all, y);
  const M large = smaller > 1e300;
  return any(large) ? choose(large, each_atan2(y, x), angle) : angle;
}}
"""

"""Portable C of a staged program for LANES points at once: each statement is a short loop of fixed length.

Compilers make vector instructions of such loops, and other code of them where they have none. sin, cos, tanh and atan2
are written out without branches, as calls of the C library cannot be vectorised; they are exact to some 1e-16. A lane
whose argument they cannot serve is reported, so that the caller can work that block point by point.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import factorial

import casadi as ca

from mmg.compile.portable_c import Emitter
from mmg.compile.stages import CONSTANT, Program

LANES = 8
OWN = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TANH: "tanh", ca.OP_ATAN2: "atan2"}
"""Operations that are not left to the C library."""


class LaneEmitter(Emitter):
    """Writes statements for LANES points: arguments and kept values that differ between points end in ``[l]``."""

    def __init__(self, program: Program, arguments: Mapping[int, str], kept: Mapping[int, str]) -> None:
        super().__init__(program, arguments, kept)

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


def _horner(coefficients: list[float], variable: str) -> str:
    text = f"R({coefficients[-1]!r})"
    for c in reversed(coefficients[:-1]):
        text = f"({text} * {variable} + R({c!r}))"
    return text


_SINE = _horner([(-1.0) ** k / factorial(2 * k + 1) for k in range(1, 9)], "z")
_COSINE = _horner([(-1.0) ** k / factorial(2 * k) for k in range(2, 9)], "z")
_ARC = _horner(
    [-0.3333333333333333, 0.19999999999999804, -0.14285714285659779, 0.11111111105150588, -0.09090908753259112,
     0.07692296368042296, -0.0666642476020052, 0.05878927554473807, -0.05230443640686948, 0.045515447340221615,
     -0.03456931506332609, 0.016284375050043393], "z")  # fmt: skip
"""(atan(t) / t - 1) / z as a polynomial of z = t^2 up to tan^2(pi / 8), as in mmg/compile/vector_math.py."""

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
    const real e = wide * R(0.7853981633974483) + (t + t * z * {_ARC});
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

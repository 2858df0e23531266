"""MATLAB and Octave statements of a staged program, scalars all, as mmg/compile/portable_c.py writes C."""

from __future__ import annotations

import math

import casadi as ca

from mmg.compile.codegen import ARITHMETIC, OF_ONE
from mmg.compile.portable_c import Emitter

# M expression of each CasADi operation; ``when`` is a function of the file that holds the statements.
EXPRESSIONS: dict[int, str] = {
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

    expressions, powers, statement, first = EXPRESSIONS, {2.0: "{0} * {0}"}, "w{0} = {1};", 1

    def literal(self, number: float) -> str:
        """M text of a ``number``."""
        return m_number(number)

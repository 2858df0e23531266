"""C source of batch kernels: a CasADi function at many points at once.

Inputs and outputs are arrays of shape (rows, points), points contiguous; an input of shape (rows,) is shared by all
points. An output holds the nonzeros of a sparse result, in CasADi's order.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mmg.compile.cache import LONG, UNIT
from mmg.compile.codegen import HIDDEN, prelude
from mmg.compile.staged_lanes import divided_code, units_of
from mmg.compile.stages import Program

SHORT = 2
"""Parts of a function that are compiled as code that loops go through often; of more parts are second derivatives."""
_MACROS = """
#define EACH(i, name) for (long long e = 0, k; (k = name##_of##i[e]) >= 0; e++)
#define READ(i, name) EACH(i, name) x##i[k] = load(arg[i] + k * ld[i] + at);
#define SHARED(i, name) EACH(i, name) x##i[k] = fill(arg[i][k]);
#define WRITE(j, size, from) for (long long k = 0; k < size; k++) store(res[j] + k * points + at, d[from + k]);
"""
"""An argument has a list of its elements that are used, which ends with -1: of a hundred coefficients often few are."""


def kernel(function: ca.Function) -> tuple[str, list[str]]:
    """C source of ``void NAME(long points, const double** arg, const long* ld, double** res)``, and of the functions of
    its own that it calls.

    ``points`` is a multiple of LANES. ``arg[i]`` has row stride ``ld[i]``, or is shared when ``ld[i]`` is 0;
    every result has row stride ``points``. A null ``res[j]`` is skipped. The function must be an SXFunction.
    """
    sizes = [function.nnz_in(i) for i in range(function.n_in())]
    found = [function.nnz_out(j) for j in range(function.n_out())]
    program = Program.of(function, [1] * len(sizes))
    code = divided_code(function.name(), program, range(len(found)), {i: f"x{i}" for i in range(len(sizes))}, {})
    used = {program.values[place].argument for place in program.needed(range(len(found)))}
    lists = [", ".join(str(k) for k in [*range(size), -1] if k < 0 or (i, k) in used) for i, size in enumerate(sizes)]
    tables = "".join(f"static const short {function.name()}_of{i}[] = {{{each}}};\n" for i, each in enumerate(lists))
    arrays = "; ".join(f"V x{i}[{size + 1}]" for i, size in enumerate(sizes))
    shared = " ".join(f"if (!ld[{i}]) SHARED({i}, {function.name()})" for i in range(len(sizes)))
    reads = " ".join(f"if (ld[{i}]) READ({i}, {function.name()})" for i in range(len(sizes)))
    writes = " ".join(f"if (res[{j}]) WRITE({j}, {size}, {sum(found[:j])})" for j, size in enumerate(found))
    text = f"""{code.declared}{tables}
EXPORT void {function.name()}(long long points, const double* const* arg, const long long* ld, double* const* res) {{
  {arrays}; V d[{sum(found) + 1}];
  {shared}
  for (long long at = 0; at < points; at += LANES) {{
    {reads}
    {code.call}
    {writes}
  }}
}}
"""
    return text, code.functions


def source(functions: Sequence[ca.Function]) -> str:
    """C source, in units, with a batch kernel for each of the ``functions`` (SXFunctions with distinct names)."""
    head = prelude() + HIDDEN
    whole, parts = zip(*[kernel(f) for f in functions], strict=True)
    short, long = ([part for each in parts if (len(each) > SHORT) == far for part in each] for far in (False, True))
    first, *units = units_of(head, short) or [head]
    return UNIT.join([first + _MACROS + "".join(whole), *units, *units_of(LONG + head, long)])

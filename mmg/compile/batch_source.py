"""C source of batch kernels: a CasADi function at many points at once.

Inputs and outputs are arrays of shape (rows, points), points contiguous; an input of shape (rows,) is shared by all
points. An output holds the nonzeros of a sparse result, in CasADi's order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import casadi as ca

from mmg.compile.cache import UNIT
from mmg.compile.codegen import HIDDEN, UNIT_SIZE, constant, expression, prelude
from mmg.compile.staged_lanes import side_by_side, staged_bodies
from mmg.compile.stages import Program

NEWLINE = "\n  "
FEW = 3000
"""Instructions up to which a function can be worked out for VECTORS at a time: what it waits for is not memory but the
processor's slow operations."""
VECTORS = 2
"""Vectors side by side: the statements of one fill the time for which those of the other wait."""


def kernel(function: ca.Function) -> str:
    """C source of ``void NAME(long points, const double** arg, const long* ld, double** res)``.

    ``points`` is a multiple of LANES. ``arg[i]`` has row stride ``ld[i]``, or is shared when ``ld[i]`` is 0;
    every result has row stride ``points``. A null ``res[j]`` is skipped. The function must be an SXFunction.
    """
    lines = "\n    ".join(text for text, _, _ in _statements(function))
    return f"""{_MACROS}{_signature(function)} {{
  V w[{max(function.sz_w(), 1)}];
  for (long long at = 0; at < points; at += LANES) {{
    {lines}
  }}
}}
#undef IN
#undef OUT
"""


_MACROS = """
#define IN(i, k) (ld[i] ? load(arg[i] + (k) * ld[i] + at) : fill(arg[i][k]))
#define OUT(j, k, x) if (res[j]) store(res[j] + (k) * points + at, x)
"""
_CALLED_WITH = "long long points, const double* const* arg, const long long* ld, double* const* res"


def _signature(function: ca.Function) -> str:
    return f"EXPORT void {function.name()}({_CALLED_WITH})"


def _statements(function: ca.Function) -> list[tuple[str, list[int], list[int]]]:
    """C of each instruction, and the elements of the work array w that it reads and writes."""
    found: list[tuple[str, list[int], list[int]]] = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            found.append((f"w[{outputs[0]}] = fill({constant(function.instruction_constant(k))});", [], outputs))
        elif operation == ca.OP_INPUT:
            found.append((f"w[{outputs[0]}] = IN({inputs[0]}, {inputs[1]});", [], outputs))
        elif operation == ca.OP_OUTPUT:
            found.append((f"OUT({outputs[0]}, {outputs[1]}, w[{inputs[0]}]);", inputs, []))
        else:
            text = expression(operation, [f"w[{i}]" for i in inputs])
            found.append((f"w[{outputs[0]}] = {text};", inputs, outputs))
    return found


def _divided_kernel(function: ca.Function) -> tuple[str, list[str]]:
    """As ``kernel``, for a long function: the kernel calls parts of at most UNIT_SIZE instructions, which are returned
    behind it. A part takes what it needs of the work array into variables of its own, and gives back what later ones
    need."""
    statements, name = _statements(function), function.name()
    size = -(-len(statements) // -(-len(statements) // UNIT_SIZE))
    parts: list[str] = []
    heads: list[str] = []
    needed: set[int] = set()
    for begin in reversed(range(0, len(statements), size)):
        mine = statements[begin : begin + size]
        last = {i: k for k, (_, _, writes) in enumerate(mine) for i in writes}
        known: set[int] = set()
        lines, taken = [], set[int]()
        for k, (text, reads, writes) in enumerate(mine):
            new = set(reads) - known
            lines += [f"V w{i} = w[{i}];" for i in sorted(new)]
            lines += [f"V w{i};" for i in writes if i not in known | new]
            lines.append(re.sub(r"\bw\[(\d+)\]", r"w\1", text))
            lines += [f"w[{i}] = w{i};" for i in writes if i in needed and last[i] == k]
            known |= new | set(writes)
            taken |= new
        needed = needed - set(last) | taken
        heads.insert(0, f"void {name}_{begin // size}(V* w, long long at, {_CALLED_WITH})")
        parts.insert(0, f"{_MACROS}HIDDEN {heads[0]} {{\n  {NEWLINE.join(lines)}\n}}\n")
    calls = NEWLINE.join(f"  {name}_{i}(w, at, points, arg, ld, res);" for i in range(len(parts)))
    whole = f"""{"".join(f"HIDDEN {head};{NEWLINE}" for head in heads)}
{_signature(function)} {{
  V w[{function.sz_w()}];
  for (long long at = 0; at < points; at += LANES) {{
  {calls}
  }}
}}
"""
    return whole, parts


def _hot_kernel(function: ca.Function) -> str:
    """As ``kernel``, for VECTORS at a time; one that is left over goes alone."""
    sizes = [function.nnz_in(i) for i in range(function.n_in())]
    found = [function.nnz_out(j) for j in range(function.n_out())]
    program = Program.of(function, [1] * len(sizes))
    arguments = {i: f"x{i}" for i in range(len(sizes))}
    body = staged_bodies(program, range(len(found)), arguments, {}, "d", fuse=True)[1].text
    blocks = [_block(body, sizes, found, vectors) for vectors in (VECTORS, 1)]
    return f"""
#define EACH(k, size) for (long long k = 0; k < size; k++) for (int e = 0; e < vectors; e++)
#define READ(i, size) EACH(k, size) x##i[k * vectors + e] = load(arg[i] + k * ld[i] + at + e * LANES);
#define SHARED(i, size) EACH(k, size) x##i[k * vectors + e] = fill(arg[i][k]);
#define WRITE(j, size, from) EACH(k, size) store(res[j] + k * points + at + e * LANES, d[(from + k) * vectors + e]);
EXPORT void {function.name()}(long long points, const double* const* arg, const long long* ld, double* const* res) {{
  long long at = 0;
  {"".join(blocks)}
}}
#undef EACH
#undef READ
#undef SHARED
#undef WRITE
"""


def _block(body: str, sizes: Sequence[int], found: Sequence[int], vectors: int) -> str:
    """C loop over what is left of the points, so many ``vectors`` at a time.

    body: statements for one; sizes, found: numbers in each argument and each result.
    """
    arrays = "; ".join(f"V x{i}[{size * vectors + 1}]" for i, size in enumerate(sizes))
    shared = " ".join(f"if (!ld[{i}]) SHARED({i}, {size})" for i, size in enumerate(sizes))
    reads = " ".join(f"if (ld[{i}]) READ({i}, {size})" for i, size in enumerate(sizes))
    writes = " ".join(f"if (res[{j}]) WRITE({j}, {size}, {sum(found[:j])})" for j, size in enumerate(found))
    return f"""if (points - at >= {vectors} * LANES) {{
    enum {{ vectors = {vectors} }};
    {arrays}; V d[{sum(found) * vectors + 1}];
    {shared}
    for (; points - at >= vectors * LANES; at += vectors * LANES) {{
      {reads}
      {side_by_side(body, "xd", vectors)}
      {writes}
    }}
  }}
  """


def source(functions: Sequence[ca.Function], hot: bool = False) -> str:
    """C source, in units, with a batch kernel for each of the ``functions`` (SXFunctions with distinct names).

    hot: whether they are worked for VECTORS at a time where all of them have at most FEW instructions.
    """
    hot = hot and all(f.n_instructions() <= FEW for f in functions)
    long = [] if hot else [_divided_kernel(f) for f in functions if f.n_instructions() > UNIT_SIZE]
    short = [f for f in functions if hot or f.n_instructions() <= UNIT_SIZE]
    head = prelude(hot=hot)
    first = head + (HIDDEN if long else "") + "".join(_hot_kernel(f) if hot else kernel(f) for f in short)
    units = [head + HIDDEN + part for _, parts in long for part in parts]
    return UNIT.join([first + "".join(whole for whole, _ in long), *units])

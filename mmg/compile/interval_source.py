"""C source of shooting intervals: states, sensitivities, adjoints and second derivatives, LANES intervals at once.

An interval integrates at most K Runge-Kutta steps from its start state with inputs held over each step. ``values``
gives its states. ``linearise`` also carries the sensitivities Z (S, N) of the state, N = S + P columns for the start
state and the P free coefficients, through the stages. ``gradient`` goes back over the steps with the adjoints of a
cost alone, for long intervals of which nobody asks the sensitivities. ``curve`` goes back with those of a weighted sum
and collects its Hessian. What is summed there has the form A^T B + B^T A: with the sensitivities Q of a stage's
arguments and the Hessian (H_qq, H_qc, H_cc) of the weighted rates, A = Q and B = 1/2 H_qq Q + H_qc; with the Hessian F
of the samples' cost, A = Z and B = 1/2 F Z. The rows of A and B of all stages and steps stay in the
processor's cache, and the products run in registers. Everything is emitted from the one symbolic expression of the
rates. Where asked, the stage in the middle of a step stands for all four in the second derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from mmg.compile.cache import LONG, UNIT
from mmg.compile.codegen import HIDDEN, Program, c_file, divided_code, prelude, units_of
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS

# Rows and columns of the products that are kept in registers; columns are padded to whole tiles.
TILE = 4  # set by hand: speed alone
STACK = 4  # Stages, and samples, whose rows are multiplied at once. Set by hand: speed alone.

NEWLINE = "\n  "
# Arguments of a part of the rates or of their derivatives: states, inputs, coefficients, multipliers, what depends on
# the coefficients alone and on the inputs besides, results.
_AT = "const V* q, const V* c, const V* p, const V* u, const V* K, const V* H, V* d"
_DECLARED = (
    "HIDDEN void {}_shared(const V* p, V* K)",
    "HIDDEN void {}_inputs(const V* c, const V* p, const V* K, V* H)",
)
_ARGUMENTS = {0: "q", 1: "c", 2: "p", 3: "u"}  # argument of ``derivatives`` -> its C array
_ARRAYS = {1: "K", 2: "H"}  # stage -> C array of what it hands on


def derivatives(
    rates: ca.SX, q: ca.SX, inputs: ca.SX, coefficients: ca.SX, free: Sequence[int] | np.ndarray, second: bool
) -> ca.Function:
    """What an interval is made of: (q (Q,), inputs (C,), coefficients, multipliers (S,)) -> dense rates (S,), their
    Jacobian (S, Q + P) to q and the P ``free`` coefficients, upper triangle of the Hessian (Q + P, Q + P) of
    multipliers . rates. Multipliers and Hessian are there where ``second`` derivatives are wanted.

    rates: (S,) expression of the other arguments, of whose states q are the last; free: positions of coefficients.
    """
    z, mu = ca.vertcat(q, *[coefficients[int(i)] for i in free]), ca.SX.sym("mu", rates.numel())
    arguments, results = [q, inputs, coefficients], [ca.densify(rates), ca.jacobian(rates, z)]
    if second:
        arguments.append(mu)
        results.append(ca.triu(ca.hessian(ca.dot(mu, rates), z)[0]))  # symmetric: the upper half is enough
    return ca.Function("whole", arguments, results)


def interval_source(whole: ca.Function) -> str:
    """C source, in units, with ``values``, ``linearise``, ``gradient`` and ``curve``, all ``(const Run*)``.

    whole: as of ``derivatives``; without second ones there is no ``curve``. Raises NotImplementedError for an operation
    without C.
    """
    S, Q, J, second = whole.size1_out(0), whole.size1_in(0), whole.sparsity_out(1), whole.n_out() > 2
    H = whole.sparsity_out(2) if second else ca.Sparsity(0, 0)
    sizes = {
        "S": S, "FIRST": S - Q, "Q": Q, "P": J.size2() - Q, "C": whole.size1_in(1), "ALL": whole.size1_in(2),
        "NJ": J.nnz(), "NH": H.nnz(), "N": S + J.size2() - Q, "W": -(-(S + J.size2() - Q) // TILE) * TILE, "TILE": TILE,
        "MIDDLE": MIDDLE, "STACK": STACK, "CURVE": int(second),
    }  # fmt: skip
    program = Program.of(whole, (3, 2, 1, 3)[: whole.n_in()])  # of the state, inputs, coefficients, multipliers
    head, units, declared, sizes_of = prelude() + HIDDEN, list[str](), list[str](), [0, 0]
    for name, outputs in (("rates", [0]), ("jacobian", [0, 1]), ("hessian", [2]))[: whole.n_out()]:
        code = divided_code(name, program, outputs, _ARGUMENTS, _ARRAYS)
        sizes_of = [max(a, code.early[stage].handed) for a, stage in zip(sizes_of, _ARRAYS, strict=True)]
        early = {line.format(name): code.early[i].text for i, line in enumerate(_DECLARED, 1)}
        functions = [f"{line} {{{NEWLINE}{body}\n}}\n" for line, body in early.items()] + code.functions
        units += units_of(LONG + head if name == "hessian" else head, functions)  # LONG: what is called seldom
        declared += [*(f"{line};\n" for line in early), code.declared]
        declared.append(f"static void {name}_at({_AT}) {{\n  {code.call}\n}}\n")
    text = [head, _head(sizes), *declared, f"#define KEPT {sizes_of[0] + 1}\n#define HELD {sizes_of[1] + 1}\n"]
    text += [c_file(__file__, "intervals.h"), _through(J, S, Q), _bent(H, Q, S)]
    text += [_multiply()] if second else []
    return UNIT.join(["".join([*text, c_file(__file__, "intervals.c")]), *units])


def _head(sizes: dict[str, int]) -> str:
    """Sizes and the numbers of the Runge-Kutta method."""
    tables = "".join(
        f"static const double {name}[4] = {{{', '.join(repr(float(v)) for v in values)}}};\n"
        for name, values in (("AT", NODES), ("PART", WEIGHTS))
    )
    return "".join(f"#define {name} {value}\n" for name, value in sizes.items()) + tables


def _through(J: ca.Sparsity, S: int, Q: int) -> str:
    """C functions that apply the Jacobian: ``through`` carries each column of the sensitivities through the stages of a
    step, in registers, ``pulled`` is J_q^T u, and ``pulled_free`` adds J_c^T u for the free coefficients c."""
    rows, columns = J.get_triplet()
    # terms of each row of the sensitivities' rates, and of each state's adjoint
    ahead: list[list[str]] = [[] for _ in range(S)]
    back: list[list[str]] = [[] for _ in range(Q)]
    mixed = sorted({r for r, c in zip(rows, columns, strict=True) if c >= Q})  # rates that see free coefficients
    own, free = [], []
    for at, (r, c) in enumerate(zip(rows, columns, strict=True)):
        if c < Q:
            ahead[r].append(f"J[{at}], g{c}")
            back[c].append(f"J[{at}] * u[{r}]")
        else:
            free.append(f"b[{c - Q}] = more(J[{at}], u[{r}], b[{c - Q}]);")
            own.append(f"own[{mixed.index(r)} * W + {S + c - Q}] = J[{at}];")
    changing = [r for r in range(S) if ahead[r] or r in mixed]  # those of the other states stay
    sums = {r: f"own[{mixed.index(r)} * W + j]" if r in mixed else "fill(0.0)" for r in changing}
    for r in changing:
        for term in ahead[r]:
            sums[r] = f"more({term}, {sums[r]})"
    # z: a column at the begin of the step, d: its rates in the stage before, t: their weighted sum, g: in this stage
    stage = [f"const V g{r - S + Q} = {f'more(f, d{r}, z{r})' if r in changing else f'z{r}'};" for r in range(S - Q, S)]
    keep = " ".join(f"G[{c} * W] = g{c};" for c in range(Q))
    stage += [f"if (w->kept >> g & 1) {{ V* G = w->G + (k * 4 + g) * Q * W + j; {keep} }}"]
    stage += [f"d{r} = {sums[r]};" for r in changing] + [f"t{r} = more(part, d{r}, t{r});" for r in changing]
    begin = [f"V z{r} = w->Z[{r} * W + j];" for r in range(S)]
    begin += [f"V d{r} = fill(0.0), t{r} = fill(0.0);" for r in changing]
    end = [f"w->Z[{r} * W + j] = z{r} = choose(active, more(h, t{r}, z{r}), z{r});" for r in changing]
    slope = "slope[j]"
    for r in range(S):
        slope = f"more(pull[{r}], z{r}, {slope})"
    pulled = [f"b[{c}] = {' + '.join(terms) or 'fill(0.0)'};" for c, terms in enumerate(back)]
    line, inner = "\n    ", "\n      "
    return f"""#define MIXED {len(mixed)}
static void through(const Run* r, Work* w, long long k, V h, M active, const V* pull, V* slope) {{
  for (int g = 0; g < 4; g++) {{
    const V* J = w->J + (k * 4 + g) * NJ;
    V* own = w->own + g * MIXED * W;
    {line.join(own)}
  }}
  const long long wide = r->columns ? r->wide : W;
  for (long long n = 0; n < wide; n++) {{
    const long long j = r->columns ? r->columns[n] : n;
    {line.join(begin)}
    for (int g = 0; g < 4; g++) {{
      const V *J = w->J + (k * 4 + g) * NJ, *own = w->own + g * MIXED * W;
      const V part = fill(PART[g]), f = AT[g] * h;
      {inner.join(stage)}
    }}
    {line.join(end)}
    if (pull) slope[j] = {slope};
  }}
}}
static void pulled(const V* J, const V* u, V* b) {{
  {NEWLINE.join(pulled)}
}}
static void pulled_free(const V* J, const V* u, V* b) {{
  {NEWLINE.join(free)}
}}
"""


def _bent(H: ca.Sparsity, Q: int, S: int) -> str:
    """C functions of the second derivatives X of a stage: ``bent`` for the rows B = 1/2 H_qq G + H_qc of the states on
    which the rates depend nonlinearly (R of them, as ``chosen`` copies those of A) and for adding H_cc to its sums; and
    ``edge`` for H_qc of the other states, lags for instance, which is a few columns of the product.
    """
    rows, columns = H.get_triplet()
    dense = sorted({i for r, c in zip(rows, columns, strict=True) if c < Q for i in (r, c)})  # nonlinear states
    terms: dict[int, list[str]] = {r: [] for r in dense}
    mixed, edge, own = [], [], []  # statements for H_qc of those states, H_qc of the others, H_cc
    where: list[tuple[int, int]] = []  # rows and columns of H_cc
    for at, (r, c) in enumerate(zip(rows, columns, strict=True)):
        if c < Q:
            terms[r].append(f"X[{at}] * G[{c} * W + j]")
            if r != c:  # off the diagonal each number of the upper half stands for two
                terms[c].append(f"X[{at}] * G[{r} * W + j]")
        elif r in terms:
            mixed.append(f"B[PANEL({dense.index(r)}, {S + c - Q})] += X[{at}];")
        elif r < Q:
            edge.append(f"column(w, {S + c - Q}, X[{at}], G + {r} * W);")
        else:
            own.append(f"sum[{len(where)}] += X[{at}];")
            where.append((r - Q, c - Q))
    lines = [f"B[{k} * TILE + e] = 0.5 * ({' + '.join(terms[r])});" for k, r in enumerate(dense)]  # A^T B + B^T A
    copies = [f"A[{k} * TILE + e] = G[{r} * W + j];" for k, r in enumerate(dense)]
    pairs = ", ".join(f"{{{r}, {c}}}" for r, c in where) or "{0, 0}"  # C has no empty arrays
    inside = "\n    ".join([*copies, *lines])
    return f"""#define OWN {len(where)}
#define R {len(dense)}
static const short own_at[OWN + 1][2] = {{{pairs}}};
#define PANEL(r, j) ((j) / TILE * panel + (r) * TILE + (j) % TILE)
static void bent(const V* X, const V* G, V* A, V* B, long long panel, V* sum) {{
  V* first = B;
  for (int t = 0; t < W; t += TILE, A += panel, B += panel) for (int e = 0; e < TILE; e++) {{
    const int j = t + e;
    {inside}
  }}
  B = first;
  {NEWLINE.join(mixed + own)}
}}
static void edge(const V* X, const V* G, Work* w) {{
  {NEWLINE.join(edge)}
}}
"""


def _multiply() -> str:
    """C function that adds A^T B to the product, a tile in registers at a time: written out, since compilers leave
    arrays of vectors in memory. Of the ``even`` rows A^T B is symmetric: they are left out below the diagonal and count
    twice above it."""
    each = [(e, f) for e in range(TILE) for f in range(TILE)]
    none = " ".join(f"V t{e}{f} = fill(0.0);" for e, f in each)
    double = " ".join(f"t{e}{f} = t{e}{f} + t{e}{f};" for e, f in each)
    loads = " ".join(f"const V x{e} = x[{e}], y{e} = y[{e}];" for e in range(TILE))
    add = " ".join(f"t{e}{f} = more(x{e}, y{f}, t{e}{f});" for e, f in each)
    write = " ".join(f"sum[{e * TILE + f}] = sum[{e * TILE + f}] + t{e}{f};" for e, f in each)
    return f"""static void multiply(Work* w) {{
  V* sum = w->product;
  for (int a = 0; a < W / TILE; a++)
    for (int b = 0; b < W / TILE; b++, sum += TILE * TILE) {{
      if (b < a && !w->odd) continue;
      const V *x = w->A + a * w->panel, *y = w->B + b * w->panel;
      int n = 0;
      {none}
      if (b >= a) for (; n < w->even; n++, x += TILE, y += TILE) {{
        {loads}
        {add}
      }}
      if (b > a) {{ {double} }}
      x = w->A + a * w->panel + STACK * S * TILE, y = w->B + b * w->panel + STACK * S * TILE;
      for (n = 0; n < w->odd; n++, x += TILE, y += TILE) {{
        {loads}
        {add}
      }}
      {write}
    }}
  w->even = w->odd = 0;
}}
"""

"""C source of shooting intervals: states, sensitivities, adjoints and second derivatives, LANES intervals at once.

An interval integrates at most K Runge-Kutta steps from its start state with inputs held over each step. ``values``
gives its states. ``linearise`` also carries the sensitivities Z (S, N) of the state, N = S + P columns for the start
state and the P free coefficients, through the stages. ``curve`` goes back over the steps with the adjoints of a
weighted sum and collects its Hessian. What is summed there has the form A^T B + B^T A: with the sensitivities Q of a
stage's arguments and the Hessian (H_qq, H_qc, H_cc) of the weighted rates, A = Q and B = 1/2 H_qq Q + H_qc; with the
Hessian F of the samples' cost, A = Z and B = 1/2 F Z. The rows of A and B of all stages and steps stay in the
processor's cache, and the products run in registers. Everything is emitted from the one symbolic expression of the
rates. Where asked, the stage in the middle of a step stands for all four in the second derivatives.
"""

from __future__ import annotations

import casadi as ca

from mmg.compile.cache import LONG, UNIT
from mmg.compile.codegen import HIDDEN, prelude
from mmg.compile.stages import Program, divided_code, units_of
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS

TYPES = """
#include <stdlib.h>
typedef struct {
  long long lanes, steps, groups, extra, middle;
  const double *start, *controls, *theta, *h;
  const long long *count, *group, *slot, *interval;
  double *end, *interior;
  const double *pull;
  double *ends, *slope;
  const double *cost, *weight;
  const long long* own;
  double *rows, *shared;
} Run;
/* start S x lanes, controls steps x C x lanes, theta ALL x groups; count, group, slot, interval by lane; a slot of -1:
   none, of a lane that only fills a vector; end S x lanes, interior (steps - 1) x S x lanes; pull (steps - 1) x S x
   lanes: gradient of the samples' cost; ends intervals x S x N and slope intervals x N; cost (steps - 1) x (S + extra)
   (S + extra + 1) / 2 x lanes: upper triangle by rows of their Hessian to the state and to the coefficients own[extra];
   weight S x lanes of the end, or null for none; rows intervals x S x N; shared slots x P x P, upper triangle; middle:
   whether second derivatives are taken once a step, in its middle. */

typedef struct { V p[ALL + 1], z[S], steps, shared_r[KEPT], shared_j[KEPT], shared_h[KEPT]; } Block;

/* Scratch of one block: G (steps x 4 x Q x W) sensitivities of the stages' arguments, of stages in the bits of kept, F
   (steps + 1) x FIRST x W those of the leading states before each step, J (steps x 4 x NJ), q (steps x 4 x Q), c
   (steps x C), Z (S x W) sensitivities of the state, own (4 x MIXED x W) derivatives of the rates by coefficients, A
   and B panels of TILE columns: even rows, whose product is symmetric, then odd others, until they are multiplied. */
typedef struct {
  Block b;
  V *G, *F, *J, *q, *c, *A, *B, *X, *sum, *Z, *own, *product;
  long long panel;
  int even, odd, kept;
  int state[S + 1];
} Work;

/* Where element (a, b) of the product lies: tiles of TILE x TILE, row by row. */
#define AB(a, b) (((a) / TILE * (W / TILE) + (b) / TILE) * TILE * TILE + (a) % TILE * TILE + (b) % TILE)
/* Adds x times a row of all columns to the product's row c. */
static void across(Work* w, int c, V x, const V* row) {
  for (int a = 0; a < W; a++) w->product[AB(c, a)] = more(x, row[a], w->product[AB(c, a)]);
}
/* Adds x times a row of all columns to the product's column c. */
static void column(Work* w, int c, V x, const V* row) {
  V* sum = w->product + c / TILE * TILE * TILE + c % TILE;
  for (int a = 0; a < W; a += TILE, sum += W * TILE)
    for (int e = 0; e < TILE; e++) sum[e * TILE] = more(x, row[a + e], sum[e * TILE]);
}
"""
"""What the ship's own functions need: arguments, vectors, scratch, places of the product."""

LOOPS = """
static void begin_block(const Run* r, long long i, Block* b, int order) {
  for (int j = 0; j < ALL; j++) for (int l = 0; l < LANES; l++) b->p[j][l] = r->theta[j * r->groups + r->group[i + l]];
  for (int l = 0; l < LANES; l++) b->steps[l] = (double)r->count[i + l];
  for (int s = 0; s < S; s++) b->z[s] = load(r->start + s * r->lanes + i);
  if (order == 0) rates_shared(b->p, b->shared_r); else jacobian_shared(b->p, b->shared_j);
  if (order == 2) hessian_shared(b->p, b->shared_h);
}
static void read_inputs(const Run* r, long long k, long long i, V* c) {
  for (int j = 0; j < C; j++) c[j] = load(r->controls + (k * C + j) * r->lanes + i);
}
static void keep_states(const Run* r, long long k, long long i, const V* z) {
  double* to = k == r->steps - 1 ? r->end : r->interior + k * S * r->lanes;
  if (to) for (int s = 0; s < S; s++) store(to + s * r->lanes + i, z[s]);
}

static void* aligned(size_t size, void** base) {
  *base = malloc(size + sizeof(V));
  return *base ? (char*)*base + sizeof(V) - (size_t)*base % sizeof(V) : 0;
}

EXPORT int values(const Run* r, long long begin, long long end) {
  void* base;
  Block* b = aligned(sizeof *b, &base);
  if (!b) return 1;
  const V h = fill(*r->h);
  V c[C + 1], held[HELD], rate[S], total[S], q[S];
  for (long long i = begin * LANES; i < end * LANES; i += LANES) {
    begin_block(r, i, b, 0);
    for (long long k = 0; k < r->steps; k++) {
      const M active = b->steps > (double)k;
      read_inputs(r, k, i, c);
      rates_inputs(c, b->p, b->shared_r, held);
      for (int s = 0; s < S; s++) rate[s] = total[s] = fill(0.0);
      for (int g = 0; g < 4; g++) {
        for (int s = 0; s < S; s++) q[s] = b->z[s] + AT[g] * h * rate[s];
        rates_at(q + FIRST, c, b->p, q, b->shared_r, held, rate);
        for (int s = 0; s < S; s++) total[s] = total[s] + PART[g] * rate[s];
      }
      for (int s = 0; s < S; s++) b->z[s] = choose(active, b->z[s] + h * total[s], b->z[s]);
      keep_states(r, k, i, b->z);
    }
  }
  free(base);
  return 0;
}

static V* room(V** at, long long size) { V* here = *at; *at += size; return here; }
/* A row of N vectors of the lanes from i on, to the row at of each of their intervals, which has ``all`` rows. */
static void give_rows(const Run* r, long long i, const V* from, double* to, int at, int all) {
  for (int l = 0; l < LANES; l++) {
    if (r->slot[i + l] < 0) continue;
    double* row = to + (r->interval[i + l] * all + at) * N;
    for (int j = 0; j < N; j++) row[j] = from[j][l];
  }
}

static Work* work(const Run* r, int order, void** base) {
  const long long K = r->steps, panel = STACK * (S + R) * TILE;
  const long long size = K * (4 * (NJ + Q) + C) + (S + 4 * MIXED) * W
    + (order == 2 ? K * 4 * Q * W + (K + 1) * FIRST * W + NH + OWN + 1 + 2 * panel * (W / TILE) + W * W : 0);
  Work* w = aligned(sizeof *w + sizeof(V) * (size_t)size, base);
  if (!w) return 0;
  V* at = (V*)(w + 1);
  w->panel = panel;
  w->even = w->odd = 0;
  w->J = room(&at, K * 4 * NJ); w->q = room(&at, K * 4 * Q); w->c = room(&at, K * C); w->Z = room(&at, S * W);
  w->own = room(&at, 4 * MIXED * W);
  memset(w->own, 0, sizeof(V) * 4 * MIXED * W);
  w->kept = order < 2 ? 0 : r->middle ? 1 | 1 << MIDDLE : 15;
  if (order < 2) return w;
  w->G = room(&at, K * 4 * Q * W); w->F = room(&at, (K + 1) * FIRST * W); w->X = room(&at, NH);
  w->sum = room(&at, OWN + 1);
  w->A = room(&at, panel * (W / TILE)); w->B = room(&at, panel * (W / TILE)); w->product = room(&at, W * W);
  return w;
}

/* Stages of step k: states, rates and their derivatives. */
static void one_step(const Run* r, Work* w, long long k, long long i) {
  const V h = fill(*r->h);
  const M active = w->b.steps > (double)k;
  V held[HELD], rate[S], total[S], d[S + NJ], *c = w->c + k * C;
  read_inputs(r, k, i, c);
  jacobian_inputs(c, w->b.p, w->b.shared_j, held);
  for (int s = 0; s < S; s++) rate[s] = total[s] = fill(0.0);
  for (int g = 0; g < 4; g++) {
    V* q = w->q + (k * 4 + g) * Q;
    for (int s = 0; s < Q; s++) q[s] = w->b.z[FIRST + s] + AT[g] * h * rate[FIRST + s];
    jacobian_at(q, c, w->b.p, q, w->b.shared_j, held, d);
    memcpy(rate, d, sizeof(V) * S);
    memcpy(w->J + (k * 4 + g) * NJ, d + S, sizeof(V) * NJ);
    for (int s = 0; s < S; s++) total[s] = total[s] + PART[g] * rate[s];
  }
  for (int s = 0; s < S; s++) w->b.z[s] = choose(active, w->b.z[s] + h * total[s], w->b.z[s]);
  keep_states(r, k, i, w->b.z);
}

static void sweep(const Run* r, Work* w, long long i, int order) {
  V slope[W], pull[S];
  begin_block(r, i, &w->b, order);
  memset(w->Z, 0, sizeof(V) * S * W);
  for (int s = 0; s < S; s++) w->Z[s * W + s] = fill(1.0);
  memset(slope, 0, sizeof slope);
  for (long long k = 0; k < r->steps; k++) {
    if (order == 2) memcpy(w->F + k * FIRST * W, w->Z, sizeof(V) * FIRST * W);
    one_step(r, w, k, i);
    const int inside = k < r->steps - 1;
    if (inside) for (int s = 0; s < S; s++) pull[s] = load(r->pull + (k * S + s) * r->lanes + i);
    through(w, k, fill(*r->h), w->b.steps > (double)k, inside ? pull : 0, slope);
  }
  if (order == 2) memcpy(w->F + r->steps * FIRST * W, w->Z, sizeof(V) * FIRST * W);
  for (int s = 0; s < S; s++) give_rows(r, i, w->Z + s * W, r->ends, s, S);
  give_rows(r, i, slope, r->slope, 0, 1);
}

EXPORT int linearise(const Run* r, long long begin, long long end) {
  void* base;
  Work* w = work(r, 1, &base);
  for (long long i = begin; w && i < end; i++) sweep(r, w, i * LANES, 1);
  free(base);
  return w == 0;
}

static const V* sensitivity(const Work* w, long long k, int s) {
  return s < FIRST ? w->F + (k * FIRST + s) * W : w->G + (k * 4 * Q + s - FIRST) * W;
}

/* Rows of the cost of the samples after step k: the sensitivities of the states, then the own coefficients. */
static void add_samples(const Run* r, Work* w, long long k, long long i) {
  const int size = S + (int)r->extra;
  const double* cost = r->cost + k * (size * (size + 1) / 2) * r->lanes + i;
  for (int a = 0; a < size; a++) {
    V each[S + 1];
    int used = 0;
    for (int b = 0; b < size; b++) {  /* row a of the symmetric matrix, of which the upper triangle is given */
      const int low = a < b ? a : b, high = a < b ? b : a;
      const V f = 0.5 * load(cost + (low * (2 * size - low - 1) / 2 + high) * r->lanes);
      if (!any(f != 0.0)) continue;
      if (b < S) { each[used] = f; w->state[used++] = b; continue; }
      if (a < S) column(w, S + (int)r->own[b - S], f, sensitivity(w, k + 1, a));
      else w->product[AB(S + r->own[a - S], S + r->own[b - S])] += f;
    }
    if (a >= S) {
      for (int n = 0; n < used; n++) across(w, S + (int)r->own[a - S], each[n], sensitivity(w, k + 1, w->state[n]));
      continue;
    }
    if (!used) continue;
    const V *Z = sensitivity(w, k + 1, a), *other[S + 1];
    for (int n = 0; n < used; n++) other[n] = sensitivity(w, k + 1, w->state[n]);
    V *A = w->A + w->even * TILE, *B = w->B + w->even * TILE;
    for (int t = 0; t < W; t += TILE, A += w->panel, B += w->panel)
      for (int e = 0; e < TILE; e++) {
        V sum = each[0] * other[0][t + e];
        for (int n = 1; n < used; n++) sum = more(each[n], other[n][t + e], sum);
        A[e] = Z[t + e];
        B[e] = sum;
      }
    w->even++;
  }
}

/* Rows of stage g of step k, whose rates have the multipliers u. */
static void add_stage(Work* w, long long k, int g, const V* u, const V* held) {
  const V *G = w->G + (k * 4 + g) * Q * W, *q = w->q + (k * 4 + g) * Q;
  hessian_at(q, w->c + k * C, w->b.p, u, w->b.shared_h, held, w->X);
  const long long at = (STACK * S + w->odd) * TILE;
  bent(w->X, G, w->A + at, w->B + at, w->panel, w->sum);
  edge(w->X, G, w);
  w->odd += R;
}

/* Rows of step k from the adjoints of its end, which are moved to its begin. */
static void add_stages(const Run* r, Work* w, long long k, V* adjoint) {
  const V h = fill(*r->h);
  const M active = w->b.steps > (double)k;
  V held[HELD], later[S], back[S], u[S], whole[S], moved[Q];
  hessian_inputs(w->c + k * C, w->b.p, w->b.shared_h, held);
  for (int s = 0; s < S; s++) { later[s] = whole[s] = fill(0.0); back[s] = adjoint[s]; }
  for (int g = 3; g >= 0; g--) {
    for (int s = 0; s < S; s++) u[s] = choose(active, h * PART[g] * adjoint[s] + later[s], fill(0.0));
    pulled(w->J + (k * 4 + g) * NJ, u, moved);
    for (int s = 0; s < Q; s++) { back[FIRST + s] += moved[s]; later[FIRST + s] = h * AT[g] * moved[s]; }
    if (r->middle) for (int s = 0; s < S; s++) whole[s] += u[s];
    else add_stage(w, k, g, u, held);
  }
  for (int s = 0; s < S; s++) adjoint[s] = back[s];
  if (r->middle) add_stage(w, k, MIDDLE, whole, held);
}

static V twice(const Work* w, int a, int b) { return w->product[AB(a, b)] + w->product[AB(b, a)]; }

static void add_shared(const Run* r, long long i, int a, int b, V x) {
  for (int l = 0; l < LANES; l++) if (r->slot[i + l] >= 0) r->shared[(r->slot[i + l] * P + a) * P + b] += x[l];
}

static void clear_sums(Work* w) {
  for (int e = 0; e < OWN; e++) w->sum[e] = fill(0.0);
  memset(w->product, 0, sizeof(V) * W * W);
}

static void add_coefficients(const Run* r, const Work* w, long long i) {
  for (int a = S; a < N; a++) for (int b = a; b < N; b++) add_shared(r, i, a - S, b - S, twice(w, a, b));
  for (int e = 0; e < OWN; e++) add_shared(r, i, own_at[e][0], own_at[e][1], w->sum[e]);
}

EXPORT int curve(const Run* r, long long begin, long long end) {
  void* base;
  Work* w = work(r, 2, &base);
  if (w) clear_sums(w);
  for (long long at = begin; w && at < end; at++) {
    const long long i = at * LANES;
    sweep(r, w, i, 2);
    V adjoint[S];
    for (int s = 0; s < S; s++) adjoint[s] = r->weight ? load(r->weight + s * r->lanes + i) : fill(0.0);
    for (long long k = r->steps - 1; k >= 0; k--) {
      if (w->even + S > STACK * S || w->odd + (r->middle ? R : 4 * R) > STACK * R) multiply(w);
      if (k < r->steps - 1) {
        add_samples(r, w, k, i);
        if (r->weight) for (int s = 0; s < S; s++) adjoint[s] += load(r->pull + (k * S + s) * r->lanes + i);
      }
      if (r->weight) add_stages(r, w, k, adjoint);
    }
    multiply(w);
    for (int a = 0; a < S; a++) {
      V row[N];
      for (int b = 0; b < N; b++) row[b] = twice(w, a, b);
      give_rows(r, i, row, r->rows, a, S);
    }
    for (int a = 0; a < S; a++) for (int b = 0; b < N; b++) w->product[AB(a, b)] = w->product[AB(b, a)] = fill(0.0);
    if (at + 1 < end && !memcmp(r->slot + i, r->slot + i + LANES, LANES * sizeof *r->slot)) continue;
    add_coefficients(r, w, i);
    clear_sums(w);
  }
  free(base);
  return w == 0;
}
"""
"""The loops over steps and blocks, and the functions that Python calls."""

TILE = 4
"""Rows and columns of the products that are kept in registers; columns are padded to whole tiles."""


STACK = 4
"""Stages, and samples, whose rows are multiplied at once."""

NEWLINE = "\n  "
_AT = "const V* q, const V* c, const V* p, const V* u, const V* K, const V* H, V* d"
_DECLARED = (
    "HIDDEN void {}_shared(const V* p, V* K)",
    "HIDDEN void {}_inputs(const V* c, const V* p, const V* K, V* H)",
)
_ARGUMENTS = {0: "q", 1: "c", 2: "p", 3: "u"}
_ARRAYS = {1: "K", 2: "H"}


def interval_source(whole: ca.Function) -> str:
    """C source, in units, with ``values``, ``linearise`` and ``curve``, all ``(const Run*, long long begin, long long
    end)`` for the blocks of LANES intervals from begin to end.

    whole: SXFunction (q (Q,), inputs (C,), coefficients, multipliers (S,)) -> dense rates (S,) of which q are the last
    states, their Jacobian (S, Q + P) to q and the P free coefficients, upper triangle of the Hessian (Q + P, Q + P) of
    multipliers . rates. Raises NotImplementedError for an operation without C.
    """
    S, Q, J, H = whole.size1_out(0), whole.size1_in(0), whole.sparsity_out(1), whole.sparsity_out(2)
    sizes = {
        "S": S, "FIRST": S - Q, "Q": Q, "P": J.size2() - Q, "C": whole.size1_in(1), "ALL": whole.size1_in(2),
        "NJ": J.nnz(), "NH": H.nnz(), "N": S + J.size2() - Q, "W": -(-(S + J.size2() - Q) // TILE) * TILE, "TILE": TILE,
        "MIDDLE": MIDDLE, "STACK": STACK,
    }  # fmt: skip
    program = Program.of(whole, (3, 2, 1, 3))  # of the state, inputs, coefficients, multipliers
    head, units, known, kept = prelude() + HIDDEN, list[str](), list[str](), [0, 0]
    for name, outputs in (("rates", [0]), ("jacobian", [0, 1]), ("hessian", [2])):
        code = divided_code(name, program, outputs, _ARGUMENTS, _ARRAYS)
        kept = [max(a, code.early[stage].handed) for a, stage in zip(kept, _ARRAYS, strict=True)]
        early = {line.format(name): code.early[i].text for i, line in enumerate(_DECLARED, 1)}
        functions = [f"{line} {{{NEWLINE}{body}\n}}\n" for line, body in early.items()] + code.functions
        units += units_of(LONG + head if name == "hessian" else head, functions)
        known += [*(f"{line};\n" for line in early), code.declared]
        known.append(f"static void {name}_at({_AT}) {{\n  {code.call}\n}}\n")
    text = [head, _head(sizes), *known, f"#define KEPT {kept[0] + 1}\n#define HELD {kept[1] + 1}\n"]
    first = "".join([*text, TYPES, _through(J, S, Q), _bent(H, Q, S), _multiply(), LOOPS])
    return UNIT.join([first, *units])


def _head(sizes: dict[str, int]) -> str:
    """Sizes and the numbers of the Runge-Kutta method."""
    tables = "".join(
        f"static const double {name}[4] = {{{', '.join(repr(float(v)) for v in values)}}};\n"
        for name, values in (("AT", NODES), ("PART", WEIGHTS))
    )
    return "".join(f"#define {name} {value}\n" for name, value in sizes.items()) + tables


def _through(J: ca.Sparsity, S: int, Q: int) -> str:
    """C functions that apply the Jacobian: ``through`` carries each column of the sensitivities through the stages of a
    step, in registers, and ``pulled`` is J_q^T u."""
    rows, columns = J.get_triplet()
    ahead: list[list[str]] = [[] for _ in range(S)]
    back: list[list[str]] = [[] for _ in range(Q)]
    mixed = sorted({r for r, c in zip(rows, columns, strict=True) if c >= Q})
    own = []
    for at, (r, c) in enumerate(zip(rows, columns, strict=True)):
        if c < Q:
            ahead[r].append(f"J[{at}], g{c}")
            back[c].append(f"J[{at}] * u[{r}]")
        else:
            own.append(f"own[{mixed.index(r)} * W + {S + c - Q}] = J[{at}];")
    moved = [r for r in range(S) if ahead[r] or r in mixed]
    sums = {r: f"own[{mixed.index(r)} * W + j]" if r in mixed else "fill(0.0)" for r in moved}
    for r in moved:
        for term in ahead[r]:
            sums[r] = f"more({term}, {sums[r]})"
    stage = [
        f"const V g{c} = {f'more(f, d{S - Q + c}, z{S - Q + c})' if S - Q + c in moved else f'z{S - Q + c}'};"
        for c in range(Q)
    ]
    keep = " ".join(f"G[{c} * W] = g{c};" for c in range(Q))
    stage += [f"if (w->kept >> g & 1) {{ V* G = w->G + (k * 4 + g) * Q * W + j; {keep} }}"]
    stage += [f"d{r} = {sums[r]};" for r in moved] + [f"t{r} = more(part, d{r}, t{r});" for r in moved]
    begin = [f"V z{r} = w->Z[{r} * W + j];" for r in range(S)]
    begin += [f"V d{r} = fill(0.0), t{r} = fill(0.0);" for r in moved]
    end = [f"w->Z[{r} * W + j] = z{r} = choose(active, more(h, t{r}, z{r}), z{r});" for r in moved]
    slope = "slope[j]"
    for r in range(S):
        slope = f"more(pull[{r}], z{r}, {slope})"
    pulled = [f"b[{c}] = {' + '.join(terms) or 'fill(0.0)'};" for c, terms in enumerate(back)]
    line, inner = "\n    ", "\n      "
    return f"""#define MIXED {len(mixed)}
static void through(Work* w, long long k, V h, M active, const V* pull, V* slope) {{
  for (int g = 0; g < 4; g++) {{
    const V* J = w->J + (k * 4 + g) * NJ;
    V* own = w->own + g * MIXED * W;
    {line.join(own)}
  }}
  for (int j = 0; j < W; j++) {{
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
"""


def _bent(H: ca.Sparsity, Q: int, S: int) -> str:
    """C functions of the second derivatives X of a stage: ``bent`` for the rows B = 1/2 H_qq G + H_qc of the states on
    which the rates depend nonlinearly (R of them, as ``chosen`` copies those of A) and for adding H_cc to its sums; and
    ``edge`` for H_qc of the other states, lags for instance, which is a few columns of the product.
    """
    rows, columns = H.get_triplet()
    dense = sorted({i for r, c in zip(rows, columns, strict=True) if c < Q for i in (r, c)})
    terms: dict[int, list[str]] = {r: [] for r in dense}
    mixed, edge, own = [], [], []
    where: list[tuple[int, int]] = []
    for at, (r, c) in enumerate(zip(rows, columns, strict=True)):
        if c < Q:
            terms[r].append(f"X[{at}] * G[{c} * W + j]")
            if r != c:
                terms[c].append(f"X[{at}] * G[{r} * W + j]")
        elif r in terms:
            mixed.append(f"B[PANEL({dense.index(r)}, {S + c - Q})] += X[{at}];")
        elif r < Q:
            edge.append(f"column(w, {S + c - Q}, X[{at}], G + {r} * W);")
        else:
            own.append(f"sum[{len(where)}] += X[{at}];")
            where.append((r - Q, c - Q))
    lines = [f"B[{k} * TILE + e] = 0.5 * ({' + '.join(terms[r])});" for k, r in enumerate(dense)]
    copies = [f"A[{k} * TILE + e] = G[{r} * W + j];" for k, r in enumerate(dense)]
    pairs = ", ".join(f"{{{r}, {c}}}" for r, c in where) or "{0, 0}"
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

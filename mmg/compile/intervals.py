"""Shooting intervals by compiled code, LANES of them at once: states, sensitivities, adjoints, second derivatives.

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

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from mmg.compile.batch import FLAGS, filled, padded
from mmg.compile.cache import LONG, UNIT, LateSource, load_library
from mmg.compile.codegen import HIDDEN, LANES, Program, c_file, divided_code, prelude, units_of
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
_HANDED = {1: "K", 2: "H"}  # stage -> C array of what it hands on


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
        code = divided_code(name, program, outputs, _ARGUMENTS, _HANDED)
        sizes_of = [max(a, code.early[stage].handed) for a, stage in zip(sizes_of, _HANDED, strict=True)]
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


# Blocks of LANES intervals, at least, whose sums are made apart; 8 and 4 gain nothing (RESULTS.md of 5f878e7). As
# measured in November 2026.
SHARE = 16

Wanted = tuple[np.ndarray, np.ndarray]  # Rows (states) and columns (states, then free coefficients), by number
# Of start states and coefficients, end states and their sensitivities.
Steps = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

_SIZES = ("lanes", "steps", "groups", "extra", "middle", "changes", "tall", "wide")
_ARRAYS = (
    "start", "controls", "theta", "h", "count", "group", "slot", "interval", "given", "end", "interior", "states",
    "columns", "pull", "ends", "slope", "cost", "weight", "own", "rows", "shared",
)  # fmt: skip


class _IntervalRun(ctypes.Structure):
    """The struct Run of the C code, field by field in its order (intervals.h says what each is); absent arrays null."""

    _fields_ = [(name, ctypes.c_longlong) for name in _SIZES] + [(name, ctypes.c_void_p) for name in _ARRAYS]


@dataclass(frozen=True)
class Lanes:
    """M intervals in the order in which they are calculated, in whole vectors.

    interval: (lanes,) number of the interval of each lane; steps: (lanes,) of it, 0 where a lane only fills a vector;
    controls: (K, C, lanes) held over each step, or where an interval has ``changes`` means and changes over it (K, 2 C,
    lanes); group: (lanes,) which coefficients it has; slot: (lanes,) where what belongs to the coefficients is added
    up, -1 for none; shares: first and last block of those whose sums are made apart, at the borders of slots; M: number
    of intervals; h: step [s].
    """

    interval: np.ndarray
    steps: np.ndarray
    controls: np.ndarray
    group: np.ndarray
    slot: np.ndarray
    shares: tuple[tuple[int, int], ...]
    M: int
    h: float
    changes: bool = False

    @classmethod
    def of(
        cls,
        steps: np.ndarray,
        controls: np.ndarray,
        h: float,
        group: np.ndarray,
        slot: np.ndarray,
        changes: bool = False,
    ) -> Lanes:
        """From the steps (M,), controls (K, C, M), groups (M,) and slots (M,) of the intervals, the step h [s] and
        whether the controls have changes behind them."""
        M = len(steps)
        order = np.lexsort((-steps, slot))  # by slot, then the longest first: like lengths fill a vector
        borders = np.flatnonzero(np.diff(slot[order])) + 1
        wanted = np.arange(SHARE * LANES, M, SHARE * LANES)
        # a share ends at the first border of slots behind its size: no slot is in two shares
        near = borders[np.clip(np.searchsorted(borders, wanted), 0, len(borders) - 1)] if len(borders) else borders
        parts = np.split(order, np.unique(near))
        sizes = [padded(len(part)) for part in parts]
        # vectors are filled with copies of the last interval of their share
        interval = np.concatenate([filled(part, size) for part, size in zip(parts, sizes, strict=True)])
        is_real = np.concatenate([np.arange(size) < len(part) for part, size in zip(parts, sizes, strict=True)])
        ends = np.cumsum([size // LANES for size in sizes]).tolist()
        return cls(
            interval,
            np.where(is_real, steps[interval], 0).astype(np.int64),
            np.ascontiguousarray(controls[:, :, interval], dtype=float),
            group[interval].astype(np.int64),
            np.where(is_real, slot[interval], -1).astype(np.int64),
            tuple(pairwise([0, *ends])),
            M,
            float(h),
            changes,
        )

    @cached_property
    def position(self) -> np.ndarray:
        """Lane of each interval, (M,)."""
        lane = np.zeros(self.M, dtype=int)
        real = np.flatnonzero(self.slot >= 0)  # copies that fill a vector have slot -1
        lane[self.interval[real]] = real
        return lane

    @cached_property
    def beyond(self) -> np.ndarray:
        """Which interior states an interval does not have, (K - 1, M)."""
        return np.arange(len(self.controls) - 1)[:, None] >= self.steps[self.position]

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values (..., M) of the intervals in the order of the lanes."""
        return np.ascontiguousarray(values[..., self.interval], dtype=float)

    def parts(self, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A slot for each owner in each share: that of each lane (lanes,), -1 for none, and the owner of each of them.
        owner: (slots,) of what is added up by window."""
        share = np.repeat(np.arange(len(self.shares)), [LANES * (end - begin) for begin, end in self.shares])
        real, owners = self.slot >= 0, int(owner.max()) + 1
        pairs, number = np.unique(share[real] * owners + owner[self.slot[real]], return_inverse=True)
        part = np.full(len(share), -1, dtype=np.int64)
        part[real] = number
        return part, pairs % owners


@dataclass(frozen=True)
class IntervalKernel:
    """Compiled intervals of a right-hand side of S states and P free coefficients."""

    library: ctypes.CDLL
    S: int
    P: int

    @classmethod
    def of(
        cls, whole: ca.Function, check: Callable[[IntervalKernel], str] | None = None, what: str = "equations"
    ) -> tuple[IntervalKernel | None, str]:
        """The kernel of the function ``whole`` (see ``interval_source``), or None and why there is none.

        check: what is wrong with a kernel, "" for nothing; asked of a newly compiled one before it is kept; what: it
        is, for people.
        """

        def kernel(library: ctypes.CDLL) -> IntervalKernel:
            return cls(library, whole.size1_out(0), whole.size2_out(1) - whole.size1_in(0))

        text = LateSource.of([whole], lambda: interval_source(_without_repetition(whole)), "intervals")
        library, reason = load_library(text, FLAGS, (lambda new: check(kernel(new))) if check else None, what)
        return (None if library is None else kernel(library)), reason

    def values(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, given: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K - 1, S, M) from start states (S, M) and coefficients (G, all).

        given: (K, S, M) states that replace those after each step, NaN for none, or None.
        """
        run = self._states(lanes, start, theta)
        if given is not None:
            run["given"] = lanes.spread(given)
        self._call("values", self._request(lanes, run))
        interior = run["interior"][:, :, lanes.position]
        if lanes.beyond.any():  # the kernel leaves what it does not reach unset
            interior = np.where(lanes.beyond[:, None, :], 0.0, interior)
        return run["end"][:, lanes.position], interior

    def linearise(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, wanted: Wanted | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """End states (S, M), their sensitivities (M, S, S + P) to start and free coefficients, and (M, S + P) of the
        samples' cost.

        start, theta: as of ``values``; pull: (K - 1, S, M) gradient of the cost to the interior states; wanted: rows
        and columns of the sensitivities (default: all).
        """
        run = self._sensitivities(lanes, start, theta, pull, wanted)
        self._call("linearise", self._request(lanes, run))
        return run["end"][:, lanes.position], run["ends"], run["slope"]

    def gradient(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """Gradient (M, S + P), to start and free coefficients, of a cost of the interior states and the ends, whose own
        gradients are ``pull`` (K - 1, S, M) and ``weight`` (S, M); start, theta: as of ``values``."""
        run = self._states(lanes, start, theta) | {"pull": lanes.spread(pull), "weight": lanes.spread(weight)}
        run["slope"] = np.empty((lanes.M, self.S + self.P))
        self._call("gradient", self._request(lanes, run))
        return run["slope"]

    def curve(
        self,
        lanes: Lanes,
        start: np.ndarray,
        theta: np.ndarray,
        pull: np.ndarray,
        cost: tuple[np.ndarray, np.ndarray],
        weight: np.ndarray | None,
        slot: np.ndarray,
        middle: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The sensitivities that ``linearise`` gives, then the Hessian of weight . end + cost of the interior states:
        rows of the start nodes (M, S, S + P) and, summed by slot, the block of the coefficients (slots, P, P).

        cost: upper triangles (K - 1, n (n + 1) / 2, M), row by row, of the cost's Hessian to the n = S + O of states
        and O of the free coefficients, and the positions (O,) of these; weight: (S, M), or None for the cost's Hessian
        to first order in the states (Gauss and Newton); slot: (lanes,) as of ``lanes``, none of two shares;
        middle: take second derivatives of the rates once a step, in its middle, with the multipliers of all stages.
        """
        S, N, P = self.S, self.S + self.P, self.P
        run = self._sensitivities(lanes, start, theta, pull)
        run |= {"cost": lanes.spread(cost[0]), "own": np.ascontiguousarray(cost[1], dtype=np.int64)}
        run |= {"rows": np.empty((lanes.M, S, N)), "shared": np.zeros((int(slot.max()) + 1, P, P)), "slot": slot}
        if weight is not None:
            run["weight"] = lanes.spread(weight)
        self._call("curve", self._request(lanes, run, middle))
        shared, lower = run["shared"], np.tril_indices(P, -1)
        shared[:, lower[0], lower[1]] = shared[:, lower[1], lower[0]]  # the kernel sums the upper half alone
        return run["ends"], run["slope"], run["rows"], shared

    def _states(self, lanes: Lanes, start: np.ndarray, theta: np.ndarray) -> dict[str, np.ndarray]:
        size, K = len(lanes.interval), len(lanes.controls)
        return {
            "start": lanes.spread(start),
            "theta": np.ascontiguousarray(theta.T, dtype=float),
            "end": np.empty((self.S, size)),
            "interior": np.empty((K - 1, self.S, size)),
        }

    def _sensitivities(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, wanted: Wanted | None = None
    ) -> dict[str, np.ndarray]:
        run = self._states(lanes, start, theta) | {"pull": lanes.spread(pull)}
        rows, columns = self.S, self.S + self.P
        if wanted is not None:
            run["states"], run["columns"] = (np.ascontiguousarray(a, dtype=np.int64) for a in wanted)
            rows, columns = map(len, wanted)
        return run | {"ends": np.empty((lanes.M, rows, columns)), "slope": np.empty((lanes.M, columns))}

    def repeated(self, lanes: Lanes, theta: np.ndarray, wanted: Wanted) -> Steps:
        """``linearise`` of the same ``lanes`` of one step again and again, where setting up its arrays takes longer.

        theta: coefficients (1, all), of the same shape each time; wanted: as of ``linearise``. What is called takes
        start states (S, M) and coefficients (1, all), and what is written into ``lanes.controls``; it returns end
        states (S, M) and their sensitivities (M, rows, columns).
        """
        run = self._sensitivities(lanes, np.zeros((self.S, lanes.M)), theta, np.zeros((0, self.S, lanes.M)), wanted)
        request = self._request(lanes, run)

        def again(start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            # into the arrays whose addresses the struct holds
            run["start"][...], run["theta"][...] = start[:, lanes.interval], theta.T
            self._call("linearise", request)
            return run["end"][:, lanes.position], run["ends"].copy()

        return again

    def _call(self, name: str, request: tuple[_IntervalRun, object]) -> None:
        if getattr(self.library, name)(ctypes.byref(request[0])):  # the C code returns 1 where malloc gives nothing
            raise MemoryError("no memory for the sensitivities of a block of intervals")

    def _request(
        self, lanes: Lanes, arrays: dict[str, np.ndarray], middle: bool = False
    ) -> tuple[_IntervalRun, dict[str, np.ndarray]]:
        """The struct of a call, and the arrays that it points to: they must live as long as it."""
        by_lane = {"controls": lanes.controls, "count": lanes.steps, "group": lanes.group, "slot": lanes.slot}
        every = by_lane | {"h": np.array([lanes.h]), "interval": lanes.interval} | arrays
        tall, wide, extra = (len(arrays.get(name, ())) for name in ("states", "columns", "own"))
        sizes = (len(lanes.interval), len(lanes.controls), arrays["theta"].shape[1], extra)
        run = _IntervalRun(*sizes, middle, lanes.changes, tall, wide)
        for name, array in every.items():
            setattr(run, name, array.ctypes.data)
        return run, every


def _without_repetition(function: ca.Function) -> ca.Function:
    """The SXFunction ``function`` with no expression twice; late, as it takes longer than to find compiled code."""
    given = function.sx_in()
    return ca.Function(function.name(), given, function.call(given), {"cse": True})

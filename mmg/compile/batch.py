"""Evaluation of CasADi functions at many points: compiled where a C compiler is found, interpreted elsewhere; and whole
trajectories of many points, the right-hand side fused with its Runge-Kutta loop, no Python between.

In C inputs and outputs are arrays of shape (rows, points), points contiguous; an input of shape (rows,) is shared by
all points. An output holds the nonzeros of a sparse result, in CasADi's order. The instructions of a trajectory's rates
(q, c, theta) are sorted by what they depend on: those of the coefficients alone run once per trajectory, those of the
inputs once per step (or per node), the rest in every stage.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import casadi as ca
import numpy as np

from mmg.compile.cache import LONG, UNIT, LateSource, load_library
from mmg.compile.codegen import HIDDEN, LANES, Program, c_file, divided_code, prelude, staged_bodies, units_of
from mmg.runge_kutta import NODES, PARTS, rk4_step

_SHARED = ("-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-w")
# -ftree-vectorize makes vectors of the loops over lanes (square roots). Without contraction a product and a sum are
# rounded one by one whatever stands beside them, so equal expressions give equal bits; its cost is not measurable.
FLAGS: tuple[str, ...] = ("-O1", "-ftree-vectorize", "-ffp-contract=off", *_SHARED)
# Of loops over matrices that are written by hand, the filter's and the elimination's.
LOOP_FLAGS = ("-O2", "-ftree-vectorize", "-ffp-contract=fast", *_SHARED)

# Largest difference by another order of sums, over the largest number of its kind. Set by hand, far above rounding.
CLOSE = 1e-7
ROUNDING = float(np.finfo(float).eps)  # A difference of results that cancel, of arguments of the order of 1
MORE = 8  # So many times the points are drawn where some have no finite value. Set by hand.


@dataclass
class BatchFunction:
    """A CasADi function over many points.

    Call it with one array per input, shape (rows, points) or, shared by all points, (rows,); a matrix input is
    given by the nonzeros it has as a column-major vector. It returns one array (nonzeros, points) per output.
    ``points`` must be a multiple of LANES (``padded`` gives the next one).
    """

    function: ca.Function
    library: ctypes.CDLL | None
    _mapped: dict = field(default_factory=dict, repr=False)

    def __call__(self, *inputs: np.ndarray) -> list[np.ndarray]:
        points = max((a.shape[1] for a in inputs if a.ndim == 2), default=LANES)
        return self._compiled(points, inputs) if self.library else self._interpreted(points, inputs)

    def at(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """All outputs, (nonzeros, m) each, at any number m >= 1 of points: inputs (rows, m), or (rows,) for all."""
        m = next(a.shape[1] for a in inputs if a.ndim == 2)
        outputs = self(*[filled(a, padded(m)) if a.ndim == 2 else a for a in inputs])
        return [a[:, :m] for a in outputs]

    def _compiled(self, points: int, inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        if points % LANES:
            raise ValueError(f"{points} points is not a multiple of {LANES}")
        f = self.function
        arrays = [np.ascontiguousarray(a, dtype=float) for a in inputs]  # named: they must outlive the call
        results = [np.empty((f.nnz_out(j), points)) for j in range(f.n_out())]
        arg = (ctypes.c_void_p * len(arrays))(*[a.ctypes.data for a in arrays])
        ld = (ctypes.c_longlong * len(arrays))(*[points if a.ndim == 2 else 0 for a in arrays])  # 0: for all points
        res = (ctypes.c_void_p * len(results))(*[a.ctypes.data for a in results])
        getattr(self.library, f.name())(ctypes.c_longlong(points), arg, ld, res)
        return results

    def _interpreted(self, points: int, inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The same by CasADi's virtual machine, zero-copy buffers, one map over the points."""
        f = self.function
        shared = tuple(i for i, a in enumerate(inputs) if a.ndim == 1)  # not copied to every point
        if (points, shared) not in self._mapped:  # to make a map takes longer than to call it
            mapped = f.map(f.name(), "serial", points, list(shared), [])
            self._mapped[points, shared] = (mapped, *mapped.buffer())  # the buffer lives as long as its function
        _, buffer, trigger = self._mapped[points, shared]
        # CasADi has the numbers of a point side by side, C code those of a row
        arrays = [np.ascontiguousarray(a if a.ndim == 1 else a.T, dtype=float) for a in inputs]
        results = [np.zeros((points, f.nnz_out(j))) for j in range(f.n_out())]
        for i, a in enumerate(arrays):
            buffer.set_arg(i, a.reshape(-1).data)
        for j, a in enumerate(results):
            buffer.set_res(j, a.reshape(-1).data)
        trigger()
        return [np.ascontiguousarray(a.T) for a in results]


def padded(points: int) -> int:
    """Number of points in whole vectors: ``points`` rounded up to a multiple of LANES, at least LANES."""
    return max(LANES, -(-points // LANES) * LANES)  # -(-a // b): rounded up


def filled(array: np.ndarray, points: int) -> np.ndarray:
    """``array`` (..., m) with its last point repeated, (..., points); as it is where it has them."""
    missing = points - array.shape[-1]
    return np.concatenate([array, np.repeat(array[..., -1:], missing, axis=-1)], axis=-1) if missing > 0 else array


def batch_functions(
    functions: Sequence[ca.Function], compiled: bool = True, what: str = "equations"
) -> tuple[list[BatchFunction], str]:
    """Batch versions of SXFunctions, compiled into one cached library if possible.

    Returns them with a sentence on why they run interpreted, or "" when compiled.
    functions: with distinct names; compiled: False interprets; what: they are, for people.
    """
    library, reason = None, "compilation switched off"
    if compiled:
        # late: to write the source takes longer than to find the library that was made of it
        text = LateSource.of(functions, partial(source, functions))
        library, reason = load_library(text, FLAGS, partial(_faults, functions), what)
    return [BatchFunction(f, library) for f in functions], reason


def points(rows: int, count: int, seed: int) -> np.ndarray:
    """Arguments (rows, count) of a test, where nothing is singular, the same for the same ``seed``."""
    return np.random.default_rng(seed).uniform(0.2, 1.0, (rows, count))  # away from rest, of the order of 1


def finite_points(function: ca.Function, count: int, seed: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Arguments of a ``function`` at ``count`` points, (rows, count) each, the same for the same ``seed``, and its
    results there without compiled code; of more points those at which it is finite, where there are any."""
    for drawn in (count, MORE * count):
        inputs = [points(function.nnz_in(j), drawn, seed + j) for j in range(function.n_in())]
        results = BatchFunction(function, None)(*inputs)
        if (good := finite_at(results)).all():  # most functions need no more points
            break
    chosen = np.resize(np.flatnonzero(good) if good.any() else np.arange(drawn), count)
    return [a[:, chosen] for a in inputs], [a[:, chosen] for a in results]


def finite_at(results: Sequence[np.ndarray]) -> np.ndarray:
    """At which points (M,) all numbers of the ``results`` (nnz, M) are finite."""
    return np.all([np.isfinite(a).all(axis=0) for a in results], axis=0)


def differences(results: Sequence[np.ndarray], expected: Sequence[np.ndarray], close: float = CLOSE) -> str:
    """What tells the arrays ``results`` (...,) each from the ``expected`` (...,), "" for nothing but rounding.

    Compared are the finite numbers of ``expected``, each with a difference of at most ``close`` times the largest one
    of its array (what follows from no number is not the same everywhere).
    """
    for a, b in zip(results, expected, strict=True):
        finite = np.isfinite(b)
        away, largest = np.abs(a[finite] - b[finite]), float(np.abs(b[finite]).max(initial=0.0))
        if not (away <= close * largest + ROUNDING).all():  # not >: nan in the compiled result is a difference
            most = float(np.where(np.isfinite(away), away, np.inf).max())
            return f"by {most:.2g}, where the largest number is {largest:.2g}"
    return ""


def _faults(functions: Sequence[ca.Function], library: ctypes.CDLL) -> str:
    """Which of these ``functions`` a new ``library`` gets wrong, "" for none."""
    for number, f in enumerate(functions):
        inputs, expected = finite_points(f, LANES, 100 * number)  # 100: other points for each, and for its inputs
        if differences(BatchFunction(f, library)(*inputs), expected):
            return f"{f.name()} differs from that of the portable path"
    return ""


# Parts of a function that are compiled as code that loops go through often; of more parts are second derivatives.
SHORT = 2  # set by hand: speed alone
# An argument has a list of its elements that are used, which ends with -1: of a hundred coefficients often few are.
_MACROS = """
#define EACH(i, name) for (long long e = 0, k; (k = name##_of##i[e]) >= 0; e++)
#define READ(i, name) EACH(i, name) x##i[k] = load(arg[i] + k * ld[i] + at);
#define SHARED(i, name) EACH(i, name) x##i[k] = fill(arg[i][k]);
#define WRITE(j, size, from) for (long long k = 0; k < size; k++) store(res[j] + k * points + at, d[from + k]);
"""


def kernel(function: ca.Function) -> tuple[str, list[str]]:
    """C source of ``void NAME(long points, const double** arg, const long* ld, double** res)``, and of the functions of
    its own that it calls.

    ``points`` is a multiple of LANES. ``arg[i]`` has row stride ``ld[i]``, or is shared when ``ld[i]`` is 0;
    every result has row stride ``points``. A null ``res[j]`` is skipped. The function must be an SXFunction.
    """
    sizes = [function.nnz_in(i) for i in range(function.n_in())]
    out_sizes = [function.nnz_out(j) for j in range(function.n_out())]
    outputs = range(len(out_sizes))
    program = Program.of(function, [1] * len(sizes))  # one stage: each point has arguments of its own
    code = divided_code(function.name(), program, outputs, {i: f"x{i}" for i in range(len(sizes))}, {})
    used = {program.values[place].argument for place in program.needed(outputs)}
    lists = [", ".join(str(k) for k in [*range(size), -1] if k < 0 or (i, k) in used) for i, size in enumerate(sizes)]
    tables = "".join(f"static const short {function.name()}_of{i}[] = {{{each}}};\n" for i, each in enumerate(lists))
    arrays = "; ".join(f"V x{i}[{size + 1}]" for i, size in enumerate(sizes))
    shared = " ".join(f"if (!ld[{i}]) SHARED({i}, {function.name()})" for i in range(len(sizes)))
    reads = " ".join(f"if (ld[{i}]) READ({i}, {function.name()})" for i in range(len(sizes)))
    writes = " ".join(f"if (res[{j}]) WRITE({j}, {size}, {sum(out_sizes[:j])})" for j, size in enumerate(out_sizes))
    text = f"""{code.declared}{tables}
EXPORT void {function.name()}(long long points, const double* const* arg, const long long* ld, double* const* res) {{
  {arrays}; V d[{sum(out_sizes) + 1}];
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
    kernels, parts = zip(*[kernel(f) for f in functions], strict=True)
    short, long = ([part for each in parts if (len(each) > SHORT) == far for part in each] for far in (False, True))
    first, *units = units_of(head, short) or [head]
    return UNIT.join([first + _MACROS + "".join(kernels), *units, *units_of(LONG + head, long)])


def _stages() -> str:
    """C statements of the second stage of a Runge-Kutta step to its end, with the numbers of the method."""
    lines = [
        f"EACH(s, @S@) y[s] = z[s] + {NODES[i]} * h * k{i}[s]; rates(y + @first@, c, p, K, H, k{i + 1});"
        for i in (1, 2, 3)
    ]
    total = " + ".join(f"{float(part)} * k{i + 1}[s]" for i, part in enumerate(PARTS))
    return "\n        ".join([*lines, f"EACH(s, @S@) z[s] = z[s] + h / {float(sum(PARTS))} * ({total});"])


def rollout_source(rates: ca.Function, first: int) -> str:
    """C file with ``void rollout(const Run*)``.

    rates: SXFunction (q (S - first,), inputs (C,), coefficients (P,)) -> dense d state / dt (S,).
    """
    program = Program.of(rates, (3, 2, 1))  # the states change in every stage, the coefficients never
    bodies = staged_bodies(program, [0], {0: "q", 1: "c", 2: "p"}, {1: "K", 2: "H"}, "d")
    names = ("shared", "inputs", "rates")
    parts: dict[str, str | int] = {name: bodies[i].text for i, name in enumerate(names, 1)}
    parts |= {"K": bodies[1].handed, "H": bodies[2].handed, "first": first}
    parts |= {"S": rates.size1_out(0), "C": rates.size1_in(1), "P": rates.size1_in(2)}
    return prelude() + c_file(__file__, "rollout.c", stages=_stages(), **parts)


class _RolloutRun(ctypes.Structure):
    """The struct Run of the C code, field by field in its order."""

    _fields_ = (
        [(name, ctypes.c_longlong) for name in ("points", "steps", "euler")]
        + [(name, ctypes.c_void_p) for name in ("start", "controls", "dt", "theta", "keep", "out")]
        + [
            (name, ctypes.c_longlong)
            for name in ("c_step", "c_row", "c_point", "dt_step", "dt_point", "theta_row", "theta_point")
        ]
    )


@dataclass(frozen=True)
class Rollout:
    """A compiled rollout for blocks of LANES points."""

    library: ctypes.CDLL

    def __call__(
        self,
        start: np.ndarray,
        controls: np.ndarray,
        dt: np.ndarray,
        theta: np.ndarray,
        keep: np.ndarray,
        euler: bool,
    ) -> np.ndarray:
        """States (1 + kept, S, M) from start (S, M), M >= LANES; see ``Simulator.run`` for the other arguments.

        dt: (), (N,) or (N, M); keep: (N,) bool.
        """
        S, M = start.shape
        N, C = len(keep), controls.shape[1]
        by_point, dt_step = controls.ndim == 3, (0, 1, M)[dt.ndim]  # strides: one for all, by step, by step and point
        start, controls, dt, theta = (np.ascontiguousarray(a, dtype=float) for a in (start, controls, dt, theta))
        keep = np.ascontiguousarray(keep, dtype=np.uint8)
        out = np.empty((1 + int(keep.sum()), S, M))
        run = _RolloutRun(
            M, N, euler,
            *(a.ctypes.data for a in (start, controls, dt, theta, keep, out)),
            C * M if by_point else C, M if by_point else 1, by_point,
            dt_step, dt.ndim == 2,
            M if theta.ndim == 2 else 1, theta.ndim == 2,
        )  # fmt: skip
        self.library.rollout(ctypes.byref(run))
        return out


def compile_rollout(rates: ca.Function, first: int, what: str = "equations") -> Rollout | None:
    """The rollout of these rates, compiled or from the cache; None where that is not possible. first: as for
    ``rollout_source``; what: they are, for people."""
    text = LateSource.of([rates], partial(rollout_source, rates, first), f"rollout from {first}")
    library, _ = load_library(text, FLAGS, lambda new: _rollout_faults(Rollout(new), rates, first), what)
    return None if library is None else Rollout(library)


def _rollout_faults(rollout: Rollout, rates: ca.Function, first: int) -> str:
    """What is wrong with two steps of a new ``rollout`` by its ``rates``, which do not see the ``first`` states; "" for
    nothing."""
    h, M = 1e-3, LANES
    (q, c, theta), _ = finite_points(rates, M, 1)
    start, controls = np.vstack([points(first, M, 0), q]), np.array([c, 0.9 * c])
    machine, z, expected = BatchFunction(rates, None), start, [start]
    for inputs in controls:
        z = rk4_step(lambda at, _, c=inputs: machine(at[first:], c, theta)[0], z, h)  # type: ignore[misc]
        expected.append(z)
    run = rollout(start, controls, np.array(h), theta, np.ones(2, dtype=bool), euler=False)
    steps, run_steps = (
        list(np.diff(z, axis=0)) for z in (np.array(expected), run)
    )  # changes: states would hide errors
    return "a run differs from that of the portable path" if differences(run_steps, steps) else ""

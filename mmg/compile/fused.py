"""C code that integrates whole trajectories: the right-hand side fused with its Runge-Kutta loop, no Python between.

The instructions of the rates (q, c, theta) are sorted by what they depend on: those of the coefficients alone run once
per trajectory, those of the inputs once per step (or per node), the rest in every stage. The same source serves
vectors of LANES points and single points (``lanes`` 1).
"""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mmg.compile.batch import FLAGS as BATCH_FLAGS
from mmg.compile.cache import load_library
from mmg.compile.codegen import constant, expression, prelude
from mmg.compile.kernel_threads import even_shares, in_threads, kernel_threads
from mmg.compile.self_test import alike, by_virtual_machine, points
from mmg.runge_kutta import NODES, PARTS, rk4_step

FLAGS = (*BATCH_FLAGS, "-O2")
"""-O2 makes single points a fifth faster than -O1; it doubles the compile time of Hessians, which have none of it."""

_CONSTANT, _COEFFICIENTS, _INPUTS, _STATE = range(4)
_LEVEL_OF_ARGUMENT = (_STATE, _INPUTS, _COEFFICIENTS)


def _sorted_instructions(rates: ca.Function) -> dict[str, str | int]:
    """C statements by level: what one level hands to the next ones is in arrays K and H, constants are written where
    they are used."""
    slots: dict[int, str] = {}
    results: dict[int, str] = {}
    level: dict[str, int] = {}
    text_of: dict[str, str] = {}
    uses: dict[str, list[str]] = {}
    for k in range(rates.n_instructions()):
        operation = rates.instruction_id(k)
        inputs, outputs = rates.instruction_input(k), rates.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            results[outputs[1]] = slots[inputs[0]]
            continue
        name = f"a{k}"
        uses[name] = []
        if operation == ca.OP_CONST:
            level[name], text_of[name] = _CONSTANT, f"fill({constant(rates.instruction_constant(k))})"
        elif operation == ca.OP_INPUT:
            level[name], text_of[name] = _LEVEL_OF_ARGUMENT[inputs[0]], f"{'qcp'[inputs[0]]}[{inputs[1]}]"
        else:
            uses[name] = [slots[i] for i in inputs]
            level[name] = max(level[i] for i in uses[name])
            text_of[name] = expression(operation, uses[name])
        slots[outputs[0]] = name
    level["d"], uses["d"] = _STATE, list(results.values())
    crossing = {other for name, used in uses.items() for other in used if level[other] < level[name]}
    place: dict[str, str] = {}
    parts: dict[str, str | int] = {}
    for where, key, array in ((_COEFFICIENTS, "shared", "K"), (_INPUTS, "inputs", "H"), (_STATE, "rates", "d")):
        body, known = [], set()
        for name in (name for name in uses if level[name] == where):
            for other in uses[name]:
                if level[other] != where and other not in known:
                    known.add(other)
                    body.append(f"const V {other} = {place.get(other) or text_of[other]};")
            if name in text_of:
                body.append(f"const V {name} = {text_of[name]};")
        handed = [name for name in text_of if level[name] == where and name in crossing]
        place |= {name: f"{array}[{i}]" for i, name in enumerate(handed)}
        body += [f"{place[name]} = {name};" for name in handed]
        body += [f"d[{row}] = {name};" for row, name in sorted(results.items()) if where == _STATE]
        parts |= {key: "\n  ".join(body), array: len(handed)}
    return parts


_LOOP = """
typedef struct {
  long long points, steps, linear, euler;
  const double *start, *controls, *dt, *theta;
  const unsigned char* keep;
  double* out;
  long long c_step, c_row, c_point, dt_step, dt_point, theta_row, theta_point;
} Run;
#define AT(p, each) ((each) ? load((p) + i) : fill(*(p)))
static void shared(const V* p, V* K) {
  @shared@
}
static void inputs(const V* c, const V* K, V* H) {
  @inputs@
}
static void rates(const V* q, const V* K, const V* H, V* d) {
  @rates@
}
static void read_controls(const Run* r, long long step, long long i, V* c) {
  for (int j = 0; j < @C@; j++) c[j] = AT(r->controls + step * r->c_step + j * r->c_row, r->c_point);
}
EXPORT void rollout(const Run* r, long long begin, long long end) {
  V p[@P@ + 1], K[@K@ + 1], held[3][@H@ + 1], c[@C@ + 1], next[@C@ + 1], mean[@C@ + 1];
  V z[@S@], y[@S@], k1[@S@], k2[@S@], k3[@S@], k4[@S@];
  for (long long at = begin; at < end; at += LANES) {
    const long long i = at + LANES <= end ? at : end - LANES;
    double* out = r->out + i;
    V *H0 = held[0], *Hm = held[0], *H1 = held[0];
    for (int j = 0; j < @P@; j++) p[j] = AT(r->theta + j * r->theta_row, r->theta_point);
    shared(p, K);
    for (int s = 0; s < @S@; s++, out += r->points) { z[s] = load(r->start + s * r->points + i); store(out, z[s]); }
    if (r->linear) { Hm = held[1]; H1 = held[2]; read_controls(r, 0, i, c); inputs(c, K, H0); }
    for (long long step = 0; step < r->steps; step++) {
      const V h = AT(r->dt + step * r->dt_step, r->dt_point);
      if (r->linear) {
        read_controls(r, step + 1, i, next);
        for (int j = 0; j < @C@; j++) { mean[j] = 0.5 * (c[j] + next[j]); c[j] = next[j]; }
        inputs(mean, K, Hm);
        inputs(next, K, H1);
      } else {
        read_controls(r, step, i, c);
        inputs(c, K, H0);
      }
      rates(z + @first@, K, H0, k1);
      if (r->euler) {
        for (int s = 0; s < @S@; s++) z[s] = z[s] + h * k1[s];
      } else {
        @stages@
      }
      if (r->linear) { V* spare = H0; H0 = H1; H1 = spare; }
      if (r->keep[step]) for (int s = 0; s < @S@; s++, out += r->points) store(out, z[s]);
    }
  }
}
"""
"""The integration loop; H0, Hm, H1: what the inputs give at the beginning, middle and end of a step. A block that
would end beyond ``end`` is moved back: the points it repeats come out the same."""


_EACH = "for (int s = 0; s < @S@; s++)"
_INPUTS_AT = {0.5: "Hm", 1.0: "H1"}


def _stages() -> str:
    """C statements of the second stage of a Runge-Kutta step to its end, with the numbers of the method."""
    lines = [
        f"{_EACH} y[s] = z[s] + {NODES[i]} * h * k{i}[s]; rates(y + @first@, K, {_INPUTS_AT[NODES[i]]}, k{i + 1});"
        for i in (1, 2, 3)
    ]
    total = " + ".join(f"{float(part)} * k{i + 1}[s]" for i, part in enumerate(PARTS))
    return "\n        ".join([*lines, f"{_EACH} z[s] = z[s] + h / {float(sum(PARTS))} * ({total});"])


def rollout_source(rates: ca.Function, first: int, lanes: int) -> str:
    """C file with ``void rollout(const Run*, long long begin, long long end)`` for points begin .. end.

    rates: SXFunction (q (S - first,), inputs (C,), coefficients (P,)) -> dense d state / dt (S,).
    lanes: points per vector.
    """
    parts = _sorted_instructions(rates)
    parts |= {"S": rates.size1_out(0), "C": rates.size1_in(1), "P": rates.size1_in(2), "first": first}
    text = _LOOP.replace("@stages@", _stages())
    for key, value in parts.items():
        text = text.replace(f"@{key}@", str(value))
    return prelude(lanes) + text


class _RunArguments(ctypes.Structure):
    """The struct Run of the C code."""

    _fields_ = (
        [(name, ctypes.c_longlong) for name in ("points", "steps", "linear", "euler")]
        + [(name, ctypes.c_void_p) for name in ("start", "controls", "dt", "theta", "keep", "out")]
        + [
            (name, ctypes.c_longlong)
            for name in ("c_step", "c_row", "c_point", "dt_step", "dt_point", "theta_row", "theta_point")
        ]
    )


@dataclass(frozen=True)
class Rollout:
    """A compiled rollout for blocks of ``lanes`` points."""

    library: ctypes.CDLL
    lanes: int

    def __call__(
        self,
        start: np.ndarray,
        controls: np.ndarray,
        dt: np.ndarray,
        theta: np.ndarray,
        keep: np.ndarray,
        euler: bool,
        linear: bool,
        threads: int | None,
    ) -> np.ndarray:
        """States (1 + kept, S, M) from start (S, M), M >= lanes; see ``Simulator.run`` for the other arguments.

        dt: (), (N,) or (N, M); keep: (N,) bool.
        """
        S, M = start.shape
        N, C = len(keep), controls.shape[1]
        own, dt_step = controls.ndim == 3, (0, 1, M)[dt.ndim]
        start, controls, dt, theta = (np.ascontiguousarray(a, dtype=float) for a in (start, controls, dt, theta))
        keep = np.ascontiguousarray(keep, dtype=np.uint8)
        out = np.empty((1 + int(keep.sum()), S, M))
        run = _RunArguments(
            M, N, linear, euler,
            *(a.ctypes.data for a in (start, controls, dt, theta, keep, out)),
            C * M if own else C, M if own else 1, own,
            dt_step, dt.ndim == 2,
            M if theta.ndim == 2 else 1, theta.ndim == 2,
        )  # fmt: skip
        threads = min(threads or kernel_threads(), os.cpu_count() or 1)
        blocks = M // self.lanes

        def work(begin: int, end: int) -> int:  # whole blocks for each thread, what is left for the last one
            last = M if end == blocks else end * self.lanes
            self.library.rollout(ctypes.byref(run), ctypes.c_longlong(begin * self.lanes), ctypes.c_longlong(last))
            return 0

        in_threads(work, even_shares(blocks, threads), threads)
        return out


def compile_rollout(rates: ca.Function, first: int, lanes: int) -> Rollout | None:
    """The rollout of these rates, compiled or from the cache; None where that is not possible. first, lanes: as for
    ``rollout_source``."""
    try:
        text = rollout_source(rates, first, lanes)
    except NotImplementedError:
        return None
    library, _ = load_library(text, FLAGS, lambda new: _faults(Rollout(new, lanes), rates, first))
    return None if library is None else Rollout(library, lanes)


def _faults(rollout: Rollout, rates: ca.Function, first: int) -> str:
    """What is wrong with two steps of a new ``rollout`` by its ``rates``, which do not see the ``first`` states; "" for
    nothing."""
    S, h, M = rates.size1_out(0), 1e-3, rollout.lanes
    start, theta = points(S, M, 1), points(rates.size1_in(2), M, 2)
    controls = np.repeat(points(rates.size1_in(1), 2, 3).T[:, :, None], M, axis=2)
    z, expected = start, [start]
    for held in controls:
        z = rk4_step(lambda at, _, held=held: by_virtual_machine(rates, [at[first:], held, theta])[0], z, h)  # type: ignore[misc]
        expected.append(z)
    dt, keep = np.array(h), np.ones(2, dtype=bool)
    found = rollout(start, controls, dt, theta, keep, euler=False, linear=False, threads=1)
    steps = zip(np.diff(found, axis=0), np.diff(np.array(expected), axis=0), strict=True)
    return "" if all(alike(a, b) for a, b in steps) else "a run differs from that of the portable path"

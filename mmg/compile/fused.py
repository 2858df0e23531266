"""C code that integrates whole trajectories: the right-hand side fused with its Runge-Kutta loop, no Python between.

The instructions of the rates (q, c, theta) are sorted by what they depend on: those of the coefficients alone run once
per trajectory, those of the inputs once per step (or per node), the rest in every stage.
"""

from __future__ import annotations

import ctypes
import sys
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from mmg import runge_kutta
from mmg.compile.batch import FLAGS, GENERATORS, BatchFunction, differences, finite_points, points
from mmg.compile.cache import LateSource, load_library
from mmg.compile.codegen import LANES, Program, c_file, prelude, staged_bodies
from mmg.runge_kutta import NODES, PARTS, rk4_step


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


class _RunArguments(ctypes.Structure):
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
        run = _RunArguments(
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
    made_by = (*GENERATORS, runge_kutta, sys.modules[__name__])
    text = LateSource.of([rates], partial(rollout_source, rates, first), *made_by, kind=f"rollout from {first}")
    library, _ = load_library(text, FLAGS, lambda new: _faults(Rollout(new), rates, first), what)
    return None if library is None else Rollout(library)


def _faults(rollout: Rollout, rates: ca.Function, first: int) -> str:
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

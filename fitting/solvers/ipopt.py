"""A nonlinear program with hand-assembled derivatives, solved by IPOPT through CasADi."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from fitting.nlp.problem import Problem
from fitting.solvers.interrupts import INTERRUPTED, interrupts_noted, unbroken
from mmg.progress import OnProgress, Progress


@dataclass(frozen=True)
class Guess:
    """Where another method ended: x (n,), multipliers of the defects (m,), and bound (P,) of the coefficients' bounds,
    positive at upper ones."""

    x: np.ndarray
    multipliers: np.ndarray
    bound: np.ndarray


@dataclass
class Solution:
    """Where IPOPT ended, or another method that leads it.

    converged: ``Solve_Succeeded``. x: the optimum, or the best iterate when it stopped early. status: IPOPT's own
    word; advice: a sentence for a user. history: objective and constraint violation per iteration.
    """

    x: np.ndarray
    objective: float
    violation: float
    status: str
    converged: bool
    iterations: int
    seconds: float
    advice: str = ""
    history: list[tuple[float, float]] = field(default_factory=list)


ADVICE = {
    "Solve_Succeeded": "",
    "Solved_To_Acceptable_Level": "only IPOPT's looser acceptable tolerance was met; check noise levels and priors",
    "Maximum_Iterations_Exceeded": "the iteration limit was reached; raise --max-iterations or continue with --resume",
    "Maximum_WallTime_Exceeded": "the time limit was reached; raise --time-limit or continue with --resume",
    "Maximum_CpuTime_Exceeded": "the time limit was reached; raise --time-limit or continue with --resume",
    "User_Requested_Stop": "stopped by the user; continue with --resume",
    "Restoration_Failed": "IPOPT could not reduce the constraint violation; try shorter windows (--window)",
    "Infeasible_Problem_Detected": "no trajectory joins the nodes; check units and signs of the trials with mmg check",
    "Invalid_Number_Detected": "the model gave a number that is not finite; check units and signs with mmg check",
    "Diverging_Iterates": "the iterates diverge; check units and signs of the trials with mmg check",
}


ROUGH = {
    "ipopt.acceptable_tol": 1e8,
    "ipopt.acceptable_dual_inf_tol": 1e8,
    "ipopt.acceptable_constr_viol_tol": 1e-2,
    "ipopt.acceptable_compl_inf_tol": 1.0,
    "ipopt.acceptable_iter": 2,
    "ipopt.acceptable_obj_change_tol": 3e-4,
}
"""IPOPT options for a solve of which only the noise level is wanted.

An iterate that is nearly feasible is accepted once the objective has twice changed by less than 3e-4 relative.
"""


CERTIFY = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-9,
    "ipopt.warm_start_bound_push": 1e-9,
    "ipopt.warm_start_bound_frac": 1e-9,
    "ipopt.warm_start_mult_bound_push": 1e-9,
}
"""IPOPT options for a start that is nearly optimal, with its multipliers."""


class _Buffered(ca.Callback):
    """A CasADi callback that reads and writes numpy views of CasADi's own memory."""

    def __init__(
        self, name: str, inputs: list[ca.Sparsity], outputs: list[ca.Sparsity], work: Callable[..., list[Any]]
    ) -> None:
        ca.Callback.__init__(self)
        self._in, self._out, self._work = inputs, outputs, work
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._in)

    def get_n_out(self) -> int:
        return len(self._out)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._in[i]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._out[i]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: Any, res: Any) -> int:
        views = [np.empty(0) if a is None else np.frombuffer(a, dtype=float) for a in arg]
        for target, value in zip(res, self._work(*views), strict=True):
            if target is not None:
                np.frombuffer(target, dtype=float)[:] = value
        return 0


class _Watch:
    """Keeps the best iterate, calls ``progress`` at each one, and stops after Ctrl-C."""

    def __init__(self, progress: OnProgress | None, task: str) -> None:
        self.progress, self.task = progress, task
        self.best: tuple[float, float, np.ndarray] | None = None
        self.history: list[tuple[float, float]] = []

    def __call__(self, **at: np.ndarray) -> list[float]:
        f, violation = float(at["f"][0]), float(np.abs(at["g"]).max(initial=0.0))
        self.history.append((f, violation))
        rank = (0.0, f) if violation <= 1e-3 else (violation, f)
        if self.best is None or rank <= self.best[:2]:
            self.best = (*rank, at["x"].copy())
        if self.progress:
            values = {"objective": f, "violation": violation}
            self.progress(Progress(self.task, len(self.history) - 1, values=values))
        return [float(INTERRUPTED.requested)]


def _functions(program: Problem, watch: _Watch) -> tuple[Any, dict[str, Any]]:
    """CasADi function x -> (objective, defects), and by the name of their option the derivatives and the ``watch``."""
    n, m = program.n, program.m
    column, row, scalar = ca.Sparsity.dense(n, 1), ca.Sparsity.dense(1, n), ca.Sparsity.dense(1, 1)
    empty, constraint = ca.Sparsity(0, 0), ca.Sparsity.dense(m, 1)
    (jacobian, _), (hessian, _) = program.patterns
    fg = _Buffered("fg", [column], [scalar, constraint], lambda x: [program.objective(x), program.defects(x)])
    gf = _Buffered("gf", [column, empty], [scalar, row], lambda x, _: [program.objective(x), program.gradient(x)])
    jg = _Buffered(
        "jg", [column, empty], [constraint, jacobian], lambda x, _: [program.defects(x), program.jacobian(x)]
    )
    hl = _Buffered(
        "hl",
        [column, empty, scalar, constraint],
        [hessian],
        lambda x, _, factor, multipliers: [program.hessian(x, float(factor[0]), multipliers)],
    )
    outputs = [ca.nlpsol_out(i) for i in range(ca.nlpsol_n_out())]
    sizes = {"f": scalar, "x": column, "lam_x": column, "g": constraint, "lam_g": constraint}
    seen = [sizes.get(name, empty) for name in outputs]
    watched = _Buffered("watch", seen, [scalar], lambda *values: watch(**dict(zip(outputs, values, strict=True))))
    return fg, {"grad_f": gf, "jac_g": jg, "hess_lag": hl, "iteration_callback": watched}


def solve(
    program: Problem,
    x0: np.ndarray | Guess,
    tolerance: float = 1e-6,
    max_iterations: int = 300,
    time_limit: float | None = None,
    progress: OnProgress | None = None,
    task: str = "solve",
    options: Mapping[str, Any] | None = None,
) -> Solution:
    """Solve ``program`` from ``x0`` (n,), or a ``Guess``. Never raises for a failure of the solver: the solution says
    so.

    tolerance, max_iterations, time_limit [s]: of IPOPT; progress: called at every iterate, under the name ``task``,
    with the objective and the constraint violation; options: further ones of IPOPT, such as ROUGH. Ctrl-C (in the main
    thread) stops at the next iterate and returns the best one (``interrupts_noted``).
    """
    watch = _Watch(progress, task)
    fg, functions = _functions(program, watch)
    x = ca.MX.sym("x", program.n)
    f, g = fg(x)
    settings: dict[str, Any] = {
        **functions,
        "no_nlp_grad": True,
        "calc_lam_p": False,
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": tolerance,
        "ipopt.max_iter": max_iterations,
        "ipopt.mu_init": 1e-2,
        "ipopt.linear_solver": "mumps",
        "ipopt.mumps_pivot_order": 6,
    }
    if time_limit is not None:
        settings["ipopt.max_wall_time"] = max(time_limit, 1e-3)
    first: dict[str, Any] = {"x0": x0}
    if isinstance(x0, Guess):
        settings.update(CERTIFY)
        bound = np.concatenate([np.zeros(program.S * program.B), x0.bound])
        first = {"x0": x0.x, "lam_g0": x0.multipliers, "lam_x0": bound}
    settings.update(options or {})
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": f, "g": g}, settings)
    lower, upper = program.bounds()
    began = time.perf_counter()
    with interrupts_noted(), unbroken():
        out = solver(lbx=lower, ubx=upper, lbg=0.0, ubg=0.0, **first)
    stats = solver.stats()
    status = str(stats["return_status"])
    converged = status == "Solve_Succeeded"
    end = np.array(out["x"]).ravel() if converged or watch.best is None else watch.best[2]
    x_end = np.clip(end, lower, upper)
    return Solution(
        x=x_end,
        objective=program.objective(x_end),
        violation=float(np.abs(program.defects(x_end)).max()),
        status=status,
        converged=converged,
        iterations=int(stats["iter_count"]),
        seconds=time.perf_counter() - began,
        advice=ADVICE.get(status, "IPOPT stopped early" if not converged else ""),
        history=watch.history,
    )

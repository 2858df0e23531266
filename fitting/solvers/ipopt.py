"""A nonlinear program with hand-assembled derivatives, solved by IPOPT through CasADi."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import casadi as ca
import numpy as np

from fitting.solvers.interrupts import INTERRUPTED, Interrupts
from mmg.progress import OnProgress, Progress


class NonlinearProgram(Protocol):
    """What IPOPT needs: sizes, patterns, bounds, values and exact derivatives at x."""

    n: int
    m: int
    jacobian_sparsity: ca.Sparsity
    hessian_sparsity: ca.Sparsity

    def objective(self, x: np.ndarray) -> float: ...
    def defects(self, x: np.ndarray) -> np.ndarray: ...
    def gradient(self, x: np.ndarray) -> np.ndarray: ...
    def jacobian(self, x: np.ndarray) -> np.ndarray: ...
    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray: ...
    def bounds(self) -> tuple[np.ndarray, np.ndarray]: ...


@dataclass
class Solution:
    """Where IPOPT ended.

    converged: ``Solve_Succeeded``. x: the optimum, or the best iterate when it stopped early. status: IPOPT's own
    word; advice: a sentence for a user. history: objective and constraint violation per iteration.
    """

    x: np.ndarray
    multipliers: np.ndarray
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
    "Restoration_Failed": "IPOPT could not reduce the constraint violation; try tighter priors or shorter windows",
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


class _Buffered(ca.Callback):
    """A CasADi callback that reads and writes numpy views of CasADi's own memory."""

    def __init__(
        self,
        name: str,
        inputs: list[ca.Sparsity],
        outputs: list[ca.Sparsity],
        work: Callable[[list[np.ndarray]], list[Any]],
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
        for target, value in zip(res, self._work(views), strict=True):
            if target is not None:
                np.frombuffer(target, dtype=float)[:] = value
        return 0


class _Watch(ca.Callback):
    """Keeps the best iterate, calls ``progress`` at each one, and stops after Ctrl-C."""

    def __init__(self, n: int, m: int, progress: OnProgress | None, task: str) -> None:
        ca.Callback.__init__(self)
        self.n_x, self.m_g, self.progress, self.task = n, m, progress, task
        self.best: tuple[float, float, np.ndarray, np.ndarray] | None = None
        self.last_error: BaseException | None = None
        self.history: list[tuple[float, float]] = []
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:
        return "ret"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        sizes = {"f": 1, "x": self.n_x, "lam_x": self.n_x, "g": self.m_g, "lam_g": self.m_g}
        return ca.Sparsity.dense(sizes[name], 1) if (name := ca.nlpsol_out(i)) in sizes else ca.Sparsity(0, 0)

    def eval(self, arg: Any) -> Any:
        named = {ca.nlpsol_out(i): a for i, a in enumerate(arg)}
        f, g = float(named["f"]), np.array(named["g"]).ravel()
        violation = float(np.abs(g).max()) if g.size else 0.0
        self.history.append((f, violation))
        rank = (0.0, f) if violation <= 1e-3 else (violation, f)
        if self.best is None or rank <= self.best[:2]:
            self.best = (*rank, np.array(named["x"]).ravel(), np.array(named["lam_g"]).ravel())
        if self.progress:
            values = {"objective": f, "violation": violation}
            self.progress(Progress(self.task, len(self.history) - 1, values=values))
        return [1 if INTERRUPTED.requested else 0]


def _functions(program: NonlinearProgram) -> tuple[Any, dict[str, Any]]:
    """CasADi function x -> (objective, defects), and the derivative functions by the name of their option."""
    n, m = program.n, program.m
    column, row, scalar = ca.Sparsity.dense(n, 1), ca.Sparsity.dense(1, n), ca.Sparsity.dense(1, 1)
    empty, constraint = ca.Sparsity(0, 0), ca.Sparsity.dense(m, 1)
    fg = _Buffered("fg", [column], [scalar, constraint], lambda a: [program.objective(a[0]), program.defects(a[0])])
    gf = _Buffered("gf", [column, empty], [scalar, row], lambda a: [program.objective(a[0]), program.gradient(a[0])])
    jg = _Buffered(
        "jg",
        [column, empty],
        [constraint, program.jacobian_sparsity],
        lambda a: [program.defects(a[0]), program.jacobian(a[0])],
    )
    hl = _Buffered(
        "hl",
        [column, empty, scalar, constraint],
        [program.hessian_sparsity],
        lambda a: [program.hessian(a[0], float(a[2][0]), a[3])],
    )
    return fg, {"grad_f": gf, "jac_g": jg, "hess_lag": hl}


def solve(
    program: NonlinearProgram,
    x0: np.ndarray,
    tolerance: float = 1e-6,
    max_iterations: int = 300,
    time_limit: float | None = None,
    progress: OnProgress | None = None,
    task: str = "solve",
    options: Mapping[str, Any] | None = None,
) -> Solution:
    """Solve ``program`` from ``x0`` (n,). Never raises for a failure of the solver: the solution says so.

    tolerance, max_iterations, time_limit [s]: of IPOPT; progress: called at every iterate, under the name ``task``,
    with the objective and the constraint violation; options: further ones of IPOPT, such as ROUGH. Ctrl-C (in the main
    thread) stops at the next iterate and returns the best one (``Interrupts``).
    """
    fg, derivatives = _functions(program)
    watch = _Watch(program.n, program.m, progress, task)
    x = ca.MX.sym("x", program.n)
    f, g = fg(x)
    settings: dict[str, Any] = {
        **derivatives,
        "no_nlp_grad": True,
        "calc_lam_p": False,
        "iteration_callback": watch,
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
    settings.update(options or {})
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": f, "g": g}, settings)
    lower, upper = program.bounds()
    began = time.perf_counter()
    with Interrupts():
        out = solver(lbx=lower, ubx=upper, lbg=0.0, ubg=0.0, x0=x0)
    stats = solver.stats()
    status = str(stats["return_status"])
    converged = status == "Solve_Succeeded"
    x_end, lam = np.array(out["x"]).ravel(), np.array(out["lam_g"]).ravel()
    if not converged and watch.best is not None:
        x_end, lam = watch.best[2], watch.best[3]
    x_end = np.clip(x_end, lower, upper)
    return Solution(
        x=x_end,
        multipliers=lam,
        objective=program.objective(x_end),
        violation=float(np.abs(program.defects(x_end)).max()),
        status=status,
        converged=converged,
        iterations=int(stats["iter_count"]),
        seconds=time.perf_counter() - began,
        advice=ADVICE.get(status, "IPOPT stopped early" if not converged else ""),
        history=watch.history,
    )

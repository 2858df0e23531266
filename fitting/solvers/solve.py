"""One solve of a calibration: condensed steps lead (``condensing``), IPOPT finishes and certifies what they find.

Then restarts with damping where it is stuck, and several starts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Any

import casadi as ca
import numpy as np

from fitting.nlp.problem import Problem
from fitting.parallel import run_all, width
from fitting.settings import Settings, Start
from fitting.solvers.condensing import Lead, lead, polished
from fitting.solvers.control import INTERRUPTED, Control, interrupts_noted, unbroken, unless_interrupted
from mmg.messages import Message


@dataclass
class Solution:
    """Where IPOPT ended, or another method that leads it.

    converged: ``Solve_Succeeded``. x: the optimum, or the best iterate when it stopped early. status: IPOPT's own
    word; advice: a sentence for a user.
    """

    x: np.ndarray
    objective: float
    violation: float
    status: str
    converged: bool
    iterations: int
    seconds: float
    advice: str = ""

    @classmethod
    def at(cls, problem: Problem, x: np.ndarray, status: str, seconds: float = 0.0, **more: Any) -> Solution:
        """That of ``problem`` at x (n,), which took ``seconds``; status, more: the other fields."""
        more = {"iterations": 0, "converged": False} | more
        violation = float(np.abs(problem.defects(x)).max())
        return cls(x, problem.objective(x), violation, status, seconds=seconds, **more)


# What a status of IPOPT asks of a user.
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

# IPOPT options for a solve of which only the noise level is wanted: an iterate that is nearly feasible is accepted once
# the objective has twice changed by less than 3e-4 relative. Set by hand.
ROUGH = {
    "ipopt.acceptable_tol": 1e8,  # never decides, nor does the next one
    "ipopt.acceptable_dual_inf_tol": 1e8,
    "ipopt.acceptable_constr_viol_tol": 1e-2,  # FEASIBLE, in scaled states
    "ipopt.acceptable_compl_inf_tol": 1.0,
    "ipopt.acceptable_iter": 2,
    "ipopt.acceptable_obj_change_tol": 3e-4,  # ROUGH_CHANGE
}
# IPOPT options for a start that is nearly optimal, with its multipliers: a barrier and pushes from the bounds as large
# as usual would lead away from it first.
CERTIFY = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-9,  # NEAR is reached, so that the barrier need not fall any more
    "ipopt.warm_start_bound_push": 1e-9,
    "ipopt.warm_start_bound_frac": 1e-9,
    "ipopt.warm_start_mult_bound_push": 1e-9,
}


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
                np.frombuffer(target, dtype=float)[:] = value  # in CasADi's own memory
        return 0


class _Watch:
    """Keeps the best iterate, tells the ``control`` of each one, and stops after Ctrl-C."""

    def __init__(self, control: Control) -> None:
        self.control = control
        self.best: tuple[float, float, np.ndarray] | None = None
        self.number = 0

    def __call__(self, **at: np.ndarray) -> list[float]:
        f, violation = float(at["f"][0]), float(np.abs(at["g"]).max(initial=0.0))
        # feasible iterates by objective, others by how far they are off
        rank = (0.0, f) if violation <= 1e-3 else (violation, f)
        if self.best is None or rank <= self.best[:2]:
            self.best = (*rank, at["x"].copy())
        self.control.tell(self.number, objective=f, violation=violation)
        self.number += 1
        return [float(INTERRUPTED.requested)]  # anything but 0 stops IPOPT


def _functions(program: Problem, watch: _Watch) -> tuple[Any, dict[str, Any]]:
    """CasADi function x -> (objective, defects), and by the name of their option the derivatives and the ``watch``."""
    n, m = program.n, program.m
    column, row, scalar = ca.Sparsity.dense(n, 1), ca.Sparsity.dense(1, n), ca.Sparsity.dense(1, 1)
    empty, constraint = ca.Sparsity(0, 0), ca.Sparsity.dense(m, 1)
    (jacobian, _), (hessian, _) = program.patterns
    fg = _Buffered("fg", [column], [scalar, constraint], lambda x: [program.objective(x), program.defects(x)])
    both = [column, empty]  # x and the parameters of nlpsol, of which there are none
    gf = _Buffered("gf", both, [scalar, row], lambda x, _: [program.objective(x), program.gradient(x)])
    jg = _Buffered("jg", both, [constraint, jacobian], lambda x, _: [program.defects(x), program.jacobian(x)])
    hl = _Buffered("hl", [*both, scalar, constraint], [hessian],
                   lambda x, _, factor, multipliers: [program.hessian(x, float(factor[0]), multipliers)])  # fmt: skip
    outputs = [ca.nlpsol_out(i) for i in range(ca.nlpsol_n_out())]
    sizes = {"f": scalar, "x": column, "lam_x": column, "g": constraint, "lam_g": constraint}
    seen = [sizes.get(name, empty) for name in outputs]
    watched = _Buffered("watch", seen, [scalar], lambda *values: watch(**dict(zip(outputs, values, strict=True))))
    return fg, {"grad_f": gf, "jac_g": jg, "hess_lag": hl, "iteration_callback": watched}


def by_ipopt(
    program: Problem,
    x0: np.ndarray | Lead,
    control: Control | None = None,
    tolerance: float = 1e-6,
    rough: bool = False,
) -> Solution:
    """Solve ``program`` by IPOPT alone from ``x0`` (n,), or where condensed steps have led. Never raises for a failure
    of the solver: the solution says so.

    control: its limits are IPOPT's, and it is told of every iterate, with the objective and the constraint violation;
    tolerance: of IPOPT; rough: by ROUGH. Ctrl-C (in the main thread) stops at the next iterate. Returns the best.
    """
    control = control or Control()
    watch = _Watch(control)
    fg, functions = _functions(program, watch)
    x = ca.MX.sym("x", program.n)
    f, g = fg(x)
    settings: dict[str, Any] = {
        **functions,
        "no_nlp_grad": True,  # fg has no derivatives of its own
        "calc_lam_p": False,
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",  # no banner
        "ipopt.tol": tolerance,
        "ipopt.max_iter": control.iterations,
        "ipopt.mu_init": 1e-2,  # a tenth of IPOPT's own. Set by hand
        "ipopt.linear_solver": "mumps",
        "ipopt.mumps_pivot_order": 6,  # approximate minimum degree with quasi-dense rows: p borders on all nodes
    }
    if np.isfinite(control.end):
        settings["ipopt.max_wall_time"] = max(control.left, 1e-3)  # IPOPT takes no limit of zero
    first: dict[str, Any] = {"x0": x0}
    if isinstance(x0, Lead):
        settings.update(CERTIFY)
        bound = np.concatenate([np.zeros(program.S * program.B), x0.bound])  # nodes have no bounds
        first = {"x0": x0.x, "lam_g0": x0.multipliers, "lam_x0": bound}
    settings.update(ROUGH if rough else {})  # last: it may take back what certifies
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": f, "g": g}, settings)
    lower, upper = program.bounds()
    began = time.perf_counter()
    with interrupts_noted(), unbroken():
        out = solver(lbx=lower, ubx=upper, lbg=0.0, ubg=0.0, **first)
    stats = solver.stats()
    status = str(stats["return_status"])
    converged = status == "Solve_Succeeded"
    # the last iterate may be a bad one
    end = np.array(out["x"]).ravel() if converged or watch.best is None else watch.best[2]
    x_end = np.clip(end, lower, upper)  # IPOPT relaxes bounds by 1e-8
    advice, seconds = ADVICE.get(status, "IPOPT stopped early" if not converged else ""), time.perf_counter() - began
    more = {"converged": converged, "iterations": int(stats["iter_count"]), "advice": advice}
    return Solution.at(program, x_end, status, seconds, **more)


STEPS = 30  # Steps of the leading method before IPOPT is left alone. Set by hand: IPOPT decides in any case.
# Relative change of the objective, predicted, or gained by each of two steps, at which a rough solve ends: it is made
# for the sizes of noise alone. Set by hand, as is that of IPOPT in ROUGH.
ROUGH_CHANGE = 3e-4
FEASIBLE = 1e-2  # Largest violation [scaled states] with which a rough solve may end. Set by hand.
NEAR = 1e-7  # Predicted relative change at which IPOPT takes over. Set by hand: IPOPT certifies what it finds.


def solve(
    problem: Problem, x: np.ndarray, control: Control | None = None, tolerance: float = 1e-6, rough: bool = False
) -> Solution:
    """Where IPOPT ends for ``problem`` from where the condensing method and one exact step led from x (n,).

    control, tolerance: as of ``by_ipopt``. A rough solve ends with the condensing method. Where that does not come to
    its end, IPOPT begins at x as if it had not been; after Ctrl-C, where it came to.
    """
    began, control = time.perf_counter(), control or Control()
    half = time.time() + 0.5 * control.left  # the other half is for IPOPT, where the steps lead nowhere
    number = count()

    def at_iterate(objective: float, violation: float) -> bool:
        control.tell(next(number), objective=objective, violation=violation)
        return control.stops or time.time() > half

    with interrupts_noted():
        change, gain, feasible = (ROUGH_CHANGE, ROUGH_CHANGE, FEASIBLE) if rough else (NEAR, 0.0, np.inf)
        led = lead(problem, x, change, min(STEPS, control.iterations), at_iterate, gain, feasible)
        if led.reached and rough:
            seconds = time.perf_counter() - began
            return Solution.at(problem, led.x, "Solved_To_Acceptable_Level", seconds, iterations=len(led.history))
        # IPOPT then stops at once
        start: np.ndarray | Lead = led.x if INTERRUPTED.requested and len(led.history) > 1 else x
        if led.reached:
            start = polished(problem, led)
        last = by_ipopt(problem, start, control, tolerance, rough)
    before = len(led.history) if led.reached else 0  # steps that led nowhere are left out
    return replace(last, iterations=last.iterations + before, seconds=time.perf_counter() - began)


# Status of a solve after which a damped restart is tried; limits and Ctrl-C are not among them.
STUCK = {
    "Restoration_Failed",
    "Infeasible_Problem_Detected",
    "Invalid_Number_Detected",
    "Diverging_Iterates",
    "Error_In_Step_Computation",
    "Search_Direction_Becomes_Too_Small",
    "Not_Enough_Degrees_Of_Freedom",
}
# Prior standard deviations by which the coefficients may change in each solve of a damped restart. Set by hand.
RADII = (0.3, 1.0, 3.0)


def same_optimum(objective: float, best: float) -> bool:
    """Whether a solve ended, by its ``objective``, at the ``best`` optimum found, up to the solver's tolerance."""
    return objective <= best * (1 + 1e-5) + 1e-6  # ten tolerances, as of Settings; set by hand


def solve_damped(problem: Problem, p: np.ndarray, control: Control, tolerance: float) -> Solution:
    """Solution of ``problem`` from coefficients p (P,), released in steps, with nodes on the measurements.

    Each rough solve holds them within RADII prior standard deviations of where they came to; the last one is free.
    control, tolerance: as of ``solve``.
    """
    iterations, x = 0, problem.start(p)
    (lower, upper), mean, std = problem.p_bounds(), problem.prior.mean, problem.prior.std
    for radius in RADII:
        p = np.clip(p, lower, upper)
        low, high = np.maximum(lower, p - radius), np.minimum(upper, p + radius)
        held = problem.with_bounds(mean + std * low, mean + std * high)
        part = solve(held, x, control.of(f"damped restart, {radius:g}"), tolerance, rough=True)
        iterations += part.iterations
        if not np.isfinite(part.objective) or part.status == "User_Requested_Stop":
            break
        x, p = part.x, problem.split(part.x)[1]
    last = solve(problem, x, control.of("damped restart"), tolerance)
    return replace(last, iterations=last.iterations + iterations)


def _solve_one(problem: Problem, control: Control, tolerance: float, damped: bool, p: np.ndarray) -> Solution:
    if damped:
        return solve_damped(problem, p, control, tolerance)
    return solve(problem, problem.start(p), control.of("another start"), tolerance)


def _solve_all(
    problem: Problem, settings: Settings, points: list[np.ndarray], damped: bool, control: Control
) -> list[Solution]:
    """Solutions from other starting points, in processes when there are several workers."""
    if width(settings.workers) > 1 and len(points) > 1:
        work = partial(_solve_one, problem, replace(control, progress=None), settings.tolerance, damped)
        spread = unless_interrupted(lambda: run_all(work, points, settings.workers, name="starts"))
        return spread or []  # they count as left out
    solutions: list[Solution] = []
    for p in points:
        if control.left <= 0:
            break
        solution = _solve_one(problem, control, settings.tolerance, damped, p)
        if solution.status == "User_Requested_Stop":
            break  # it counts as left out
        solutions.append(solution)
    return solutions


def solve_starts(
    problem: Problem, first: Solution, settings: Settings, control: Control
) -> tuple[Solution, list[Start]]:
    """Best solution of ``problem``, and all starts: the ``first`` solution and those from random points.

    settings: starts, seed, workers, tolerance; control: of all of them. Starts that got stuck, or ended in a worse
    optimum, are solved once more with damping from where they began.
    """
    solutions, points, again = [first], [np.zeros(problem.P)], set()
    if first.converged and settings.starts > 1:
        rng = np.random.default_rng(settings.seed)
        # 0.5 prior standard deviations: set by hand
        points += [rng.normal(scale=0.5, size=problem.P) for _ in range(1, settings.starts)]
        solutions += _solve_all(problem, settings, points[1:], False, control)  # the first is solved already
        lowest = min(s.objective for s in solutions if s.converged)
        retry = [
            i
            for i, s in enumerate(solutions)
            if s.status in STUCK or (s.converged and not same_optimum(s.objective, lowest))
        ]
        ends = _solve_all(problem, settings, [points[i] for i in retry], True, control)
        for i, s in zip(retry, ends, strict=False):  # a time limit leaves some unsolved
            again.add(i)
            # damping may end worse
            if s.converged and (not solutions[i].converged or s.objective < solutions[i].objective):
                solutions[i] = s
    converged = [s for s in solutions if s.converged] or solutions[:1]
    best = min(converged, key=lambda s: s.objective)
    starts = []
    for i, s in enumerate(solutions):
        difference = problem.split(s.x)[1] - problem.split(best.x)[1]
        # three names, and a tenth of a prior: display
        far = [j for j in np.argsort(-np.abs(difference))[:3] if abs(difference[j]) > 0.1]
        elsewhere = not same_optimum(s.objective, best.objective)
        apart = {problem.prior.symbols[j]: float(difference[j]) for j in far} if elsewhere else {}
        starts.append(Start(i, s.objective, s.converged, float(np.abs(difference).max()), i in again, apart))
    return best, starts


def disagreement(starts: Sequence[Start], best: float) -> list[Message]:
    """Messages on ``starts`` that ended elsewhere or nowhere: how far in objective and in which coefficients.

    best: the lowest objective.
    """
    messages, solved = [], [s for s in starts if s.converged]
    other = [s for s in solved if not same_optimum(s.objective, best)]
    if other:
        far, near = max(s.objective for s in other) - best, min(s.objective for s in other) - best
        gap = f"{near:.3g}" if len(other) == 1 else f"{near:.3g} to {far:.3g}"
        symbols = {symbol for s in other for symbol in s.apart}
        apart = {symbol: max(abs(s.apart.get(symbol, 0.0)) for s in other) for symbol in sorted(symbols)}
        listed = sorted(apart.items(), key=lambda item: -item[1])[:4]
        where = ", ".join(f"{symbol} by {value:.1f}" for symbol, value in listed) or "no coefficient by more than 0.1"
        words = (
            f"{len(other)} of {len(starts)} starts ended in another optimum, also after a damped restart: objective "
            f"{gap} above the best of {best:.6g}, furthest apart in {where} prior standard deviations; the lowest "
            "objective is kept: check it against other data"
        )
        messages.append(Message(words, "starts_disagree"))
    if 0 < len(solved) < len(starts):
        failed = len(starts) - len(solved)
        words = f"{failed} of {len(starts)} starts did not converge, also after a damped restart"
        messages.append(Message(words, "starts_failed"))
    return messages

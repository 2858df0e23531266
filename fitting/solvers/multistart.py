"""Several starts of the final solve, restarts with damping, and messages on starts that disagree."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fitting.nlp.problem import Problem
from fitting.parallel import run_all, width
from fitting.settings import Settings, Start
from fitting.solvers.interrupts import unless_interrupted
from fitting.solvers.ipopt import ROUGH, Solution, solve
from mmg.messages import Message
from mmg.progress import OnProgress

STUCK = {
    "Restoration_Failed",
    "Infeasible_Problem_Detected",
    "Invalid_Number_Detected",
    "Diverging_Iterates",
    "Error_In_Step_Computation",
    "Search_Direction_Becomes_Too_Small",
    "Not_Enough_Degrees_Of_Freedom",
}
"""Status of a solve after which a damped restart is tried; limits and Ctrl-C are not among them."""
RADII = (0.3, 1.0, 3.0)
"""Prior standard deviations by which the coefficients may change in each solve of a damped restart. Set by hand."""


def time_left(settings: Settings, began: float) -> float | None:
    """Seconds until the time limit of ``settings`` for a calibration that ``began`` then [s]; None without one."""
    return None if settings.time_limit is None else settings.time_limit - (time.perf_counter() - began)


def solve_in_time(
    problem: Problem,
    x: np.ndarray,
    settings: Settings,
    began: float,
    progress: OnProgress | None,
    task: str,
    options: Mapping[str, Any] | None = None,
    method: Callable[..., Solution] = solve,
) -> Solution:
    """Where ``method`` ends for ``problem`` from x (n,), by ``settings`` and in the time that they leave.

    began: when the calibration did (``time.perf_counter``) [s]; progress, task, options: as of ``ipopt.solve``; method:
    that, or ``leading.solve_led``.
    """
    left = time_left(settings, began)
    return method(problem, x, settings.tolerance, settings.max_iterations, left, progress, task, options)


def same_optimum(objective: float, best: float) -> bool:
    """Whether a solve ended, by its ``objective``, at the ``best`` optimum found, up to the solver's tolerance."""
    return objective <= best * (1 + 1e-5) + 1e-6


def solve_damped(
    problem: Problem, p: np.ndarray, settings: Settings, began: float, progress: OnProgress | None = None
) -> Solution:
    """Solution of ``problem`` from coefficients p (P,) with nodes on the measurements, the coefficients released in
    steps.

    Each rough solve holds them within RADII prior standard deviations of where they came to; the last one is free.
    settings, began, progress: as of ``solve_in_time``.
    """
    iterations, x = 0, problem.start(p)
    (lower, upper), mean, std = problem.p_bounds(), problem.prior.mean, problem.prior.std
    for radius in RADII:
        p = np.clip(p, lower, upper)
        low, high = np.maximum(lower, p - radius), np.minimum(upper, p + radius)
        held = problem.with_bounds(mean + std * low, mean + std * high)
        part = solve_in_time(held, x, settings, began, progress, f"damped restart, {radius:g}", ROUGH)
        iterations += part.iterations
        if not np.isfinite(part.objective) or part.status == "User_Requested_Stop":
            break
        x, p = part.x, problem.split(part.x)[1]
    last = solve_in_time(problem, x, settings, began, progress, "damped restart")
    return replace(last, iterations=last.iterations + iterations)


def _solve_one(
    problem: Problem,
    settings: Settings,
    damped: bool,
    p: np.ndarray,
    began: float | None = None,
    progress: OnProgress | None = None,
) -> Solution:
    began = time.perf_counter() if began is None else began
    if damped:
        return solve_damped(problem, p, settings, began, progress)
    return solve_in_time(problem, problem.start(p), settings, began, progress, "another start")


def _solve_all(
    problem: Problem,
    settings: Settings,
    points: list[np.ndarray],
    damped: bool,
    began: float,
    progress: OnProgress | None,
) -> list[Solution]:
    """Solutions from other starting points, in processes when there are several workers."""
    if width(settings.workers) > 1 and len(points) > 1:
        timed = replace(settings, time_limit=time_left(settings, began))
        work = partial(_solve_one, problem, timed, damped)
        spread = unless_interrupted(lambda: run_all(work, points, settings.workers, name="starts"))
        return spread or []  # they count as left out
    solutions: list[Solution] = []
    for p in points:
        if (left := time_left(settings, began)) is not None and left <= 0:
            break
        found = _solve_one(problem, settings, damped, p, began, progress)
        if found.status == "User_Requested_Stop":
            break  # it counts as left out
        solutions.append(found)
    return solutions


def solve_starts(
    problem: Problem, first: Solution, settings: Settings, began: float, progress: OnProgress | None
) -> tuple[Solution, list[Start]]:
    """Best solution of ``problem``, and all starts: the ``first`` solution and those from random points.

    settings, began, progress: as of ``solve_in_time``. Starts that got stuck, or ended in a worse optimum, are solved
    once more with damping from where they began.
    """
    solutions, points, again = [first], [np.zeros(problem.P)], set()
    if first.converged and settings.starts > 1:
        rng = np.random.default_rng(settings.seed)
        points += [rng.normal(scale=0.5, size=problem.P) for _ in range(1, settings.starts)]
        solutions += _solve_all(problem, settings, points[1:], False, began, progress)
        lowest = min(s.objective for s in solutions if s.converged)
        retry = [
            i
            for i, s in enumerate(solutions)
            if s.status in STUCK or (s.converged and not same_optimum(s.objective, lowest))
        ]
        ends = _solve_all(problem, settings, [points[i] for i in retry], True, began, progress)
        for i, s in zip(retry, ends, strict=False):  # a time limit leaves some unsolved
            again.add(i)
            if s.converged and (not solutions[i].converged or s.objective < solutions[i].objective):
                solutions[i] = s
    converged = [s for s in solutions if s.converged] or solutions[:1]
    best = min(converged, key=lambda s: s.objective)
    starts = []
    for i, s in enumerate(solutions):
        difference = problem.split(s.x)[1] - problem.split(best.x)[1]
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

"""The solves of a calibration: rough ones that estimate the noise, the final one, and further starts of it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fitting.execute import run_all
from fitting.ipopt import Solution, solve
from fitting.noise import Noise, estimate
from fitting.problem import Prior, Problem
from fitting.segments import Segments
from fitting.settings import Report, Settings, Start
from fitting.shooting import kernels
from mmg.model import assemble
from mmg.ship import Ship


def _left(settings: Settings, began: float) -> float | None:
    return None if settings.time_limit is None else settings.time_limit - (time.perf_counter() - began)


def _noise(problem: Problem, x: np.ndarray) -> Noise:
    return estimate(problem.segments, *problem.errors(x), floor=1e-6 * problem.scale[:6])


FEW_WINDOWS = 30
"""Windows of the first solve: enough to bring the coefficients near and to see the size of the residuals."""


def solve_passes(
    problem: Problem, x: np.ndarray, settings: Settings, began: float, report: Report | None
) -> tuple[Problem, Solution, Noise, list[dict]]:
    """Rough solves that estimate the noise, then one with that noise to full tolerance.

    The first rough solve sees at most FEW_WINDOWS windows, evenly spread; the estimate of each solve starts the next.
    """
    passes: list[dict] = []
    count = 1 if settings.sigma else max(1, settings.passes)
    full, p = problem, problem.split(x)[1]
    for number in range(count):
        rough = number < count - 1
        windows = len(full.segments.run)
        if rough and number == 0 and windows > 1.5 * FEW_WINDOWS:
            few = np.unique(np.linspace(0, windows - 1, FEW_WINDOWS).round().astype(int))
            segments = full.segments.subset(few)
            problem = Problem(full.ship, full.prior, full.kernels, segments, full.sigma)
            x = problem.start(p)
        else:
            problem = full
        name = f"pass {number + 1} of {count}"
        solution = solve(
            problem,
            x,
            settings.tolerance,
            settings.max_iterations,
            _left(settings, began),
            report=partial(report, name) if report else None,
            rough=rough,
        )
        noise = _noise(problem, solution.x)
        passes.append(
            {
                "objective": solution.objective,
                "status": solution.status,
                "iterations": solution.iterations,
                "seconds": solution.seconds,
                "windows": len(problem.segments.run),
                "sigma": problem.sigma.tolist(),
            }
        )
        p = problem.split(solution.x)[1]
        good = solution.converged or (rough and solution.status == "Solved_To_Acceptable_Level")
        if not good or not rough:
            break
        x = solution.x if problem is full else full.start(p)
        full = full.with_sigma(noise.sigma)
    if problem.segments is not full.segments:
        problem, solution = _whole(full, p, solution)
    return problem, solution, noise, passes


def _whole(full: Problem, p: np.ndarray, solution: Solution) -> tuple[Problem, Solution]:
    """A solution of a subset that stopped early, carried over to all windows with nodes on the measurements."""
    x = full.start(p)
    return full, replace(
        solution,
        x=x,
        multipliers=np.zeros(full.m),
        objective=full.objective(x),
        violation=float(np.abs(full.defects(x)).max()),
    )


@dataclass(frozen=True)
class StartTask:
    """One further start of the final solve, complete enough to be solved in another process."""

    ship: Ship
    prior: Prior
    segments: Segments
    sigma: np.ndarray
    p: np.ndarray
    settings: Settings
    time_limit: float | None


def solve_start(task: StartTask) -> Solution:
    """Solve one start; kernels are built anew (their compiled code is cached)."""
    free = np.array([task.ship.symbols.index(s) for s in task.prior.symbols])
    kernel = kernels(assemble(task.ship), free, task.settings.compiled)
    problem = Problem(task.ship, task.prior, kernel, task.segments, task.sigma)
    settings = task.settings
    return solve(problem, problem.start(task.p), settings.tolerance, settings.max_iterations, task.time_limit)


def _further(
    problem: Problem, settings: Settings, points: list[np.ndarray], began: float, report: Report | None
) -> list[Solution]:
    """Solutions from other starting points, in processes when there are several workers."""
    if settings.workers > 1 and len(points) > 1:
        left = _left(settings, began)
        tasks = [
            StartTask(problem.ship, problem.prior, problem.segments, problem.sigma, p, settings, left) for p in points
        ]
        return run_all(solve_start, tasks, settings.workers)
    solutions: list[Solution] = []
    for number, p in enumerate(points, start=2):
        left = _left(settings, began)
        if left is not None and left <= 0:
            break
        watch = partial(report, f"start {number}") if report else None
        solutions.append(
            solve(problem, problem.start(p), settings.tolerance, settings.max_iterations, left, report=watch)
        )
        if solutions[-1].status == "User_Requested_Stop":
            break
    return solutions


def solve_starts(
    problem: Problem, first: Solution, settings: Settings, began: float, report: Report | None
) -> tuple[Solution, list[Start]]:
    """Further random starts of the last problem; returns the best solution and the list of all starts."""
    solutions = [first]
    if first.converged and settings.starts > 1:
        rng = np.random.default_rng(settings.seed)
        points = [rng.normal(scale=0.5, size=problem.P) for _ in range(1, settings.starts)]
        solutions += _further(problem, settings, points, began, report)
    converged = [s for s in solutions if s.converged] or solutions[:1]
    best = min(converged, key=lambda s: s.objective)
    p = problem.split(best.x)[1]
    starts = [
        Start(i, s.objective, s.converged, float(np.abs(problem.split(s.x)[1] - p).max()))
        for i, s in enumerate(solutions)
    ]
    return best, starts

"""The solves of a calibration: rough ones that estimate the noise, the final one, and further starts of it."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np

from fitting.ipopt import Solution, solve
from fitting.noise import Noise, estimate
from fitting.problem import Problem
from fitting.settings import Report, Settings, Start


def _left(settings: Settings, began: float) -> float | None:
    return None if settings.time_limit is None else settings.time_limit - (time.perf_counter() - began)


def _noise(problem: Problem, x: np.ndarray) -> Noise:
    seg = problem.segments
    nodes, _, _, interior = problem._evaluate(x)
    floor = 1e-6 * problem.scale
    return estimate(seg, nodes - seg.nodes, interior - seg.targets, floor)


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


def solve_starts(
    problem: Problem, first: Solution, settings: Settings, began: float, report: Report | None
) -> tuple[Solution, list[Start]]:
    """Further random starts of the last problem; returns the best solution and the list of all starts."""
    solutions = [first]
    if first.converged:
        rng = np.random.default_rng(settings.seed)
        for number in range(1, settings.starts):
            left = _left(settings, began)
            if left is not None and left <= 0:
                break
            x0 = problem.start(rng.normal(scale=0.5, size=problem.P))
            name = f"start {number + 1}"
            solutions.append(
                solve(
                    problem,
                    x0,
                    settings.tolerance,
                    settings.max_iterations,
                    left,
                    report=partial(report, name) if report else None,
                )
            )
            if solutions[-1].status == "User_Requested_Stop":
                break
    converged = [s for s in solutions if s.converged] or solutions[:1]
    best = min(converged, key=lambda s: s.objective)
    p = problem.split(best.x)[1]
    starts = [
        Start(i, s.objective, s.converged, float(np.abs(problem.split(s.x)[1] - p).max()))
        for i, s in enumerate(solutions)
    ]
    return best, starts

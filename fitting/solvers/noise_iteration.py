"""The solves of a calibration: rough ones that estimate the noise, then the final one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.nlp.problem import Problem
from fitting.settings import Settings
from fitting.solvers.ipopt import ROUGH, Solution
from fitting.solvers.latent_forces import free_axes, typical_sizes, update_sizes
from fitting.solvers.multistart import STUCK, solve_damped, solve_in_time
from fitting.solvers.residual_noise import ResidualNoise, estimate_noise
from mmg.progress import OnProgress

FORCE_PASSES = 3
"""Further solves when sizes of latent forces are estimated, which settle more slowly than the noise."""
FEW_WINDOWS = 12
"""Windows of the first solve: enough to bring the coefficients near and to see the size of the residuals."""


def solve_with_noise_estimation(
    problem: Problem, x: np.ndarray, settings: Settings, began: float, progress: OnProgress | None
) -> tuple[Problem, Solution, ResidualNoise, list[dict]]:
    """Rough solves that estimate the noise and the sizes of latent forces, then one to full tolerance.

    problem, x (n,): where to start; settings, began [s], progress: as of ``multistart.solve_in_time``. The first rough
    solve has at most FEW_WINDOWS windows, evenly spread; the estimate of each solve starts the next. One that gets
    stuck is repeated with damping. With a robust loss the rough solves use Student's t, which gives gross outliers no
    weight. Returns the last problem, its solution, the noise of its residuals, and a row on each solve.
    """
    passes: list[dict] = []
    axes = free_axes(problem.ship)
    count = 1 if settings.sigma and not axes else max(1, settings.passes) + (FORCE_PASSES if axes else 0)
    full, p = problem, problem.split(x)[1]
    if axes:
        typical = typical_sizes(problem.ship)
        full = problem.with_changes(ship=problem.ship.with_values({f"disturbance.{a}": typical[a] for a in axes}))
    for number in range(count):
        rough = number < count - 1
        windows = len(full.segments.run)
        if rough and number == 0 and windows > 1.5 * FEW_WINDOWS:
            few = np.unique(np.linspace(0, windows - 1, FEW_WINDOWS).round().astype(int))
            problem = full.with_changes(segments=full.segments.subset(few))
            x = problem.start(p)
        else:
            problem = full
        if rough and problem.loss.robust:
            problem = problem.with_changes(loss=replace(problem.loss, name="student"))
        name = f"pass {number + 1} of {count}"
        solution = solve_in_time(problem, x, settings, began, progress, name, ROUGH if rough else None)
        restarted = solution.status in STUCK
        if restarted:
            solution = solve_damped(problem, p, settings, began, progress)
        noise = estimate_noise(
            problem.segments, *problem.errors(solution.x), floor=1e-6 * problem.scale[:6], robust=problem.loss.robust
        )
        passes.append(
            {
                "objective": solution.objective,
                "status": solution.status,
                "iterations": solution.iterations,
                "seconds": solution.seconds,
                "windows": len(problem.segments.run),
                "sigma": problem.sigma.tolist(),
                "restarted": restarted,
            }
        )
        p = problem.split(solution.x)[1]
        good = solution.converged or (rough and solution.status == "Solved_To_Acceptable_Level")
        if not good or not rough:
            break
        x = solution.x
        if axes:
            problem, x = update_sizes(problem, x, axes)
            full = full.with_changes(ship=problem.ship)
        x = x if problem.segments is full.segments else full.start(p)
        if not settings.sigma:
            full = full.with_sigma(noise.sigma, noise.tau)
    if problem.segments is not full.segments:  # stopped early: carried over with nodes on the measurements
        problem, x = full, full.start(p)
        violation = float(np.abs(full.defects(x)).max())
        solution = replace(solution, x=x, objective=full.objective(x), violation=violation)
    return problem.with_changes(loss=replace(problem.loss, name=full.loss.name)), solution, noise, passes

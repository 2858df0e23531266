"""Solves in turn, each with the noise that the residuals of the one before had, and how to go on with the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fitting.nlp.problem import Problem
from fitting.settings import Settings
from fitting.solvers.condensing import solve_led
from fitting.solvers.ipopt import ROUGH, Solution, solve
from fitting.solvers.multistart import STUCK, solve_damped, solve_in_time
from fitting.solvers.residual_noise import ResidualNoise, estimate_noise
from mmg.progress import OnProgress

NEVER = 1e300
"""A limit that is never wider."""
FEW_WINDOWS = 12
"""Windows of the first solve: they bring the coefficients near and show the size of residuals. Set by hand."""
TIMES = 3
"""Windows of a further solve over those of the one before, until all are there. Set by hand."""


@dataclass(frozen=True)
class Resumption:
    """Where the last of the solves in turn began, so that they can go on as if they had not been stopped.

    number, count: of that solve, and of all that there are to be, (1,) each; x, best: where it began and where it
    ended, (n,) of all windows; sigma, tau: noise that it assumed, (6,); limits: iterations and seconds (2,), those that
    stopped it, else 0; NEVER where it cannot end better from where it began.
    """

    number: np.ndarray
    count: np.ndarray
    x: np.ndarray
    best: np.ndarray
    sigma: np.ndarray
    tau: np.ndarray
    limits: np.ndarray

    @classmethod
    def of(
        cls,
        number: int,
        count: int,
        problem: Problem,
        x: np.ndarray,
        best: np.ndarray,
        status: str,
        settings: Settings,
    ) -> Resumption:
        """That of the solve ``number``, of ``count`` that there are to be, of the whole ``problem`` from x to best,
        (n,) each, which ended with ``status`` by ``settings``."""
        reached = {
            "Maximum_Iterations_Exceeded": (settings.max_iterations, 0.0),
            "Maximum_WallTime_Exceeded": (0.0, settings.time_limit or 0.0),
        }
        reached |= dict.fromkeys(("Solve_Succeeded", "User_Requested_Stop"), (0.0, 0.0))
        limits, noise = reached.get(status, (NEVER, NEVER)), (problem.sigma, problem.loss.tau)
        values = ([number], [count], x, best, *noise, limits)
        return cls(*(np.array(value, dtype=float) for value in values))

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray], problem: Problem) -> Resumption | None:
        """That in ``arrays``, as ``arrays`` gives them; None where they are not of this ``problem``."""
        n = (problem.n,)
        shapes = dict(zip(_NAMES, ((1,), (1,), n, n, (6,), (6,), (2,)), strict=True))
        found = {name: arrays.get(f"solve.{name}", np.zeros(int(name == "count"))) for name in _NAMES}
        return cls(**found) if all(found[name].shape == shape for name, shape in shapes.items()) else None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What ``of_arrays`` takes."""
        return {f"solve.{name}": getattr(self, name) for name in _NAMES}

    def restored(self, problem: Problem, settings: Settings) -> tuple[int, Problem, np.ndarray]:
        """The number of the solve, the whole ``problem`` as it had it, and where it begins (n,): as before, or at the
        best where the limits of ``settings`` would stop it there again."""
        wider = (settings.max_iterations, settings.time_limit or np.inf) > self.limits
        full = problem.with_sigma(self.sigma, self.tau)
        return int(self.number[0]), full, self.x if wider.all() else self.best


_NAMES = tuple(field.name for field in fields(Resumption))


def solve_row(problem: Problem, solution: Solution, restarted: bool = False) -> dict:
    """What is kept of the ``solution`` of a ``problem``; restarted: with damping."""
    return {
        "objective": solution.objective,
        "status": solution.status,
        "iterations": solution.iterations,
        "seconds": solution.seconds,
        "windows": len(problem.segments.run),
        "sigma": problem.sigma.tolist(),
        "restarted": restarted,
    }


@dataclass(frozen=True)
class NoiseSolves:
    """Solves in turn: the last ``problem`` and its ``solution``, the ``noise`` of its residuals, passes: a row on each
    solve, resumption: how to go on with the last one, draft: which was left out, the solution being where it begins."""

    problem: Problem
    solution: Solution
    noise: ResidualNoise
    passes: tuple[dict, ...]
    resumption: Resumption
    draft: bool = False


def noise_of(problem: Problem, solution: Solution) -> ResidualNoise:
    """The noise of the residuals of ``problem`` at its ``solution``."""
    floor = 1e-6 * problem.scale[:6]
    return estimate_noise(problem.segments, *problem.errors(solution.x), floor=floor, robust=problem.loss.robust)


def _sizes_of_rough(windows: int) -> list[int]:
    """Numbers of windows of the rough solves that come before those of all ``windows``."""
    sizes = [FEW_WINDOWS] if windows > 1.5 * FEW_WINDOWS else []
    while sizes and windows > 1.5 * TIMES * sizes[-1]:
        sizes.append(TIMES * sizes[-1])
    return sizes


def _without_last(
    problem: Problem, x: np.ndarray, number: int, passes: Sequence[dict], settings: Settings
) -> NoiseSolves:
    """Solves in turn, of which the last one, that of this ``number``, is left out: ``problem`` and x (n,) where it
    begins, ``passes`` and ``settings`` as there."""
    status, violation = "Solved_To_Acceptable_Level", float(np.abs(problem.defects(x)).max())
    start = Solution(x, problem.objective(x), violation, status, converged=False, iterations=0, seconds=0.0)
    last = Resumption.of(number, number + 1, problem, x, x, "User_Requested_Stop", settings)
    return NoiseSolves(problem, start, noise_of(problem, start), tuple(passes), last, draft=True)


def solve_with_noise_estimation(
    problem: Problem,
    x: np.ndarray,
    settings: Settings,
    began: float,
    progress: OnProgress | None,
    resumed: Resumption | None = None,
    near: bool = False,
    draft: bool = False,
) -> NoiseSolves:
    """Rough solves that estimate the noise, then one to full tolerance.

    problem, x (n,): where to start; settings, began [s], progress: as of ``multistart.solve_in_time``; resumed: the
    solve to go on with; near: they begin near a solution; draft: the last one is left out where a rough one of all
    windows came before it. The first rough solve has at most FEW_WINDOWS windows, evenly spread, unless x is near a
    solution, and others TIMES as many as the one before, until all are there; the estimate of each solve starts the
    next. IPOPT alone makes an only solve, as it begins far from any solution; the others are those of ``leading``. One
    that gets stuck is repeated with damping. With a robust loss the rough solves use Student's t, which gives gross
    outliers no weight. Returns the last solve, and what is kept of all.
    """
    passes: list[dict] = []
    count = 1 if settings.sigma else max(1, settings.passes)
    full, p = problem, problem.split(x)[1]
    number = 0
    if resumed:
        number, full, x = resumed.restored(full, settings)
        p, count, problem = full.split(x)[1], max(count, number + 1, int(resumed.count[0])), full
    sizes = _sizes_of_rough(len(full.segments.run)) if count > 1 and not near else []
    count += 0 if resumed else max(0, len(sizes) - 1)
    while number < count:
        rough, start = number < count - 1, x
        if draft and not rough and number > 0 and problem.segments is full.segments:
            return _without_last(full, x, number, passes, settings)
        if rough and number < len(sizes):
            few = np.linspace(0, len(full.segments.run) - 1, sizes[number]).round().astype(int)
            problem = full.with_changes(segments=full.segments.subset(few))
            x = problem.start(p)
        else:
            problem = full
        if rough and problem.loss.robust:
            problem = problem.with_changes(loss=replace(problem.loss, name="student"))
        name = f"pass {number + 1} of {count}"
        method = solve_led if rough or number or near else solve
        solution = solve_in_time(problem, x, settings, began, progress, name, ROUGH if rough else None, method)
        restarted = solution.status in STUCK
        if restarted:
            solution = solve_damped(problem, p, settings, began, progress)
        noise = noise_of(problem, solution)
        passes.append(solve_row(problem, solution, restarted))
        p = problem.split(solution.x)[1]
        end = solution.x if problem.segments is full.segments else full.start(p)
        last = Resumption.of(number, count, full, start, end, solution.status, settings)
        good = solution.converged or (rough and solution.status == "Solved_To_Acceptable_Level")
        if not good or not rough:
            break
        x = solution.x if problem.segments is full.segments else full.start(p)
        full = full.with_sigma(*noise.counted(settings.weight))
        number += 1
    if problem.segments is not full.segments:  # stopped early: carried over with nodes on the measurements
        problem, x = full, full.start(p)
        violation = float(np.abs(full.defects(x)).max())
        solution = replace(solution, x=x, objective=full.objective(x), violation=violation)
    problem = problem.with_changes(loss=replace(problem.loss, name=full.loss.name))
    return NoiseSolves(problem, solution, noise, tuple(passes), last)

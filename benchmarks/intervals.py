"""The shooting intervals of Train-TZRB by the compiled kernel and by the portable path: time of each evaluation.

Run from the repository root: python -m benchmarks.intervals
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable

import numpy as np

from benchmarks.record import record, table
from cases.io.read import read_trials
from cases.published_splits import TRAIN_TZRB, find
from cases.shipfiles.ship_file import load_ship
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import cut
from fitting.solvers.condensing.quadratic import gauss_newton, newton, solved

SIGMA = np.array([0.45, 0.45, 0.2, 0.026, 0.058, 0.0136])
EFFECTS: tuple[tuple[str, ...], ...] = ((), ("velocity_filter",), ("velocity_filter", "gyro"))


def milliseconds(problem: Problem, x: np.ndarray, work: Callable[[], object], runs: int = 7) -> float:
    """Least processor time of some ``work`` on a ``problem`` that has forgotten what it knows of x (n,)."""
    best = np.inf
    for _ in range(runs):
        problem.evaluate(x + 1.0)
        problem.slopes(x + 1.0)
        began = time.thread_time()
        work()
        best = min(best, time.thread_time() - began)
    return 1e3 * best


def evaluations(problem: Problem) -> dict[str, float]:
    """Milliseconds by the name of the evaluation, at one point of the ``problem``."""
    rng = np.random.default_rng(0)
    x, multipliers = problem.start(0.05 * rng.standard_normal(problem.P)), rng.standard_normal(problem.m)
    sub, p = newton(problem, x, multipliers), problem.split(x)[1]
    works: dict[str, Callable[[], object]] = {
        "objective": lambda: problem.objective(x),
        "sensitivities": lambda: problem.slopes(x),
        "quadratic of Gauss and Newton": lambda: gauss_newton(problem, x),
        "quadratic of Newton": lambda: newton(problem, x, multipliers),
        "its solution by condensing": lambda: solved(problem, sub, p),
    }
    return {name: milliseconds(problem, x, work) for name, work in works.items()}


def main() -> None:
    trials, rows = read_trials(find(TRAIN_TZRB)), []
    for effects in EFFECTS:
        ship = load_ship("esso_osaka_3m")
        for effect in effects:
            ship = ship.with_effect(effect)
        problems = {}
        with tempfile.TemporaryDirectory() as cold:
            before, os.environ["MMG_CACHE"] = os.environ.get("MMG_CACHE"), cold
            began = time.perf_counter()
            problems[True] = Problem.of(ship, Prior.of(ship), cut(trials, 1.0, 100.0, 5), SIGMA)
            seconds = time.perf_counter() - began
            os.environ.pop("MMG_CACHE")
            if before is not None:
                os.environ["MMG_CACHE"] = before
            problems[False] = Problem.of(ship, Prior.of(ship), problems[True].segments, SIGMA, compiled=False)
            kernel, portable = evaluations(problems[True]), evaluations(problems[False])
        name = f"{problems[True].S} states, {problems[True].P} coefficients; made and compiled in {seconds:.1f} s"
        rows += [[name, work, f"{kernel[work]:.1f}", f"{portable[work]:.1f}", f"{portable[work] / kernel[work]:.1f}"]
                 for work in kernel]  # fmt: skip
    lines = [
        "2,523 s of data in 520 intervals of five steps, one thread, least processor time of seven.",
        "",
        *table(["ship", "evaluation", "kernel [ms]", "portable [ms]", "ratio"], rows),
    ]
    record("Shooting intervals in one kernel", "python -m benchmarks.intervals", lines)


if __name__ == "__main__":
    main()

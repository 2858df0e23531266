"""The solves of a fit led by the condensing method against IPOPT alone, from the same points of the same problems.

Run from the repository root: python -m benchmarks.condensing [number of random starts, default 0]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import fitting.solvers.noise_iteration as solves
from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from fitting.nlp.fisher_information import information
from fitting.nlp.problem import Problem
from fitting.parallel import with_one_thread
from fitting.pipeline import FitOptions, calibrate
from fitting.solvers.ipopt import Solution, solve
from fitting.solvers.leading import solve_led
from fitting.uncertainty.sandwich import robust

HEADER = ["solve", "objective, led", "steps", "s", "objective, IPOPT alone", "iterations", "s",
          "relative difference", "largest difference of a coefficient [prior std]", "of the covariance"]  # fmt: skip


def compared(name: str, problem: Problem, led: Solution, alone: Solution) -> list[str]:
    """A row on the two solutions of a ``problem``; covariances relative to the standard errors."""
    ours, theirs = (robust(information(problem, s.x)).covariance for s in (led, alone))
    size = np.sqrt(np.diag(theirs))
    apart = np.abs(problem.split(led.x)[1] - problem.split(alone.x)[1]).max()
    return [
        name, f"{led.objective:.6f}", str(led.iterations), f"{led.seconds:.1f}",
        f"{alone.objective:.6f}", str(alone.iterations), f"{alone.seconds:.1f}",
        f"{led.objective / alone.objective - 1:.1e}", f"{apart:.1e}",
        f"{np.abs((ours - theirs) / np.outer(size, size)).max():.1e}",
    ]  # fmt: skip


def both(rows: list[list[str]], last: list[Problem]) -> Callable[..., Solution]:
    """What solves as a fit does and compares IPOPT alone with it: adds to ``rows``, and each problem to ``last``."""

    def solver(problem: Problem, x: np.ndarray, *rest: Any) -> Solution:
        led, alone = solve_led(problem, x, *rest), solve(problem, x, *rest)
        rows.append(compared(f"{rest[4]}, {len(problem.segments.run)} windows", problem, led, alone))
        last.append(problem)
        return led

    return solver


@with_one_thread
def main() -> None:
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    trials = read_trials(splits.find(list(splits.TRAIN_TZRB)))
    rows, problems = list[list[str]](), list[Problem]()
    solves.solve_led = both(rows, problems)
    calibrate(load_ship("esso_osaka_3m"), trials, options=FitOptions(next_trial=False))
    last, rng = next(p for p in reversed(problems) if p.columns.groups == 1), np.random.default_rng(0)
    for k in range(number + 1):
        p = rng.normal(scale=0.5, size=last.P) if k else np.zeros(last.P)
        for loss in ("gaussian", "student"):
            problem = last.with_changes(loss=replace(last.loss, name=loss))
            x = problem.start(p)
            led, alone = solve_led(problem, x, 1e-6, 300, None, None, "led"), solve(problem, x)
            rows.append(compared(f"{loss}, {f'random start {k}' if k else 'from the prior mean'}", problem, led, alone))
    record("Solves led by condensing", "python -m benchmarks.condensing", table(HEADER, rows))


if __name__ == "__main__":
    main()

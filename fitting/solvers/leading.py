"""A solve that the condensing method leads and IPOPT finishes and certifies, or makes alone."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fitting.nlp.problem import Problem
from fitting.solvers.condensing.sequence import Lead, lead
from fitting.solvers.interrupts import INTERRUPTED, interrupts_noted
from fitting.solvers.ipopt import ROUGH, Guess, Solution, solve
from mmg.progress import OnProgress, Progress

STEPS = 30
"""Steps of the leading method before IPOPT is left alone."""
ROUGH_CHANGE = 3e-4
"""Predicted relative change of the objective at which a rough solve ends."""
FEASIBLE = 1e-2
"""Largest violation with which a rough solve may end."""
NEAR = 1e-7
"""Predicted relative change at which IPOPT takes over."""


def solve_led(
    problem: Problem,
    x: np.ndarray,
    tolerance: float,
    max_iterations: int,
    time_limit: float | None,
    progress: OnProgress | None,
    task: str,
    options: Mapping[str, Any] | None = None,
) -> Solution:
    """Where ``ipopt.solve`` ends for ``problem`` from where the condensing method came from x (n,).

    tolerance, max_iterations, time_limit [s], progress, task, options: as of ``ipopt.solve``; options are of a solve
    that is not led.

    A rough solve (options are ROUGH) ends with that method. Where it does not come to its end, IPOPT begins at x as if
    it had not been; after Ctrl-C, where it came to.
    """
    began, rough = time.perf_counter(), options is ROUGH
    history: list[tuple[float, float]] = []

    def at_iterate(objective: float, violation: float) -> bool:
        history.append((objective, violation))
        if progress:
            values = {"objective": objective, "violation": violation}
            progress(Progress(task, len(history) - 1, values=values))
        late = time_limit is not None and time.perf_counter() - began > 0.5 * time_limit
        return bool(INTERRUPTED.requested) or late

    with interrupts_noted():
        found = lead(problem, x, ROUGH_CHANGE if rough else NEAR, min(STEPS, max_iterations), at_iterate)
        if found.reached and rough and float(np.abs(problem.defects(found.x)).max()) < FEASIBLE:
            return _rough(problem, found, time.perf_counter() - began)
        start: np.ndarray | Guess = x
        if found.reached and not rough:
            start = Guess(found.x, found.multipliers, found.bound)
        elif INTERRUPTED.requested and len(found.history) > 1:
            start = found.x
        left = None if time_limit is None else time_limit - (time.perf_counter() - began)
        more = None if isinstance(start, Guess) else options
        last = solve(problem, start, tolerance, max_iterations, left, progress, task, more)
    steps = len(found.history) if found.reached else 0
    whole = [*found.history, *last.history] if found.reached else last.history
    seconds = time.perf_counter() - began
    return replace(last, iterations=last.iterations + steps, seconds=seconds, history=whole)


def _rough(problem: Problem, found: Lead, seconds: float) -> Solution:
    """What a rough solve hands on."""
    return Solution(
        x=found.x,
        objective=problem.objective(found.x),
        violation=float(np.abs(problem.defects(found.x)).max()),
        status="Solved_To_Acceptable_Level",
        converged=False,
        iterations=len(found.history),
        seconds=seconds,
        history=found.history,
    )

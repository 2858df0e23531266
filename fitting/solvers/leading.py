"""A solve that the condensing method leads and IPOPT finishes and certifies, or makes alone."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fitting.nlp.problem import Problem
from fitting.solvers.condensing.sequence import Lead, lead, polished
from fitting.solvers.interrupts import INTERRUPTED, interrupts_noted
from fitting.solvers.ipopt import ROUGH, Guess, Solution, solve
from mmg.progress import OnProgress, Progress

STEPS = 30
"""Steps of the leading method before IPOPT is left alone."""
ROUGH_CHANGE = 3e-4
"""Predicted relative change of the objective at which a rough solve ends."""
ROUGH_GAIN = 3e-4
"""Relative gain below which two steps of a rough solve are its last ones: it is made for the sizes of noise alone."""
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
    """Where ``ipopt.solve`` ends for ``problem`` from where the condensing method and one exact step led from x (n,).

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
        change, gain, feasible = (ROUGH_CHANGE, ROUGH_GAIN, FEASIBLE) if rough else (NEAR, 0.0, np.inf)
        led = lead(problem, x, change, min(STEPS, max_iterations), at_iterate, gain, feasible)
        if led.reached and rough:
            return _ended(problem, led, time.perf_counter() - began)
        start: np.ndarray | Guess = led.x if INTERRUPTED.requested and len(led.history) > 1 else x
        if led.reached:
            led, options = polished(problem, led), None
            start = Guess(led.x, led.multipliers, led.bound)
        left = None if time_limit is None else time_limit - (time.perf_counter() - began)
        last = solve(problem, start, tolerance, max_iterations, left, progress, task, options)
    before, seconds = led.history if led.reached else [], time.perf_counter() - began
    return replace(last, iterations=last.iterations + len(before), seconds=seconds, history=[*before, *last.history])


def _ended(problem: Problem, led: Lead, seconds: float) -> Solution:
    """What the leading method hands on."""
    return Solution(
        x=led.x,
        objective=problem.objective(led.x),
        violation=float(np.abs(problem.defects(led.x)).max()),
        status="Solved_To_Acceptable_Level",
        converged=False,
        iterations=len(led.history),
        seconds=seconds,
        history=led.history,
    )

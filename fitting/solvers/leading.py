"""A solve that the condensing method leads and IPOPT finishes and certifies, or makes alone."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
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
ENOUGH = 1e-5
"""The same, or the gain of two steps, where it takes over later, perhaps from another solve that begins there."""
UNCERTIFIED: Mapping[str, Any] = MappingProxyType({})
"""Options of a solve whose end by the leading method is enough, until ``certified``."""


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

    A rough solve (options are ROUGH) ends with that method; so does one that is not to be certified yet (options are
    UNCERTIFIED), whose solution has a ``guess``. Where it does not come to its end, IPOPT begins at x as if it had not
    been; after Ctrl-C, where it came to.
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
        to_its_end = (ENOUGH, ENOUGH) if options is UNCERTIFIED else (NEAR, 0.0)
        change, gain = (ROUGH_CHANGE, ROUGH_GAIN) if rough else to_its_end
        feasible = FEASIBLE if rough else np.inf
        found = lead(problem, x, change, min(STEPS, max_iterations), at_iterate, gain, feasible)
        if found.reached and rough:
            return _ended(problem, found, time.perf_counter() - began)
        if found.reached and not rough:
            found = found if options is UNCERTIFIED else polished(problem, found)
            guess = Guess(found.x, found.multipliers, found.bound)
            led = replace(_ended(problem, found, time.perf_counter() - began), status="Near_Optimum", guess=guess)
            if options is UNCERTIFIED:
                return led
            return certified(problem, led, tolerance, max_iterations, time_limit, progress, task)
        start = found.x if INTERRUPTED.requested and len(found.history) > 1 else x
        left = None if time_limit is None else time_limit - (time.perf_counter() - began)
        last = solve(problem, start, tolerance, max_iterations, left, progress, task, options)
    return _joined(found.history if found.reached else [], last, time.perf_counter() - began)


def certified(
    problem: Problem,
    led: Solution,
    tolerance: float,
    max_iterations: int,
    time_limit: float | None,
    progress: OnProgress | None,
    task: str,
) -> Solution:
    """Where IPOPT ends for ``problem`` from the ``led`` solution, which has a ``guess``; iterations, seconds and
    history are of both.

    tolerance, max_iterations, progress, task: as of ``ipopt.solve``; time_limit [s]: of both.
    """
    start = led.x if led.guess is None else led.guess
    left = None if time_limit is None else time_limit - led.seconds
    last = solve(problem, start, tolerance, max_iterations, left, progress, task)
    return _joined(led.history, last, led.seconds + last.seconds)


def _joined(before: list[tuple[float, float]], last: Solution, seconds: float) -> Solution:
    """The ``last`` solution with the iterates of the leading method ``before`` it, which took ``seconds`` together."""
    return replace(last, iterations=last.iterations + len(before), seconds=seconds, history=[*before, *last.history])


def _ended(problem: Problem, found: Lead, seconds: float) -> Solution:
    """What the leading method hands on."""
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

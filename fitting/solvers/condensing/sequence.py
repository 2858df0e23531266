"""A sequence of quadratic subproblems from a starting point to the optimum, along trajectories that nearly join.

The Hessian of Gauss and Newton begins: it is never indefinite. Then the Hessian of the Lagrangian takes over, of which
only the first state of each window and the coefficients are left after the elimination: where these small blocks
are not positive, they are made so, and nothing is factorised twice. Every trial point is brought back to where the
intervals join (a second-order correction, which costs a simulation without sensitivities), so that the merit, the
objective and the violations under their multipliers, is little else than the objective.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.nlp.problem import Problem
from fitting.solvers.condensing.quadratic import Step, Subproblem, carried, gauss_newton, newton, solved

CUTS = 10
"""Halvings of a step before it counts as failed."""
CORRECTIONS = 3
"""Corrections of a trial point towards where the intervals join."""


SLOW = 0.03
"""Share of the merit that a step of Gauss and Newton must gain for another one to follow."""
SHORT = 0.25
"""Length of a Newton step below which one of Gauss and Newton follows."""
MARGIN = 1.1
"""Price of a violation over its multiplier."""
STALLS = 2
"""Steps in a row that gain little before a sequence counts as stalled."""
Watch = Callable[[float, float], bool]
"""Of an iterate: takes the objective and the largest violation, returns whether to stop."""


@dataclass
class Lead:
    """Where the sequence ended: x (n,), multipliers of the defects (m,) and of the bounds of p (P,).

    reached: whether it came to its tolerance; history: objective and violation of each iterate.
    """

    x: np.ndarray
    multipliers: np.ndarray
    bound: np.ndarray
    reached: bool = False
    history: list[tuple[float, float]] = field(default_factory=list)


def lead(
    problem: Problem,
    x: np.ndarray,
    tolerance: float,
    most: int,
    at_iterate: Watch = lambda *_: False,
    stalled: float = 0.0,
    feasible: float = np.inf,
) -> Lead:
    """The sequence for ``problem`` from x (n,), which takes at most ``most`` steps.

    tolerance: predicted change of the merit, relative to the objective, at which a full step is the last one;
    at_iterate: called at each iterate with the objective and the largest violation; where it says True, the sequence
    stops; stalled: change of the merit, relative to the objective, below which STALLS steps in a row, of whatever
    length, are the last ones too; feasible: violation from which on it goes on instead. It also stops where a step of
    Gauss and Newton does not lower the merit, or numbers are not finite.
    """
    x = x.copy()
    x[problem.S * problem.B :] = np.clip(problem.split(x)[1], *problem.p_bounds())
    found = Lead(x, np.zeros(problem.m), np.zeros(problem.P))
    prices, second, stalls = np.zeros(problem.m), False, 0
    while len(found.history) < most:
        f, c = problem.objective(x), np.abs(problem.defects(x))
        found.history.append((f, float(c.max(initial=0.0))))
        if at_iterate(*found.history[-1]) or not (np.isfinite(f) and np.isfinite(c).all()):
            break
        sub = newton(problem, x, found.multipliers) if second else gauss_newton(problem, x)
        step = solved(problem, sub, problem.split(x)[1])
        if step is None:
            break
        needed = MARGIN * np.abs(step.multipliers)
        prices = np.maximum(needed, 0.5 * (prices + needed))
        merit, slope = f + float(prices @ c), step.decrease - float(prices @ c)
        taken = _searched(problem, x, sub, step, (merit, slope), prices)
        if taken is None and second:
            second = False
            continue
        if taken is None:
            break
        length, x, reached = taken
        found.x, found.bound = x, step.bound
        found.multipliers = found.multipliers + length * (step.multipliers - found.multipliers)
        second = length >= SHORT if second else length < 1.0 or merit - reached < SLOW * abs(reached)
        stalls = stalls + 1 if merit - reached < stalled * abs(f) else 0
        done = stalls >= STALLS or (length == 1.0 and abs(slope) < tolerance * abs(f))
        if done and float(np.abs(problem.defects(x)).max(initial=0.0)) < feasible:
            found.reached = True
            break
    return found


def polished(problem: Problem, found: Lead) -> Lead:
    """Where ``found`` of the ``problem`` comes to by one more step, with the exact Hessian: multipliers and gradient
    balance to second order there."""
    step = solved(problem, newton(problem, found.x, found.multipliers, middle=False), problem.split(found.x)[1])
    if step is None:
        return found
    x = found.x + np.concatenate([step.nodes.reshape(-1), step.p])
    f, c = problem.objective(found.x), problem.defects(found.x)
    if not problem.objective(x) <= f + np.abs(step.multipliers) @ np.abs(c) + 1e-9 * (1 + abs(f)):
        return found
    return replace(found, x=x, multipliers=step.multipliers, bound=step.bound)


def _searched(
    problem: Problem, x: np.ndarray, sub: Subproblem, step: Step, merit_slope: tuple[float, float], prices: np.ndarray
) -> tuple[float, np.ndarray, float] | None:
    """Length of the ``step`` from x (n,) that lowers the merit enough, where it leads, and the merit there.

    merit_slope: the merit at x and its slope along the step; prices: (m,) of violations. None where no length does.
    """
    (merit, slope), length = merit_slope, 1.0
    d = np.concatenate([step.nodes.reshape(-1), step.p])
    still = np.zeros((len(problem.segments.run), problem.S)), np.zeros((len(problem.segments.run), problem.L))
    for _ in range(CUTS):
        new = x + length * d
        for again in range(CORRECTIONS):
            c = problem.defects(new)
            reached = problem.objective(new) + float(prices @ np.abs(c))
            if reached <= merit + 1e-4 * length * min(slope, 0.0) + 1e-10 * (1 + abs(merit)):
                return length, new, reached
            if not np.isfinite(reached) or again == CORRECTIONS - 1:
                break
            off = c.reshape(problem.M, problem.S)
            new = new.copy()
            new[: problem.S * problem.B] += carried(problem, sub.maps, off, *still).reshape(-1)
        length *= 0.5
    return None

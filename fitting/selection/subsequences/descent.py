"""The objective minimised by derivatives: regression of accelerations, then proximal Gauss-Newton on growing horizons.

A polynomial with wrong coefficients diverges within a subsequence of 100 s, where its error has no useful slope. So the
start is linear: the change of u, v, r over short blocks against the terms along the measured motion, ridged by the
prior. Then the same objective on short subsequences leads to that on the whole ones. Each step minimises the
Gauss-Newton model with the moduli of the sparsity and the bounds exactly, for several dampings at once, of which
simulation of all takes the best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.selection.subsequences.data import VELOCITIES, Subsequences
from fitting.selection.subsequences.learning import Learning
from fitting.selection.subsequences.objective import SubsequenceObjective
from fitting.selection.subsequences.quadratic_step import minimise_quadratic
from mmg.model import settled

HORIZONS = (0.1, 0.3, 1.0)
"""Lengths of the subsequences one after the other, by the objective's own."""
EARLY = 8
"""Steps on each horizon but the last."""
FACTORS = np.array([1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3])
"""Dampings tried at once, by the last that was best."""
TOLERANCE = 1e-4
"""Relative decrease of the objective in three steps below which it has converged."""


@dataclass(frozen=True)
class Descent:
    """Where the descent ended: ``p`` (P,), whether it ``converged``, number of ``steps``."""

    p: np.ndarray
    converged: bool
    steps: int


def regression(problem: SubsequenceObjective, block: int = 5) -> np.ndarray:
    """Scaled coefficients p (P,) by ridge regression of changes of velocity along the measured motion.

    problem: gives trials and prior; block: steps over which the change is taken. Weights of data and ridge follow from
    the residuals, in three rounds. Coefficients are kept within their bounds.
    """
    data, slopes = problem.cut(problem.length), problem.slopes
    theta = problem.coefficients(np.zeros(problem.P))
    path = np.concatenate([data.start[None, VELOCITIES], data.measured])
    heading = data.start[2] + np.concatenate([np.zeros((1, data.count)), np.cumsum(path[:-1, 2], axis=0) * data.h])
    rates, rows = [], []
    for k in range(len(data.controls)):
        middle = 0.5 * (path[k] + path[k + 1])
        six = np.concatenate([np.zeros((2, data.count)), heading[k][None], middle])
        state = settled(problem.simulator.model, six, data.controls[k], theta)
        rate, full = slopes.at(state[slopes.first :], data.controls[k], theta)
        own = slice(VELOCITIES.start - slopes.first, VELOCITIES.stop - slopes.first)
        rates.append(rate[own])
        rows.append(full[:, own, slopes.Q :])
    A, y = [], []
    for k in range(0, len(rates) - block + 1, block):
        there = data.weight[k + block - 1] > 0
        y.append(((path[k + block] - path[k]) - data.h * np.sum(rates[k : k + block], axis=0)).T[there])
        A.append(data.h * np.sum(rows[k : k + block], axis=0)[there])
    sides, matrix = np.concatenate(y), np.concatenate(A) * problem.prior.std
    p = np.zeros(problem.P)
    for _ in range(3):
        noise = (sides - matrix @ p).std(axis=0) + 1e-12
        H = np.eye(problem.P)
        g = np.zeros(problem.P)
        for j in range(3):
            H += matrix[:, j].T @ matrix[:, j] / noise[j] ** 2
            g += matrix[:, j].T @ sides[:, j] / noise[j] ** 2
        p = np.clip(np.linalg.solve(H, g), problem.lower, problem.upper)
    return p


def descend(
    problem: SubsequenceObjective,
    p: np.ndarray,
    learning: Learning,
    time_limit: float = np.inf,
    horizons: Sequence[float] = HORIZONS,
    most: int = 200,
) -> Descent:
    """The descent from ``p`` (P,) on ``problem``, noted in ``learning``.

    time_limit: [s] of ``learning``; horizons: of the subsequences; most: steps on the last of them.
    """
    steps, converged = 0, False
    learning.note(p)
    for share in horizons:
        last = share == horizons[-1]
        data = problem.train if last else problem.cut(max(share * problem.length, 2 * problem.step))
        p, count, converged = _on(problem, data, p, most if last else EARLY, learning, time_limit)
        steps += count
    return Descent(p, converged, steps)


def sparsity_path(
    problem: SubsequenceObjective,
    p: np.ndarray,
    weights: Sequence[float],
    each: Callable[[float, np.ndarray], bool | None],
    steps: int = 25,
    limit: float = np.inf,
) -> None:
    """The minima from ``p`` (P,) on for a sequence of ``weights`` of the sparsity, each from the one before.

    problem: with any sparsity; each: called with the weight and its minimum, ends the path by True; steps: most at each
    weight; limit: [s] of the whole path.
    """
    original, clock = problem.penalties, Learning(problem)
    try:
        for weight in weights:
            problem.penalties = replace(original, sparsity=weight)
            p, _, _ = _on(problem, problem.train, p, steps, clock, limit)
            if each(weight, p):
                break
    finally:
        problem.penalties = original


def _on(
    problem: SubsequenceObjective, data: Subsequences, p: np.ndarray, most: int, learning: Learning, limit: float
) -> tuple[np.ndarray, int, bool]:
    """Steps on one horizon: the point, their number, whether they have converged."""
    value, damping, past = float(problem.values(p[:, None], data)[0]), 1.0, []
    weight = problem.penalties.sparsity * problem.sparse
    box = (problem.lower, problem.upper)
    for step in range(most):
        if learning.seconds > limit:
            return p, step, False
        about = problem.quadratic(p, data)
        diagonal = np.diag(about.hessian)
        size = np.maximum(diagonal, 1e-6 * diagonal.max() + 1e-300)
        tried = []
        for mu in damping * FACTORS:
            H = about.hessian + np.diag(1e-3 * mu * size + 1e-9 * diagonal.max())
            tried.append(minimise_quadratic(H, about.gradient, p, box, weight))
        found = problem.values(np.transpose(tried), data)
        best = int(np.argmin(np.where(np.isfinite(found), found, np.inf)))
        if not found[best] < value:
            if damping > 1e8:
                return p, step, True
            damping *= 1e4
            continue
        p, value, damping = tried[best], float(found[best]), max(damping * FACTORS[best], 1e-10)
        learning.note(p)
        past.append(value)
        if len(past) > 3 and past[-4] - past[-1] < TOLERANCE * past[-1]:
            return p, step + 1, True
    return p, most, False

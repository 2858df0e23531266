"""The same objective without IPOPT: structured Gauss-Newton on single shooting, and the information matrix.

Each window is integrated in one piece from its own initial state. The normal equations have an arrow shape (one 6 x 6
block per window, bordered by the coefficients), so initial states are eliminated window by window (Schur complement).
Serves as an independent check of the optimum and gives the covariance of the coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from diagnosis.estimation.map_estimate import bounded_step
from fitting.nlp.problem import Problem
from mmg.compile.batch import BatchFunction
from mmg.runge_kutta import NODES, WEIGHTS


@dataclass
class Linearised:
    """Objective and normal equations at (z0, p): per window (W, S, S), (W, S, P), (W, S); shared (W, P, P), (W, P).

    In units of the problem's scaled variables; the prior is not included in the shared parts.
    """

    cost: float
    ww: np.ndarray
    wp: np.ndarray
    gw: np.ndarray
    pp: np.ndarray
    gp: np.ndarray


def cost(problem: Problem, z0: np.ndarray, p: np.ndarray) -> float:
    """Objective of ``problem`` from the windows' initial states z0 (W, S) in SI and scaled coefficients p (P,)."""
    seg = problem.segments
    end, interior = problem.shooting.values(z0[seg.window].T, problem.coefficients(p))
    return _cost(problem, z0, end, interior, p)


def _cost(problem: Problem, z0: np.ndarray, end: np.ndarray, interior: np.ndarray, p: np.ndarray) -> float:
    seg, h, theta = problem.segments, problem.kernels.measurement, problem.coefficients(p)
    start = z0[seg.window]
    e0 = h.values(start.T, theta).T - seg.nodes[seg.start]
    e1 = h.values(end, theta).T - seg.nodes[seg.end]
    memory = problem.memory_weight[seg.start] * (start[:, 6:] - problem.measured_nodes[seg.start, 6:]) ** 2
    total = (problem.node_weight[seg.start] * e0**2).sum() + (problem.node_weight[seg.end] * e1**2).sum()
    for k, z in enumerate(interior):
        total += (problem.weight[k] * (h.values(z, theta) - seg.targets[k]) ** 2).sum()
    return 0.5 * float(total + memory.sum() + p @ p)


def _logged(problem: Problem, z: np.ndarray, S: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (m, 6) of states z (S, m) and their sensitivities (m, 6, S + P), from those of the states."""
    h = problem.kernels.measurement
    if h.identity:
        return z[:6].T, S[:, :6]
    J = h.jacobian(z, theta)
    total = J[:, :, : problem.S] @ S
    total[:, :, problem.S + h.own] += J[:, :, problem.S :]
    return h.values(z, theta).T, total


def _sensitivities(problem: Problem, z: np.ndarray, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """States (S, W) from z (S, W) on, before and after each step of the windows, and their sensitivities (W, S, S + P);
    those of a window stay where it ends."""
    seg, (size, W), first = problem.segments, z.shape, problem.kernels.first
    whole = problem.kernels.whole
    given = whole.sx_in()
    jacobian = BatchFunction(ca.Function("jacobian", given[:3], whole(*given)[:2], {"cse": True}), None)
    rows, columns = (np.array(a, dtype=int) for a in whole.sparsity_out(1).get_triplet())
    S = np.zeros((W, size, size + problem.P))
    S[:, np.arange(size), np.arange(size)] = 1.0
    path = [(z, S)]
    for k, c in enumerate(seg.controls):
        rate, slope, total, summed = np.zeros_like(z), np.zeros_like(S), np.zeros_like(z), np.zeros_like(S)
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            rate, nonzeros = jacobian.at((z + node * seg.h * rate)[first:], c, theta)
            J = np.zeros((W, size, size - first + problem.P))
            J[:, rows, columns] = nonzeros.T
            slope = J[:, :, : size - first] @ (S + node * seg.h * slope)[:, first:]
            slope[:, :, size:] += J[:, :, size - first :]
            total, summed = total + weight * rate, summed + weight * slope
        active = seg.steps > k
        z = np.where(active, z + seg.h * total, z)
        S = np.where(active[:, None, None], S + seg.h * summed, S)
        path.append((z, S))
    return path


def linearise(problem: Problem, z0: np.ndarray, p: np.ndarray) -> Linearised:
    """Normal equations of ``problem`` at initial states z0 (W, S) and coefficients p (P,).

    Raises ValueError unless there is one interval per window (segments cut with K as long as a window), and for
    constants of single runs.
    """
    seg, size, P = problem.segments, problem.S, problem.P
    if len(seg.run) != seg.intervals:
        raise ValueError("single shooting needs one interval per window")
    if problem.prior.constants:
        raise ValueError("single shooting knows no constants of single runs")
    theta = problem.coefficients(p)
    path = _sensitivities(problem, z0[seg.window].T, theta)
    unit = np.concatenate([problem.scale, problem.prior.std])
    W = seg.intervals
    H, g = np.zeros((W, size + P, size + P)), np.zeros((W, size + P))
    samples = [(*path[0], seg.nodes[seg.start], problem.node_weight[seg.start])]
    samples += [(*path[-1], seg.nodes[seg.end], problem.node_weight[seg.end])]
    inside = zip(path[1:-1], seg.targets, problem.weight, strict=True)
    samples += [(z, S, targets.T, weight.T) for (z, S), targets, weight in inside]
    for z, S, measured, weight in samples:
        y, S_y = _logged(problem, z, S, theta)
        S_y = S_y * unit
        WS = weight[:, :, None] * S_y
        H += np.swapaxes(S_y, 1, 2) @ WS
        g += ((y - measured)[:, None, :] @ WS)[:, 0]
    memory = problem.memory_weight[seg.start]
    H[:, np.arange(6, size), np.arange(6, size)] += memory * problem.scale[6:] ** 2
    g[:, 6:size] += memory * (z0[seg.window, 6:] - problem.measured_nodes[seg.start, 6:]) * problem.scale[6:]
    return Linearised(
        _cost(problem, z0, path[-1][0], np.array([z for z, _ in path[1:-1]]), p),
        H[:, :size, :size],
        H[:, :size, size:],
        g[:, :size],
        H[:, size:, size:],
        g[:, size:],
    )


def information(problem: Problem, z0: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Fisher information of p (P,) per window of ``problem`` with initial states z0 (W, S) projected out, (W, P, P), no
    prior.
    """
    a = linearise(problem, z0, p)
    return a.pp - np.swapaxes(a.wp, 1, 2) @ np.linalg.solve(a.ww, a.wp)


@dataclass
class GaussNewtonResult:
    """Where Gauss-Newton ended: z0 (W, S), p (P,), objective, iterations, converged."""

    z0: np.ndarray
    p: np.ndarray
    objective: float
    iterations: int
    converged: bool


def _step(problem: Problem, a: Linearised, p: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Damped step of initial states and coefficients, the latter within their bounds."""
    ww = a.ww * (1 + damping * np.eye(problem.S))
    solved = np.linalg.solve(ww, np.concatenate([a.wp, a.gw[:, :, None]], axis=2))
    H = a.pp.sum(axis=0) - (np.swapaxes(a.wp, 1, 2) @ solved[:, :, :-1]).sum(axis=0) + np.eye(problem.P)
    g = a.gp.sum(axis=0) - (np.swapaxes(a.wp, 1, 2) @ solved[:, :, -1:]).sum(axis=0)[:, 0] + p
    dp = bounded_step(H + damping * np.diag(np.diag(H)), g, p, *problem.p_bounds())
    dz = np.zeros((len(problem.segments.run), problem.S))
    dz[problem.segments.window] = -(solved[:, :, -1] + solved[:, :, :-1] @ dp) * problem.scale
    return dz, dp


def solve(
    problem: Problem,
    z0: np.ndarray,
    p: np.ndarray,
    tolerance: float = 1e-10,
    max_iterations: int = 200,
    damping: float = 1e-2,
) -> GaussNewtonResult:
    """Levenberg-Marquardt on ``problem`` from initial states z0 (W, S) and coefficients p (P,); where it ended.

    Stops when an accepted step lowers the objective by less than ``tolerance`` relative, twice in a row, or after
    ``max_iterations``. damping: of the first step, relative to the diagonal. Bounds are respected.
    """
    z0, p = z0.copy(), np.clip(p, *problem.p_bounds())
    a = linearise(problem, z0, p)
    small = 0
    for iteration in range(1, max_iterations + 1):
        dz, dp = _step(problem, a, p, damping)
        trial = cost(problem, z0 + dz, p + dp)
        if np.isfinite(trial) and trial <= a.cost:
            gain = a.cost - trial
            z0, p, damping = z0 + dz, p + dp, max(damping / 5, 1e-9)
            a = linearise(problem, z0, p)
            small = small + 1 if gain <= tolerance * a.cost else 0
            if small >= 2:
                return GaussNewtonResult(z0, p, a.cost, iteration, True)
        else:
            damping *= 4
            if damping > 1e8:
                return GaussNewtonResult(z0, p, a.cost, iteration, small > 0)
    return GaussNewtonResult(z0, p, a.cost, max_iterations, False)

"""Sizes of the latent disturbance forces, estimated from how much the runs jump about.

A fit carries the Ornstein-Uhlenbeck processes of mmg/effects/disturbance.py along its windows as states that may jump
at every node. Their standard deviations are hyperparameters: the evidence (marginal likelihood, Laplace's
approximation over the node states) is largest where s^2 = s^2 Q / gamma, Q the sum of squared standardised jumps and
gamma the number of them that the data determine, N - tr(posterior covariance / prior covariance) (MacKay 1992). The
trace is the derivative of the log determinant of the windows' reduced Hessian with respect to the log of the jumps'
weight. A size of zero in the ship asks for an estimate, any other is kept.
"""

from __future__ import annotations

import numpy as np

from fitting.nlp.fisher_information import Quadratics, intervals_by_level, minimised_over_jumps
from fitting.nlp.problem import Problem
from mmg.effects import effect
from mmg.ship import Ship

AXES = ("X", "Y", "N")
STEP = 1e-3
"""Relative change of the weights over which the log determinant is differentiated."""
LEAST = 1e-3
"""Smallest size estimated, as a share of the typical one: where the runs show no such force."""


def free_axes(ship: Ship) -> tuple[str, ...]:
    """Axes of the disturbance of ``ship`` whose size is to be estimated."""
    if "disturbance" not in ship.effects:
        return ()
    return tuple(a for a in AXES if ship.coefficients[f"disturbance.{a}"].value == 0)


def typical_sizes(ship: Ship) -> dict[str, float]:
    """Typical sizes of the disturbance of ``ship`` by axis, from which an estimate starts."""
    rows = effect("disturbance").parameters(ship.namespace, dict(ship.components))
    return {row.symbol: row.typical for row in rows}


def update_sizes(problem: Problem, x: np.ndarray, axes: tuple[str, ...]) -> tuple[Problem, np.ndarray]:
    """The ``problem`` with re-estimated sizes on ``axes``, and x (n,) with the same forces under them."""
    nodes, p = problem.split(x)
    nodes = nodes.copy()
    typical, values = typical_sizes(problem.ship), {}
    squares, determined = jump_statistics(problem, x)
    for a in axes:
        c, symbol = AXES.index(a), f"disturbance.{a}"
        old = problem.ship.coefficients[symbol].value
        new = old * float(np.sqrt(squares[c] / max(determined[c], 1.0)))
        values[symbol] = max(new, LEAST * typical[a])
        nodes[:, problem.random[c]] *= old / values[symbol]
    changed = problem.with_changes(ship=problem.ship.with_values(values))
    return changed, changed.join(nodes, p)


def jump_statistics(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squared standardised jumps of each axis (3,) of ``problem`` at x (n,), and how many the data determine
    (3,).
    """
    seg, nodes = problem.segments, problem.split(x)[0]
    r = problem.random
    start = problem.memory_weight[:, r - 6] * nodes[:, r] ** 2
    squares = start.sum(axis=0) + (problem.jump_weight[:, None] * problem.process_jumps(nodes) ** 2).sum(axis=0)
    parts = Quadratics.of(problem, x)
    determined = np.zeros(len(r))
    for c in range(len(r)):
        up, down = np.ones(len(r)), np.ones(len(r))
        up[c], down[c] = 1 + STEP, 1 - STEP
        slope = log_determinant(problem, parts, up) - log_determinant(problem, parts, down)
        determined[c] = seg.intervals + len(seg.run) - slope / np.log(up[c] / down[c])
    return squares, determined


def log_determinant(problem: Problem, parts: Quadratics, factor: np.ndarray) -> float:
    """Log determinant of the Hessian of ``problem`` in all node states, the constraints eliminated, p held.

    parts: its quadratics; factor: (3,) on the weights of the jumps and of the first values of each axis.
    """
    seg, S, r = problem.segments, problem.S, problem.random
    V, nothing = np.zeros((len(seg.run), S, S)), np.zeros((len(seg.run), S))
    at_nodes = parts.nodes[:, :S, :S].copy()
    first = problem.memory_weight[:, r - 6] * problem.scale[r] ** 2
    at_nodes[:, r, r] += (factor - 1) * first
    total = 0.0
    for depth, i in enumerate(intervals_by_level(seg)):
        w = seg.window[i]
        if depth == 0:
            V[w] = at_nodes[seg.end[i]]
        price = problem.jump_weight[i][:, None] * factor * problem.scale[r] ** 2
        inner = V[w][:, r[:, None], r]
        inner[:, np.arange(len(r)), np.arange(len(r))] += price
        total += float(np.linalg.slogdet(inner)[1].sum())
        H = minimised_over_jumps(V[w], nothing[w], r, price)[0]
        T = parts.maps[i][:, :S, :S]
        V[w] = np.swapaxes(T, 1, 2) @ H @ T + parts.inside[i][:, :S, :S] + at_nodes[seg.start[i]]
    return total + float(np.linalg.slogdet(V)[1].sum())

"""What each window says about the coefficients: Fisher information and score with its states eliminated.

Windows are independent given the coefficients p. Over one window the cost of the node states is minimised from the
last node backwards (dynamic programming on the linearised problem, Bellman 1957): what remains at a node is a quadratic
in the state there and p, pulled through each shooting interval by its sensitivities. A latent process may jump at every
node for a price: minimising over the jump adds its variance, as the prediction of an information filter does. The
result is the Schur complement of the window's Gauss-Newton KKT matrix and, at a solution, by the envelope theorem the
exact gradient of the window's profiled cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fitting.problem import Problem
from fitting.segments import Segments


@dataclass(frozen=True)
class Information:
    """Of scaled coefficients p, by window: of the cost profiled over node states.

    fisher: (W, P, P); score: (W, P) gradient of the cost (minus the log likelihood); p: (P,) where it was taken; run:
    (W,) number of the run of each window; symbols: of the coefficients. known: (P, P) information from elsewhere, the
    prior (the identity) and captive tests; pull: (P,) its score.
    """

    fisher: np.ndarray
    score: np.ndarray
    p: np.ndarray
    run: np.ndarray
    symbols: tuple[str, ...]
    known: np.ndarray
    pull: np.ndarray

    @property
    def hessian(self) -> np.ndarray:
        """Gauss-Newton Hessian of the whole objective in p, prior included (P, P)."""
        total = self.fisher.sum(axis=0) + self.known
        return 0.5 * (total + total.T)

    def by_run(self) -> Information:
        """The windows of each run added up: one row per run."""
        runs, position = np.unique(self.run, return_inverse=True)
        fisher, score = np.zeros((len(runs), *self.fisher.shape[1:])), np.zeros((len(runs), len(self.p)))
        np.add.at(fisher, position, self.fisher)
        np.add.at(score, position, self.score)
        return replace(self, fisher=fisher, score=score, run=runs)


def information(problem: Problem, x: np.ndarray) -> Information:
    """Information and score of every window at x, which should satisfy the defects (a solution of the problem).

    Defects that are left count to first order; a robust loss counts by its weights. Elements are in units of the
    problem's scaled coefficients.
    """
    seg, S, P = problem.segments, problem.S, problem.P
    p = problem.split(x)[1].copy()
    q, g = _inside(problem, x)
    at_nodes = _at_nodes(problem, x)
    V, v = np.zeros((len(seg.run), S + P, S + P)), np.zeros((len(seg.run), S + P))
    maps, moved = _transitions(problem, x)
    for depth, i in enumerate(levels(seg)):
        w = seg.window[i]
        if depth == 0:
            V[w], v[w] = at_nodes(seg.end[i])
        T, c = maps(i), moved[i]
        price = problem.jump_weight[i][:, None] * problem.scale[problem.random] ** 2
        H, slope = freed(V[w], v[w], problem.random, price)
        node_H, node_slope = at_nodes(seg.start[i])
        T_t = np.swapaxes(T, 1, 2)
        V[w] = T_t @ H @ T + q[i] + node_H
        v[w] = (T_t @ (slope + (H @ c[:, :, None])[:, :, 0])[:, :, None])[:, :, 0] + g[i] + node_slope
    solved = np.linalg.solve(V[:, :S, :S], np.concatenate([V[:, :S, S:], v[:, :S, None]], axis=2))
    across = np.swapaxes(V[:, :S, S:], 1, 2) @ solved
    fisher = V[:, S:, S:] - across[:, :, :P]
    fisher = 0.5 * (fisher + np.swapaxes(fisher, 1, 2))
    score = v[:, S:] - across[:, :, P]
    return Information(fisher, score, p, seg.run.copy(), problem.prior.symbols, *_known(problem, p))


def levels(seg: Segments) -> list[np.ndarray]:
    """Intervals by how many of their window come after them: the last ones of all windows, those before them, ..."""
    order = np.lexsort((-seg.start, seg.window))
    window = seg.window[order]
    first = np.r_[0, np.flatnonzero(np.diff(window)) + 1]
    level = np.arange(len(order)) - np.repeat(first, np.diff(np.r_[first, len(order)]))
    return [order[level == depth] for depth in range(int(level.max()) + 1)]


@dataclass(frozen=True)
class Quadratics:
    """What the windows' cost is made of at x, in scaled (state, p): of the samples inside each interval and of those at
    each node, (M or B, S + P, S + P), and the map of each interval from its start to its end."""

    inside: np.ndarray
    nodes: np.ndarray
    maps: np.ndarray

    @classmethod
    def of(cls, problem: Problem, x: np.ndarray) -> Quadratics:
        nodes = _at_nodes(problem, x)(np.arange(problem.B))[0]
        return cls(_inside(problem, x)[0], nodes, _transitions(problem, x)[0](np.arange(problem.M)))


def _known(problem: Problem, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information and score of the prior and of captive tests."""
    known, pull = np.eye(problem.P), p.copy()
    if problem.captive:
        std, theta = problem.prior.std, problem.coefficients(p)
        known += np.outer(std, std) * problem.captive.information(theta)
        pull += std * problem.captive.gradient(theta)
    return known, pull


def _unit(problem: Problem) -> np.ndarray:
    return np.concatenate([problem.scale, problem.prior.std])


def _columns(problem: Problem, z: np.ndarray, sensitivity: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Scaled sensitivities (m, 6, S + P) of the logged columns from those of the states (m, S, S + P), SI."""
    h = problem.kernels.measurement
    if h.identity:
        return sensitivity[:, :6] * _unit(problem)
    J = h.jacobian(z, theta)
    total = J[:, :, : problem.S] @ sensitivity
    total[:, :, problem.S + h.own] += J[:, :, problem.S :]
    return total * _unit(problem)


def _inside(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic (M, S + P, S + P) and slope (M, S + P) in (start node, p) of the samples inside each interval."""
    size = problem.S + problem.P
    q, g = np.zeros((problem.M, size, size)), np.zeros((problem.M, size))
    theta, error, weight = problem.coefficients(problem.split(x)[1]), problem.errors(x)[1], problem.weights_at(x)[1]
    for sweep, s in zip(problem.sweep(x), problem.shooting.slices, strict=True):
        for k, sensitivity in enumerate(sweep.S_interior):
            m = len(sensitivity)
            J = _columns(problem, sweep.interior[k, :, :m], sensitivity, theta)
            weighted = weight[k, :, s][:, :m].T[:, :, None] * J
            q[s][:m] += np.swapaxes(J, 1, 2) @ weighted
            g[s][:m] += (error[k, :, s][:, :m].T[:, None, :] @ weighted)[:, 0]
    return q, g


def _at_nodes(problem: Problem, x: np.ndarray) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """A function of node numbers: quadratics and slopes in (node, p) of the samples at those nodes."""
    nodes, p = problem.split(x)
    S, P, theta, error = problem.S, problem.P, problem.coefficients(p), problem.errors(x)[0]
    weight, remembered = problem.weights_at(x)[0], np.arange(6, S)

    def of(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        still = np.zeros((len(b), S, S + P))
        still[:, np.arange(S), np.arange(S)] = 1.0
        J = _columns(problem, nodes[b].T, still, theta)
        weighted = weight[b][:, :, None] * J
        H, slope = np.swapaxes(J, 1, 2) @ weighted, (error[b][:, None, :] @ weighted)[:, 0]
        memory = problem.memory_weight[b] * problem.scale[6:]
        H[:, remembered, remembered] += memory * problem.scale[6:]
        slope[:, 6:S] += memory * (nodes[b, 6:] - problem.measured_nodes[b, 6:])
        return H, slope

    return of


def _transitions(problem: Problem, x: np.ndarray) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """A function of interval numbers giving d(end, p) / d(start, p), scaled (m, S + P, S + P); and what the end is
    off the next node (M, S + P), a latent state taken where it would be without a jump."""
    seg, S, P = problem.segments, problem.S, problem.P
    nodes, _, end, _ = problem.evaluate(x)
    off = np.zeros((problem.M, S + P))
    off[:, :S] = (end.T - nodes[seg.end]) / problem.scale
    off[:, problem.random] = problem._jumps(nodes) / problem.scale[problem.random]
    ends = np.concatenate([sweep.S_end for sweep in problem.sweep(x)])

    def of(i: np.ndarray) -> np.ndarray:
        T = np.zeros((len(i), S + P, S + P))
        T[:, :S] = ends[i] * _unit(problem) / problem.scale[:, None]
        T[:, problem.random] = 0.0
        T[:, problem.random, problem.random] = problem.decay[i][:, None]
        T[:, np.arange(S, S + P), np.arange(S, S + P)] = 1.0
        return T

    return of, off


def freed(V: np.ndarray, v: np.ndarray, r: np.ndarray, price: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratics and slopes after minimising over jumps of the states ``r``, whose squares cost ``price`` (m, R)."""
    if not len(r):
        return V, v
    inner, own = V[:, r[:, None], r].copy(), np.arange(len(r))
    inner[:, own, own] += price
    K = np.linalg.inv(inner)
    pulled = V[:, :, r] @ K
    H = V - pulled @ V[:, r]
    slope = v - (pulled @ v[:, r, None])[:, :, 0]
    H[:, :, r] = pulled * price[:, None, :]
    H[:, r, :] = np.swapaxes(H[:, :, r], 1, 2)
    H[:, r[:, None], r] = -price[:, :, None] * K * price[:, None, :]
    H[:, r, r] += price
    slope[:, r] = price * (K @ v[:, r, None])[:, :, 0]
    return H, slope

"""Fisher information and score of the coefficients from each window, its states eliminated.

Windows are independent given the coefficients p. Over one window the cost is minimised over the node states from the
last node backwards (dynamic programming on the linearised problem, Bellman 1957). What remains at a node is a quadratic
in the state there and p; the sensitivities of a shooting interval carry it from the interval's end to its start. The
result is the Schur complement of the window's Gauss-Newton KKT matrix and, at a solution, by the envelope theorem the
exact gradient of the window's profiled cost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fitting.nlp.prior import group_sums, product_sums
from fitting.nlp.problem import Problem
from fitting.nlp.shooting import Elimination
from fitting.nlp.windows import Segments


@dataclass(frozen=True)
class Information:
    """Of scaled coefficients p, by window: of the cost profiled over node states.

    fisher: (W, P, P); score: (W, P) gradient of the cost (minus the log likelihood); p: (P,) where it was taken; run:
    (W,) number of the run of each window; symbols: of the coefficients. prior_information: (P, P) of the prior (the
    identity) and of captive tests; prior_score: (P,) of the same. owner: (P,) run of a constant of one run, -1 of what
    all share, less for those of campaigns; None if all share all.
    """

    fisher: np.ndarray
    score: np.ndarray
    p: np.ndarray
    run: np.ndarray
    symbols: tuple[str, ...]
    prior_information: np.ndarray
    prior_score: np.ndarray
    owner: np.ndarray | None = None

    @property
    def hessian(self) -> np.ndarray:
        """Gauss-Newton Hessian of the whole objective in p, prior included (P, P)."""
        total = self.fisher.sum(axis=0) + self.prior_information
        return 0.5 * (total + total.T)  # rounding makes it a little lopsided

    def by_run(self) -> Information:
        """The windows of each run added up: one row per run."""
        runs, position = np.unique(self.run, return_inverse=True)
        fisher, score = (group_sums(position, values, len(runs)) for values in (self.fisher, self.score))
        return replace(self, fisher=fisher, score=score, run=runs)

    def of_data(self) -> np.ndarray:
        """Information of the data, captive tests among them, on the shared coefficients, without their prior (P, P)."""
        hessian = self.shared().hessian
        return hessian - np.eye(len(hessian))  # the prior is the identity in scaled coefficients

    def shared(self) -> Information:
        """Information of each run on the shared coefficients, its own constants eliminated under their prior.

        One row per run, or this itself if all coefficients are shared; one row in all if campaigns have constants.
        """
        if self.owner is None:
            return self
        together = bool((self.owner < -1).any())  # constants of campaigns have owners below -1
        runs, kept = self.by_run(), np.flatnonzero(self.owner == -1)
        if together:
            runs = replace(self, run=np.zeros_like(self.run)).by_run()
        fisher, score = np.empty((len(runs.run), len(kept), len(kept))), np.empty((len(runs.run), len(kept)))
        for k, run in enumerate(runs.run):
            own = np.flatnonzero(self.owner != -1 if together else self.owner == run)
            across = runs.fisher[k][np.ix_(kept, own)]
            own_hessian = runs.fisher[k][np.ix_(own, own)] + self.prior_information[np.ix_(own, own)]
            gain = np.linalg.solve(own_hessian, across.T).T  # Schur complement of the run's own constants
            fisher[k] = runs.fisher[k][np.ix_(kept, kept)] - gain @ across.T
            score[k] = runs.score[k][kept] - gain @ (runs.score[k][own] + self.prior_score[own])
        symbols = tuple(self.symbols[i] for i in kept)
        prior = self.prior_information[np.ix_(kept, kept)]
        return Information(fisher, score, self.p[kept], runs.run, symbols, prior, self.prior_score[kept])


def information(problem: Problem, x: np.ndarray) -> Information:
    """Information and score of every window of ``problem`` at x (n,), which should satisfy the defects (a solution).

    Defects that are eliminated count to first order; a robust loss counts by its weights. Elements are in units of the
    problem's scaled coefficients: (W, P, P) and (W, P).
    """
    seg, S, L, columns = problem.segments, problem.S, problem.L, problem.columns
    p, parts = problem.split(x)[1].copy(), Quadratics.of(problem, x)
    eliminated = Eliminated.of(seg, parts, problem.kernels.elimination)
    shared = parts.shared + eliminated.shared_by_window(seg)
    border, slope = eliminated.rows[:, :, S:], eliminated.slope
    solved = np.linalg.solve(eliminated.rows[:, :, :S], np.concatenate([border, slope[:, :S, None]], axis=2))
    across = np.swapaxes(border, 1, 2) @ solved
    local = shared - across[:, :, :L]  # Schur complement of the first state, the last one to go
    at = columns.each(columns.at, columns.window)
    fisher, score = np.zeros((len(seg.run), problem.P, problem.P)), np.zeros((len(seg.run), problem.P))
    window = np.arange(len(seg.run))[:, None]
    fisher[window[:, :, None], at[:, :, None], at[:, None, :]] = 0.5 * (local + np.swapaxes(local, 1, 2))  # rounding
    score[window, at] = slope[:, S:] - across[:, :, L]
    return Information(fisher, score, p, seg.run.copy(), problem.prior.symbols, *prior_parts(problem, p), columns.owner)


@dataclass(frozen=True)
class Eliminated:
    """Cost of each window over its first state and p, all later states eliminated from the last one backwards.

    rows: (W, S, S + L) of the first states, slope: (W, S + L). The quadratic in p is what the samples alone have there
    and, for each interval, A^T B + B^T A of ``factors`` = A, B (M, S, L). ahead: (M, S, S + L) rows and pull:
    (M, S) slope of the cost-to-go at the end of each interval.
    """

    rows: np.ndarray
    slope: np.ndarray
    factors: tuple[np.ndarray, np.ndarray]
    ahead: np.ndarray
    pull: np.ndarray

    @classmethod
    def of(cls, seg: Segments, parts: Quadratics, code: Elimination | None) -> Eliminated:
        """seg: the windows; parts: their quadratics; code: compiled, None to do it here."""
        S, n = parts.maps.shape[1:]
        if code:
            inside = (parts.inside, parts.inside_slope) if parts.inside.shape[2] == n else None  # else in the nodes
            given = seg.chains, parts.nodes, parts.node_slope, parts.maps, parts.off, inside
            rows, slope, B, ahead, pull = code.eliminated(*given)
            return cls(rows, slope, (parts.maps[:, :, S:], B), ahead, pull)
        W, M, L = len(seg.run), len(parts.maps), n - S
        rows, slope = np.zeros((W, S, n)), np.zeros((W, n))
        ahead, pull = np.empty((M, S, n)), np.empty((M, S))
        B = np.empty((M, S, L))
        for depth, i in enumerate(intervals_by_level(seg)):
            w, start, T = seg.window[i], seg.start[i], parts.maps[i]
            if depth == 0:
                rows[w], slope[w] = parts.nodes[seg.end[i]], parts.node_slope[seg.end[i]]
            H, v = rows[w], slope[w]
            ahead[i], pull[i] = H, v[:, :S]
            # the slope where the interval ends, not at the node
            v = v + (np.swapaxes(H, 1, 2) @ parts.off[i][:, :S, None])[:, :, 0]
            through = H[:, :, :S] @ T  # half of T'HT, the cost-to-go carried to the interval's start
            B[i] = 0.5 * through[:, :, S:] + H[:, :, S:]  # a half, as A^T B + B^T A counts the quadratic twice
            through[:, :, S:] += H[:, :, S:]  # p acts at the end itself, too, not only through the interval
            turned = np.swapaxes(T, 1, 2)
            rows[w] = turned[:, :S] @ through + parts.inside[i] + parts.nodes[start]
            carried = (turned @ v[:, :S, None])[:, :, 0]
            carried[:, S:] += v[:, S:]
            slope[w] = carried + parts.inside_slope[i] + parts.node_slope[start]
        return cls(rows, slope, (parts.maps[:, :, S:], B), ahead, pull)

    def shared_by_window(self, seg: Segments) -> np.ndarray:
        """What the elimination adds to the quadratic in p, by window (W, L, L)."""
        total = np.zeros((len(self.rows), *2 * self.factors[0].shape[2:]))
        for i in intervals_by_level(seg):
            A, B = (factor[i] for factor in self.factors)
            total[seg.window[i]] += np.swapaxes(A, 1, 2) @ B
        return total + np.swapaxes(total, 1, 2)

    def shared_by_group(self, group: np.ndarray, groups: int) -> np.ndarray:
        """The same, summed over the intervals of each ``group`` (M,): (groups, L, L)."""
        total = product_sums(*self.factors, group, groups)
        return total + np.swapaxes(total, 1, 2)


def intervals_by_level(seg: Segments) -> list[np.ndarray]:
    """Numbers of the intervals of ``seg``, arrays (m,): the last ones of all windows, those before them, ..."""
    order, first = seg.chains.number, seg.chains.first
    level = np.arange(len(order)) - np.repeat(first[:-1], np.diff(first))  # place of each interval in its chain
    return [order[level == depth] for depth in range(int(level.max()) + 1)]


@dataclass(frozen=True)
class Quadratics:
    """Parts of the windows' cost at x, in scaled (state, p): rows of the states' quadratics (M or B, S, S + L) and
    slopes (M or B, S + L) of the samples inside each interval and at each node, the quadratics in p alone, by window
    (W, L, L) or by group (G, L, L), the map of each interval from (start, p) to its end (M, S, S + L), and what the end
    is off the next node (M, S + L)."""

    inside: np.ndarray
    inside_slope: np.ndarray
    nodes: np.ndarray
    node_slope: np.ndarray
    shared: np.ndarray
    maps: np.ndarray
    off: np.ndarray

    @classmethod
    def of(cls, problem: Problem, x: np.ndarray, by_window: bool = True) -> Quadratics:
        """problem, x (n,): where; by_window: whether the quadratics in p are by window, else by group."""
        nodes, node_slope, at_nodes = _at_nodes(problem, x, by_window)
        inside, inside_slope, shared = _inside(problem, x, by_window)
        return cls(inside, inside_slope, nodes, node_slope, shared + at_nodes, *transitions(problem, x))


def prior_parts(problem: Problem, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (P, P) and score (P,) of the prior and of captive tests of ``problem`` at scaled p (P,)."""
    information, score = np.eye(problem.P), p.copy()
    if problem.captive:
        shared = slice(problem.columns.shared)
        std, theta = problem.prior.std[shared], problem.captive_coefficients(p)
        information[shared, shared] += np.outer(std, std) * problem.captive.information(theta)
        score[shared] += std * problem.captive.gradient(theta)
    return information, score


def _inside(problem: Problem, x: np.ndarray, by_window: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadratics of the samples inside each interval: rows (M, S, S + L) and slope (M, S + L) in (start node, p), and
    those in p alone by window (W, L, L) or group (G, L, L)."""
    nodes, p, _, _ = problem.evaluate(x)
    pull, direct = problem.sample_pull(x)
    cost = problem.sample_cost(x, pull, problem.weights_at(x)[1], 0.0)  # 0: no curvature of instruments (Gauss-Newton)
    starts, theta = nodes[problem.segments.start].T, problem.coefficients(p)
    found = problem.shooting.hessian(starts, theta, cost, by_window=by_window)
    problem.keep_slopes(x, found.ends, found.slope, direct)  # they come with it: no second sweep for them
    unit = problem.columns.unit(problem.scale, problem.std, problem.columns.interval)
    std = (problem.columns.each(problem.std, problem.columns.window) if by_window else problem.std)[:, None]
    slope = problem.slopes(x)[1] * unit[:, 0]
    rows = found.rows
    rows *= problem.scale[:, None] * unit  # in place: no copy of (M, S, S + L)
    return rows, slope, found.shared * np.swapaxes(std, 1, 2) * std


def _at_nodes(problem: Problem, x: np.ndarray, by_window: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of the samples at the nodes: (B, S, S + L), (B, S + L), (W or G, L, L)."""
    (nodes, p), S, L, columns = problem.split(x), problem.S, problem.L, problem.columns
    h, group = problem.kernels.measurement, columns.node
    own, unit = h.own, columns.unit(problem.scale, problem.std, group)[:, 0]
    weight, error = problem.weights_at(x)[0], problem.errors(x)[0]
    rows, slope, seg = np.zeros((problem.B, S, S + L)), np.zeros((problem.B, S + L)), problem.segments
    of, count = (seg.node_window, len(seg.run)) if by_window else (group, columns.groups)
    shared, measured = np.zeros((count, L, L)), np.arange(6)
    if h.identity:
        rows[:, measured, measured] = weight * problem.scale[:6] ** 2
        slope[:, :6] = weight * error * problem.scale[:6]
    else:
        at = np.concatenate([np.arange(S), S + own])
        J = h.jacobian(nodes.T, problem.columns.points(problem.coefficients(p), group)) * unit[:, None, at]
        weighted = weight[:, :, None] * J
        H = np.swapaxes(J, 1, 2) @ weighted
        rows[:, :, at] = H[:, :S]
        slope[:, at] = (error[:, None, :] @ weighted)[:, 0]
        shared[:, own[:, None], own] = group_sums(of, H[:, S:, S:], count)
    memory, remembered = problem.memory_weight * problem.scale[6:], np.arange(6, S)
    rows[:, remembered, remembered] += memory * problem.scale[6:]  # memory has one factor of the scale already
    slope[:, 6:S] += memory * (nodes[:, 6:] - problem.measured_nodes[:, 6:])
    return rows, slope, shared


def transitions(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """d end / d (start, p) of the intervals of ``problem`` at x (n,), (M, S, S + L); and the end off the next node, (M,
    S + L)."""
    S, L = problem.S, problem.L
    nodes, _, end, _ = problem.evaluate(x)
    off = np.zeros((problem.M, S + L))
    off[:, :S] = (end.T - nodes[problem.segments.end]) / problem.scale
    unit = problem.columns.unit(problem.scale, problem.std, problem.columns.interval)
    return problem.slopes(x)[0] * (unit / problem.scale[:, None]), off

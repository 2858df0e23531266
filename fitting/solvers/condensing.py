"""Calibrations by a sequence of quadratic subproblems, condensed window by window; ``solve`` has IPOPT certify it.

The nodes of a window meet those of the others only in the coefficients p. From the last node of each window backwards
the cost-to-go is a quadratic in the state there and p; the linearised interval carries it to the interval's start
(Riccati recursion without controls, Bellman 1957; condensing of Bock & Plitt 1984), for all windows at once. What is
left is dense: the first state of each window, then p under its bounds. A forward pass gives the steps of all nodes, and
the multiplier of each continuity constraint is the slope of the cost-to-go at the interval's end.

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

from fitting.nlp.fisher_information import Eliminated, Quadratics, intervals_by_level, prior_parts, transitions
from fitting.nlp.prior import product_sums
from fitting.nlp.problem import Problem


@dataclass(frozen=True)
class Subproblem:
    """Objective and linearised constraints at x, in scaled (state, p).

    rows: (B, S, S + L) Hessian rows of the nodes; slope: (B, S) gradient; shared: (P, P) and shared_slope: (P,) of the
    coefficients; maps: (M, S, S + L) derivative of the end of each interval to (start, p); off: (M, S) the end off the
    next node.
    """

    rows: np.ndarray
    slope: np.ndarray
    shared: np.ndarray
    shared_slope: np.ndarray
    maps: np.ndarray
    off: np.ndarray


@dataclass(frozen=True)
class Step:
    """nodes: (B, S) and p: (P,), steps of the scaled variables; multipliers: (M S,) of the defects there; bound: (P,)
    multipliers of the bounds, positive at upper ones; decrease: change of the quadratic model along the slope alone."""

    nodes: np.ndarray
    p: np.ndarray
    multipliers: np.ndarray
    bound: np.ndarray
    decrease: float


def gauss_newton(problem: Problem, x: np.ndarray) -> Subproblem:
    """That of ``problem`` with the Gauss-Newton Hessian at x (n,): a robust loss by its weights, which majorise it."""
    seg, S, columns = problem.segments, problem.S, problem.columns
    parts, p = Quadratics.of(problem, x, by_window=False), problem.split(x)[1]
    rows, slope = parts.nodes, parts.node_slope[:, :S].copy()
    rows[seg.start] += parts.inside  # samples inside an interval depend on its first node and p alone
    slope[seg.start] += parts.inside_slope[:, :S]
    prior, score = prior_parts(problem, p)
    pulls = columns.total(parts.node_slope[:, S:], columns.node)
    pulls = pulls + columns.total(parts.inside_slope[:, S:], columns.interval)
    shared, pull = columns.matrix(parts.shared, problem.P) + prior, columns.vector(pulls, problem.P) + score
    return Subproblem(rows, slope, shared, pull, parts.maps, parts.off[:, :S])


def newton(problem: Problem, x: np.ndarray, multipliers: np.ndarray, middle: bool = True) -> Subproblem:
    """That of ``problem`` with the Hessian of the Lagrangian at x (n,) and the ``multipliers`` (m,) of the defects, in
    which the rates are bent once in each Runge-Kutta step, in its middle (the midpoint rule): that takes half the time
    and changes the bending by a few percent, so that steps converge a little slower and to the same place."""
    S, B = problem.S, problem.B
    rows, shared = problem.hessian_parts(x, 1.0, multipliers, middle)
    g = problem.gradient(x)
    maps, off = transitions(problem, x)
    return Subproblem(rows, g[: S * B].reshape(B, S), shared, g[S * B :], maps, off[:, :S])


def solved(problem: Problem, sub: Subproblem, p: np.ndarray) -> Step | None:
    """The step that minimises ``sub`` from p (P,) within the bounds of ``problem``; None for numbers not finite."""
    seg, S, L, P, columns = problem.segments, problem.S, problem.L, problem.P, problem.columns
    W, at = len(seg.run), columns.each(columns.at, columns.window)
    nothing = np.zeros((problem.M, 1, 1)), np.zeros((problem.M, 1))  # samples inside: in the rows of nodes already
    node_slope = np.hstack([sub.slope, np.zeros((problem.B, L))])
    parts = Quadratics(*nothing, sub.rows, node_slope, sub.shared, sub.maps, sub.off)
    eliminated = Eliminated.of(seg, parts, problem.kernels.elimination)
    if not (
        np.isfinite(eliminated.rows).all() and np.isfinite(eliminated.slope).all() and np.isfinite(sub.shared).all()
    ):
        return None
    first = _positive(eliminated.rows[:, :, :S])
    border = eliminated.rows[:, :, S:]
    gain = np.linalg.solve(first, np.concatenate([border, eliminated.slope[:, :S, None]], axis=2))
    local = eliminated.shared_by_group(columns.interval, columns.groups)
    local -= product_sums(border, gain[:, :, :L], columns.window, columns.groups)  # Schur complement of first states
    reduced = sub.shared + columns.matrix(local, P)
    slopes = eliminated.slope[:, S:] - (np.swapaxes(border, 1, 2) @ gain[:, :, L:])[:, :, 0]
    reduced_slope = sub.shared_slope + columns.vector(columns.total(slopes, columns.window), P)
    (dense,) = _positive(0.5 * (reduced + reduced.T)[None])  # rounding makes it a little lopsided
    lower, upper = problem.p_bounds()
    dp = within_bounds(dense, reduced_slope, lower - p, upper - p)
    local_dp = np.broadcast_to(dp[at], (W, L))  # one row where all windows share all coefficients
    first_state = -(gain[:, :, :L] @ local_dp[:, :, None])[:, :, 0] - gain[:, :, L]
    nodes = carried(problem, sub.maps, sub.off, first_state, local_dp)
    end = np.concatenate([nodes[seg.end], local_dp[seg.window]], axis=1)
    # of a defect: the slope of the cost that follows
    multipliers = (eliminated.ahead @ end[:, :, None])[:, :, 0] + eliminated.pull
    decrease = float((sub.slope * nodes).sum() + sub.shared_slope @ dp)
    bound = -(dense @ dp + reduced_slope)  # stationarity: slope + multipliers = 0
    bound[(dp > lower - p) & (dp < upper - p)] = 0.0  # rounding, where no bound holds
    return Step(nodes, dp, multipliers.reshape(-1), bound, decrease)


def carried(problem: Problem, maps: np.ndarray, off: np.ndarray, first: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Steps of all nodes (B, S) of the ``problem`` that the linearised intervals make of the steps of the ``first``
    nodes of the windows (W, S) and of the coefficients p (W, L): maps, off as of ``Subproblem``."""
    seg, S = problem.segments, problem.S
    code = problem.kernels.elimination
    if code:
        return code.carried(seg.chains, maps, off, first, p if p.any() else None, problem.B)
    nodes = np.zeros((problem.B, S))
    shared = (maps[:, :, S:] @ p[seg.window][:, :, None])[:, :, 0] + off
    for number, i in enumerate(reversed(intervals_by_level(seg))):
        w, start = seg.window[i], seg.start[i]
        # first intervals of shorter windows
        begins = ~np.isin(start, seg.end) if number else np.ones(len(start), dtype=bool)
        nodes[start[begins]] = first[w[begins]]
        nodes[seg.end[i]] = (maps[i, :, :S] @ nodes[start][:, :, None])[:, :, 0] + shared[i]
    return nodes


def _positive(blocks: np.ndarray) -> np.ndarray:
    """The symmetric ``blocks`` (m, k, k) with negative eigenvalues turned round."""
    values, vectors = np.linalg.eigh(blocks)
    least = 1e-8 * np.abs(values).max(axis=1, keepdims=True)  # what is less is rounding
    if (values > least).all():
        return blocks
    values = np.maximum(np.abs(values), least)
    return (vectors * values[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def within_bounds(H: np.ndarray, g: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """The d (P,) that minimises g . d + d . H d / 2 between ``lower`` and ``upper`` (P,), for H (P, P) positive.

    Where the free minimum leaves the bounds, the least squares that have the same minimum are solved by an active set
    (Stark and Parker 1995, Bounded-variable least squares).
    """
    d = np.linalg.solve(H, -g)
    if ((d >= lower) & (d <= upper)).all():
        return d
    from scipy.optimize import lsq_linear  # late: slow to import, and seldom needed

    d = np.clip(d, lower, upper)
    free = lower < upper  # SciPy takes no bounds that meet
    if free.any():
        d[free] = 0.0  # what is held pulls on the others
        root, slope = np.linalg.cholesky(H[np.ix_(free, free)]), (g + H @ d)[free]
        bounds, most = (lower[free], upper[free]), CHANGES * len(slope)
        # H = R R': |R' d + R^-1 g|^2 / 2; tol is by that sum, which may be far larger than what a step gains
        d[free] = lsq_linear(root.T, -np.linalg.solve(root, slope), bounds, "bvls", tol=1e-15, max_iter=most).x
    for bound in (lower, upper):  # what stops at a bound is there but for rounding
        d = np.where(np.isclose(d, bound, rtol=1e-12, atol=1e-12), bound, d)
    return d


# Changes of the set of bounds that hold [-], by the number of coefficients, before a quadratic program ends. Set by
# hand: with one each, as SciPy has it, 11 of 4,000 random programs of bad condition end early, with ten none.
CHANGES = 10
CUTS = 10  # Halvings of a step before it counts as failed. 2^-10 of a step gains nothing. Set by hand.
CORRECTIONS = 3  # Corrections of a trial point towards where the intervals join. Set by hand.
# Share of the merit that a step of Gauss and Newton must gain for another one to follow. Set by hand: it decides how a
# solve gets there, not where.
SLOW = 0.03
SHORT = 0.25  # Length of a Newton step below which one of Gauss and Newton follows. Set by hand, as SLOW.
STALLS = 2  # Steps in a row that gain little before a sequence counts as stalled. Set by hand.
Watch = Callable[[float, float], bool]  # Of objective and largest violation of an iterate: whether to stop


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
    led = Lead(x, np.zeros(problem.m), np.zeros(problem.P))
    prices, second, stalls = np.zeros(problem.m), False, 0
    while len(led.history) < most:
        f, c = problem.objective(x), np.abs(problem.defects(x))
        led.history.append((f, float(c.max(initial=0.0))))
        if at_iterate(*led.history[-1]) or not (np.isfinite(f) and np.isfinite(c).all()):
            break
        sub = newton(problem, x, led.multipliers) if second else gauss_newton(problem, x)
        step = solved(problem, sub, problem.split(x)[1])
        if step is None:
            break
        needed = 1.1 * np.abs(step.multipliers)  # any factor above 1 makes the merit exact (Han 1977)
        prices = np.maximum(needed, 0.5 * (prices + needed))  # they fall slowly, or steps would undo each other
        merit, slope = f + float(prices @ c), step.decrease - float(prices @ c)
        taken = _searched(problem, x, sub, step, (merit, slope), prices)
        if taken is None and second:  # curvature may mislead far off: Gauss and Newton from here
            second = False
            continue
        if taken is None:
            break
        length, x, reached = taken
        led.x, led.bound = x, step.bound
        led.multipliers = led.multipliers + length * (step.multipliers - led.multipliers)  # as far as the step went
        # Newton where Gauss-Newton is slow
        second = length >= SHORT if second else length < 1.0 or merit - reached < SLOW * abs(reached)
        stalls = stalls + 1 if merit - reached < stalled * abs(f) else 0
        done = stalls >= STALLS or (length == 1.0 and abs(slope) < tolerance * abs(f))
        if done and float(np.abs(problem.defects(x)).max(initial=0.0)) < feasible:
            led.reached = True
            break
    return led


def polished(problem: Problem, led: Lead) -> Lead:
    """Where one exact step more has ``led`` the ``problem``: multipliers and gradient balance to second order there."""
    step = solved(problem, newton(problem, led.x, led.multipliers, middle=False), problem.split(led.x)[1])
    if step is None:
        return led
    x = led.x + np.concatenate([step.nodes.reshape(-1), step.p])
    f, c = problem.objective(led.x), problem.defects(led.x)
    # not >, so that nan is worse; 1e-9: rounding
    if not problem.objective(x) <= f + np.abs(step.multipliers) @ np.abs(c) + 1e-9 * (1 + abs(f)):
        return led
    return replace(led, x=x, multipliers=step.multipliers, bound=step.bound)


def _searched(
    problem: Problem, x: np.ndarray, sub: Subproblem, step: Step, merit_slope: tuple[float, float], prices: np.ndarray
) -> tuple[float, np.ndarray, float] | None:
    """Length of the ``step`` from x (n,) that lowers the merit enough, where it leads, and the merit there.

    merit_slope: the merit at x and its slope along the step; prices: (m,) of violations. None where no length does.
    """
    (merit, slope), length = merit_slope, 1.0
    d = np.concatenate([step.nodes.reshape(-1), step.p])
    W = len(problem.segments.run)
    still = np.zeros((W, problem.S)), np.zeros((W, problem.L))  # first states and coefficients stay in a correction
    for _ in range(CUTS):
        new = x + length * d
        for again in range(CORRECTIONS):
            c = problem.defects(new)
            reached = problem.objective(new) + float(prices @ np.abs(c))
            # decrease of Armijo (1966), or no more than rounding; 1e-4: his constant as usual (Nocedal & Wright 2006)
            if reached <= merit + 1e-4 * length * min(slope, 0.0) + 1e-10 * (1 + abs(merit)):
                return length, new, reached
            if not np.isfinite(reached) or again == CORRECTIONS - 1:
                break
            off = c.reshape(problem.M, problem.S)
            new = new.copy()
            # joined again: else curved defects refuse good steps (Maratos 1978)
            new[: problem.S * problem.B] += carried(problem, sub.maps, off, *still).reshape(-1)
        length *= 0.5
    return None

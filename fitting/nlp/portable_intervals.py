"""Shooting intervals without compiled code, by numpy and CasADi's own evaluation; compiled ones are tested by these.

Only the right-hand side is symbolic; the chain rule through time is dense linear algebra over all intervals at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fitting.nlp.group_sums import group_sums
from fitting.nlp.portable_rates import Functions
from fitting.nlp.sample_cost import Curved, SampleCost
from mmg.compile.batch import filled, padded
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS


@dataclass
class Sweep:
    """What a forward sweep with sensitivities leaves for the gradient, the Jacobian and the Hessian.

    end: (S, M); interior: (K-1, S, M); S_end: (M, S, S + P) with respect to the start node and the free coefficients;
    S_interior: per step (m_k, S, S + P); q: per step (4 stages, Q, m_k) the arguments of the stages;
    J_q: per step (m_k, 4, S, Q); Q: per step (m_k, 4 stages, Q, S + P), derivative of q.
    """

    end: np.ndarray
    interior: np.ndarray
    S_end: np.ndarray
    S_interior: list[np.ndarray]
    q: list[np.ndarray]
    J_q: list[np.ndarray]
    Q: list[np.ndarray]


def _pad(array: np.ndarray) -> np.ndarray:
    """Columns padded with copies of the last one to a whole number of lanes."""
    return filled(array, padded(array.shape[1]))


class Intervals:
    """Evaluates a block of intervals, sorted longest first, all with the same coefficients, by a model's functions.

    steps: (M,); controls: (K, C, M) as in Segments.
    """

    def __init__(self, functions: Functions, steps: np.ndarray, controls: np.ndarray, h: float) -> None:
        self.functions, self.controls, self.h = functions, controls, h
        self.M, self.P, self.K = len(steps), functions.P, len(controls)
        self.S, self.Q = functions.S, functions.Q
        self.first = self.S - self.Q
        self.active = [m for k in range(self.K) if (m := int((steps > k).sum()))]
        self._to_q = functions.jacobian_at[1] < self.Q
        rows, columns = functions.hessian_at
        self._both = (rows < self.Q) & (columns < self.Q)
        self._mixed = (rows < self.Q) & (columns >= self.Q)
        self._own = rows >= self.Q

    def _rates(self, q: np.ndarray, c: np.ndarray, theta: np.ndarray) -> np.ndarray:
        result = self.functions.rates(_pad(q), _pad(c), theta)[0]
        assert result is not None
        return result[:, : q.shape[1]]

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K-1, S, M) from start states (S, M) and all coefficients."""
        h, z = self.h, start.copy()
        interior = np.zeros((max(self.K - 1, 0), self.S, self.M))
        for k, m in enumerate(self.active):
            z0, c = z[:, :m].copy(), self.controls[k, :, :m]
            rate, total = np.zeros((self.S, m)), np.zeros((self.S, m))
            for fraction, weight in zip(NODES, WEIGHTS, strict=True):
                rate = self._rates(z0[self.first :] + fraction * h * rate[self.first :], c, theta)
                total += weight * rate
            z[:, :m] = z0 + h * total
            if k < self.K - 1:
                interior[k, :, :m] = z[:, :m]
        return z, interior

    def _jacobian(self, q: np.ndarray, c: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rates (S, m), their Jacobian (m, S, Q) to q, and that of rows 3.. (m, S - 3, P) to the coefficients."""
        m = q.shape[1]
        k, nonzeros = self.functions.jacobian(_pad(q), _pad(c), theta)
        assert k is not None and nonzeros is not None
        J_q, J_theta = np.zeros((m, self.S, self.Q)), np.zeros((m, self.S - 3, self.P))
        rows, columns = self.functions.jacobian_at
        J_q[:, rows[self._to_q], columns[self._to_q]] = nonzeros[self._to_q, :m].T
        J_theta[:, rows[~self._to_q] - 3, columns[~self._to_q] - self.Q] = nonzeros[~self._to_q, :m].T
        return k[:, :m], J_q, J_theta

    def sweep(self, start: np.ndarray, theta: np.ndarray) -> Sweep:
        """Forward sweep with sensitivities; arguments as in ``values``."""
        P, K, M, size = self.P, self.K, self.M, self.S
        z, S = start.copy(), np.zeros((M, size, size + P))
        S[:, np.arange(size), np.arange(size)] = 1.0
        result = Sweep(z, np.zeros((max(K - 1, 0), size, M)), S, [], [], [], [])
        for k, m in enumerate(self.active):
            self._step(k, z[:, :m], S[:m], theta, result)
            if k < K - 1:
                result.interior[k, :, :m] = z[:, :m]
                result.S_interior.append(S[:m].copy())
        return result

    def _step(self, k: int, z: np.ndarray, S: np.ndarray, theta: np.ndarray, result: Sweep) -> None:
        """One Runge-Kutta step of states (S, m) and sensitivities (m, S, S + P), both in place."""
        h, P, m, size, first, Q_ = self.h, self.P, z.shape[1], self.S, self.first, self.Q
        c = self.controls[k, :, :m]
        rate, total = np.zeros((self.S, m)), np.zeros((self.S, m))
        dq, theta_part = np.zeros((m, Q_, size + P)), np.zeros((m, size - 3, P))
        qs, Js, Qs = np.empty((4, Q_, m)), np.empty((m, 4, size, Q_)), np.empty((m, 4, Q_, size + P))
        for i, (fraction, weight) in enumerate(zip(NODES, WEIGHTS, strict=True)):
            qs[i] = z[first:] + fraction * h * rate[first:]
            Q = Qs[:, i]
            np.multiply(dq, fraction * h, out=Q)
            Q += S[:, first:]
            rate, J_q, J_theta = self._jacobian(qs[i], c, theta)
            Js[:, i] = J_q
            if i < 3:
                dq = J_q[:, first:] @ Q
                dq[:, 3 - first :, size:] += J_theta
            total += weight * rate
            J_theta *= weight
            theta_part += J_theta
        weighted = np.swapaxes(Js * (h * np.array(WEIGHTS))[None, :, None, None], 1, 2)
        z += h * total
        S += weighted.reshape(m, size, 4 * Q_) @ Qs.reshape(m, 4 * Q_, size + P)
        S[:, 3:, size:] += h * theta_part
        result.q.append(qs)
        result.J_q.append(Js)
        result.Q.append(Qs)

    def hessian(
        self, sweep: Sweep, theta: np.ndarray, end_weight: np.ndarray, cost: SampleCost, middle: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Hessian of sum over intervals of end_weight . end + cost of the interior states.

        end_weight: (S, M); middle: as of ``Blocks.hessian``. Returns the rows of the start nodes (M, S, S + P),
        symmetric within their first S columns, and the (P, P) block of the coefficients.
        """
        P, size = self.P, self.S
        nodes, shared = np.zeros((self.M, size, size + P)), np.zeros((P, P))
        adjoint = end_weight.copy()
        for k in range(len(self.active) - 1, -1, -1):
            m = self.active[k]
            if k < self.K - 1:
                adjoint[:, :m] += cost.pull[k, :, :m]
                left, right = cost.through(k, sweep.S_interior[k])
                nodes[:m] += np.swapaxes(left[:, :, :size], 1, 2) @ right
                shared += left[:, :, size:].reshape(-1, P).T @ right[:, :, size:].reshape(-1, P)
            mu, q, Q = self._adjoints(adjoint[:, :m], sweep.J_q[k]), sweep.q[k], sweep.Q[k]
            if middle:
                mu, q, Q = mu.sum(axis=0)[None], q[MIDDLE : MIDDLE + 1], Q[:, MIDDLE : MIDDLE + 1]
            self._curvature(k, (q, Q), theta, mu, nodes[:m], shared)
        return nodes, shared

    def quadratics(self, sweep: Sweep, cost: SampleCost) -> tuple[np.ndarray, np.ndarray]:
        """Hessian of the ``cost`` of the interior states alone, to first order in the states: rows (M, S, S + P), and
        the block of the coefficients of each interval (M, P, P)."""
        P, size = self.P, self.S
        nodes, shared = np.zeros((self.M, size, size + P)), np.zeros((self.M, P, P))
        for k, S in enumerate(sweep.S_interior):
            left, right = cost.through(k, S)
            nodes[: len(S)] += np.swapaxes(left[:, :, :size], 1, 2) @ right
            shared[: len(S)] += np.swapaxes(left[:, :, size:], 1, 2) @ right[:, :, size:]
        return nodes, shared

    def slope(self, sweep: Sweep, pull: np.ndarray) -> np.ndarray:
        """Gradient (M, S + P) of the cost of the interior states to start node and coefficients, from that to the
        states (K - 1, S, M)."""
        total = np.zeros((self.M, self.S + self.P))
        for k, S in enumerate(sweep.S_interior):
            total[: len(S)] += (pull[k, :, : len(S)].T[:, None, :] @ S)[:, 0]
        return total

    def _adjoints(self, adjoint: np.ndarray, J_q: np.ndarray) -> np.ndarray:
        """Multipliers of the four stage rates (4, S, m); ``adjoint`` (S, m) is moved back over the step in place."""
        h = self.h
        multipliers = np.empty((4, *adjoint.shape))
        back, later = adjoint.copy(), np.zeros_like(adjoint)
        for i in (3, 2, 1, 0):
            mu = multipliers[i]
            mu[:] = h * WEIGHTS[i] * adjoint + later
            pulled = (np.swapaxes(J_q[:, i], 1, 2) @ mu.T[:, :, None])[:, :, 0].T
            back[self.first :] += pulled
            later = np.zeros_like(adjoint)
            later[self.first :] = h * NODES[i] * pulled
        adjoint[:] = back
        return multipliers

    def _curvature(
        self,
        k: int,
        at: tuple[np.ndarray, np.ndarray],
        theta: np.ndarray,
        mu: np.ndarray,
        nodes: np.ndarray,
        shared: np.ndarray,
    ) -> None:
        """Adds sum of mu (stages, S, m) . (second derivative of the stage rates) of one step by the chain rule; at:
        arguments (stages, Q, m) of the stages and their sensitivities (m, stages, Q, S + P).

        With U = 1/2 H_qq Q + H_qth for each stage: H += Q^T U + U^T Q + H_thth.
        """
        (q, Q), stages = at, len(mu)
        m, P, size, Q_ = nodes.shape[0], self.P, self.S, self.Q
        rows, columns = self.functions.hessian_at
        c = np.tile(self.controls[k, :, :m], stages)  # all stages side by side
        beside, pull = (np.concatenate(list(each), axis=1) for each in (q, mu))
        nonzeros = self.functions.hessian.at(beside, c, theta, pull)[0].reshape(len(rows), stages, m)
        H_qq = np.zeros((m, stages, Q_, Q_))
        both = np.moveaxis(nonzeros[self._both], 0, 2).swapaxes(0, 1)
        H_qq[:, :, rows[self._both], columns[self._both]] = both
        H_qq[:, :, columns[self._both], rows[self._both]] = both
        U = 0.5 * (H_qq @ Q)
        mixed = np.moveaxis(nonzeros[self._mixed], 0, 2).swapaxes(0, 1)
        U[:, :, rows[self._mixed], columns[self._mixed] - Q_ + size] += mixed
        Q, U = Q.reshape(m, stages * Q_, -1), U.reshape(m, stages * Q_, -1)
        nodes += np.swapaxes(Q[:, :, :size], 1, 2) @ U + np.swapaxes(U[:, :, :size], 1, 2) @ Q
        cross = Q[:, :, size:].reshape(-1, P).T @ U[:, :, size:].reshape(-1, P)
        shared += cross + cross.T
        total = nonzeros[self._own].sum(axis=(1, 2))
        r, col = rows[self._own] - Q_, columns[self._own] - Q_
        shared[r, col] += total
        off = r != col
        shared[col[off], r[off]] += total[off]


class Blocks:
    """All intervals in blocks that fit the processor's cache, each of one group of coefficients.

    functions: of the ship; steps: (M,) of each interval, longest first among those of a group; controls: (K, C, M) held
    over steps of h [s]; group: (M,) of the coefficients (G, all); window: (M,) to which an interval belongs, W in
    all. The methods return what ``mmg.compile.intervals.IntervalKernel`` does.
    """

    def __init__(
        self,
        functions: Functions,
        steps: np.ndarray,
        controls: np.ndarray,
        h: float,
        group: np.ndarray,
        window: np.ndarray,
        block: int = 512,
    ) -> None:
        self.P, self.window = functions.P, window
        changes = np.flatnonzero((np.diff(group) != 0) | (np.diff(steps) > 0)) + 1
        self.slices: list[slice] = []
        for first, last in pairwise([0, *changes.tolist(), len(steps)]):
            edges = np.linspace(first, last, max(1, round((last - first) / block)) + 1).round().astype(int)
            self.slices += [slice(a, b) for a, b in pairwise(edges) if b > a]
        self.group = [int(group[s.start]) for s in self.slices]
        self.blocks = [Intervals(functions, steps[s], np.ascontiguousarray(controls[:, :, s]), h) for s in self.slices]

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K - 1, S, M) from start states (S, M) and coefficients (G, all)."""
        each = zip(self.blocks, self.slices, self.group, strict=True)
        ends, inside = zip(*(b.values(start[:, s], theta[g]) for b, s, g in each), strict=True)
        return np.concatenate(ends, axis=1), np.concatenate(inside, axis=2)

    def linearise(self, start: np.ndarray, theta: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the ends (M, S, S + P), and gradient (M, S + P) of what has ``pull`` (K - 1, S, M) to the
        interior states; start, theta: as of ``values``."""
        found = []
        for b, s, g in zip(self.blocks, self.slices, self.group, strict=True):
            sweep = b.sweep(start[:, s], theta[g])
            found.append((sweep.S_end, b.slope(sweep, pull[:, :, s])))
        return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))  # type: ignore[return-value]

    def quadratics(self, start: np.ndarray, theta: np.ndarray, cost: SampleCost, windows: int) -> Curved:
        """The same with the Hessian of the ``cost`` to first order: rows of the start nodes (M, S, S + P), and that of
        the coefficients by window (W, P, P); start, theta: as of ``values``."""
        found, shared = [], np.zeros((windows, self.P, self.P))
        for b, s, g in zip(self.blocks, self.slices, self.group, strict=True):
            sweep = b.sweep(start[:, s], theta[g])
            rows, own = b.quadratics(sweep, cost.block(s))
            shared += group_sums(self.window[s], own, windows)
            found.append((sweep.S_end, b.slope(sweep, cost.pull[:, :, s]), rows))
        return _joined(found, shared)

    def hessian(
        self,
        start: np.ndarray,
        theta: np.ndarray,
        cost: SampleCost,
        weight: np.ndarray,
        groups: int,
        middle: bool = False,
    ) -> Curved:
        """The same with the whole Hessian of ``weight`` (S, M) . ends + ``cost``, and that of the coefficients by group
        (G, P, P); start, theta: as of ``values``; middle: second derivatives of the rates are taken once a step, in its
        middle, with the multipliers of all stages."""
        found, shared = [], np.zeros((groups, self.P, self.P))
        for b, s, g in zip(self.blocks, self.slices, self.group, strict=True):
            sweep = b.sweep(start[:, s], theta[g])
            rows, own = b.hessian(sweep, theta[g], weight[:, s], cost.block(s), middle)
            shared[g] += own
            found.append((sweep.S_end, b.slope(sweep, cost.pull[:, :, s]), rows))
        return _joined(found, shared)


def _joined(found: list[tuple[np.ndarray, np.ndarray, np.ndarray]], shared: np.ndarray) -> Curved:
    """What the blocks give, one after the other, and what they share."""
    ends, slope, rows = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Curved(ends, slope, rows, shared)

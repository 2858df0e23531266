"""Values, first and second derivatives of many shooting intervals at once.

An interval integrates K Runge-Kutta steps from its start node with inputs held over each step. For all intervals
together this gives the end state and the interior states, their sensitivities with respect to the start node and the
free coefficients, and the Hessian of any weighted sum of them (exact, by a backward sweep of adjoints through the
stages and a product of stacked sensitivities). Only the right-hand side is symbolic; the chain rule through time is
dense linear algebra over intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from fitting.nlp.measurement import Measurement
from fitting.nlp.run_constants import Columns
from fitting.nlp.windows import Segments
from mmg.compile.batch import batch_functions, filled, padded
from mmg.model import Model
from mmg.runge_kutta import NODES, WEIGHTS


class Kernels:
    """Right-hand side of a ``model``, Jacobian and Hessian as batch functions of q, controls, coefficients.

    A state has S rows, of which q are the Q last ones, on which the rates depend: from ``first`` on. free: positions
    of the free coefficients among all (P of them); compiled: whether to use a C compiler. ``jacobian_at``: row and
    column of each nonzero of the (S, Q + P) Jacobian; ``hessian_at``: of the upper triangle of the (Q + P, Q + P)
    Hessian of mu . rates.
    """

    def __init__(self, model: Model, free: np.ndarray, compiled: bool = True) -> None:
        self.model, self.free = model, np.asarray(free, dtype=int)
        self.S, self.first = len(model.states), model.first
        q, c = ca.SX.sym("q", self.S - self.first), ca.SX.sym("c", len(model.controls))
        theta, mu = ca.SX.sym("theta", len(model.symbols)), ca.SX.sym("mu", self.S)
        k = ca.cse(model.rates(ca.vertcat(ca.SX.zeros(self.first), q), c, theta))
        z = ca.vertcat(q, *[theta[int(i)] for i in free])
        J, H = ca.jacobian(k, z), ca.triu(ca.hessian(ca.dot(mu, k), z)[0])
        options = {"cse": True}
        functions = [
            ca.Function("f_rates", [q, c, theta], [k], options),
            ca.Function("f_jacobian", [q, c, theta], [k, J], options),
            ca.Function("f_hessian", [q, c, theta, mu], [H], options),
        ]
        (self.rates, self.jacobian, self.hessian), self.interpreted_because = batch_functions(functions, compiled)
        self.jacobian_at, self.hessian_at = (np.array(A.sparsity().get_triplet(), dtype=int) for A in (J, H))
        self.measurement = Measurement(model, self.free, compiled)


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


@dataclass
class SampleCost:
    """Derivatives of the cost of the interior states, by step and interval.

    pull: (K-1, S, M) gradient with respect to the state; weight: (K-1, S, M) diagonal of its Hessian; full: instead,
    (K-1, M, S + O, S + O) Hessian with respect to the state and the free coefficients at positions ``own`` (O of them).
    """

    pull: np.ndarray
    weight: np.ndarray
    full: np.ndarray | None = None
    own: np.ndarray | None = None

    def block(self, s: slice) -> SampleCost:
        """The intervals of a slice."""
        full = None if self.full is None else self.full[:, s]
        return SampleCost(self.pull[:, :, s], self.weight[:, :, s], full, self.own)

    def add(self, k: int, m: int, S: np.ndarray, nodes: np.ndarray, shared: np.ndarray) -> None:
        """Adds the cost's Hessian after step k with respect to the start nodes, for sensitivities S (m, S, S + P)."""
        size, P = S.shape[1], S.shape[2] - S.shape[1]
        if self.full is None:
            WS = self.weight[k, :, :m].T[:, :, None] * S
            nodes[:m] += np.swapaxes(S[:, :, :size], 1, 2) @ WS
            shared += S[:, :, size:].reshape(-1, P).T @ WS[:, :, size:].reshape(-1, P)
            return
        assert self.own is not None
        extra = len(self.own)
        through = np.zeros((m, size + extra, size + P))
        through[:, :size] = S
        through[:, np.arange(size, size + extra), size + self.own] = 1.0
        curved = self.full[k, :m] @ through
        nodes[:m] += np.swapaxes(through[:, :, :size], 1, 2) @ curved
        rows = through[:, :, size:].reshape(-1, P)
        shared += rows.T @ curved[:, :, size:].reshape(-1, P)


def _pad(array: np.ndarray) -> np.ndarray:
    """Columns padded with copies of the last one to a whole number of lanes."""
    return filled(array, padded(array.shape[1]))


class Intervals:
    """Evaluates a block of intervals, sorted longest first, with the kernels of a model.

    steps: (M,); controls: (K, C, M) as in Segments.
    """

    def __init__(self, kernels_: Kernels, steps: np.ndarray, controls: np.ndarray, h: float) -> None:
        self.kernels, self.controls, self.h = kernels_, controls, h
        self.M, self.P, self.K = len(steps), len(kernels_.free), len(controls)
        self.S, self.first = kernels_.S, kernels_.first
        self.Q = self.S - self.first
        self.active = [m for k in range(self.K) if (m := int((steps > k).sum()))]
        self._to_q = kernels_.jacobian_at[1] < self.Q
        rows, columns = kernels_.hessian_at
        self._both = (rows < self.Q) & (columns < self.Q)
        self._mixed = (rows < self.Q) & (columns >= self.Q)
        self._own = rows >= self.Q

    def _rates(self, q: np.ndarray, c: np.ndarray, theta: np.ndarray) -> np.ndarray:
        result = self.kernels.rates(_pad(q), _pad(c), theta)[0]
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
        k, nonzeros = self.kernels.jacobian(_pad(q), _pad(c), theta)
        assert k is not None and nonzeros is not None
        J_q, J_theta = np.zeros((m, self.S, self.Q)), np.zeros((m, self.S - 3, self.P))
        rows, columns = self.kernels.jacobian_at
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
        self, sweep: Sweep, theta: np.ndarray, end_weight: np.ndarray, cost: SampleCost
    ) -> tuple[np.ndarray, np.ndarray]:
        """Hessian of sum over intervals of end_weight . end + cost of the interior states.

        end_weight: (S, M). Returns the rows of the start nodes (M, S, S + P), symmetric within their first S columns,
        and the (P, P) block of the coefficients.
        """
        P, size = self.P, self.S
        nodes, shared = np.zeros((self.M, size, size + P)), np.zeros((P, P))
        adjoint = end_weight.copy()
        for k in range(len(self.active) - 1, -1, -1):
            m = self.active[k]
            if k < self.K - 1:
                adjoint[:, :m] += cost.pull[k, :, :m]
                cost.add(k, m, sweep.S_interior[k], nodes, shared)
            multipliers = self._adjoints(adjoint[:, :m], sweep.J_q[k])
            self._curvature(k, sweep, theta, multipliers, nodes[:m], shared)
        return nodes, shared

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
        self, k: int, sweep: Sweep, theta: np.ndarray, mu: np.ndarray, nodes: np.ndarray, shared: np.ndarray
    ) -> None:
        """Adds sum of mu . (second derivative of the stage rates) of one step by the chain rule.

        With U = 1/2 H_qq Q + H_qth for each stage: H += Q^T U + U^T Q + H_thth.
        """
        m, P, size, Q_ = nodes.shape[0], self.P, self.S, self.Q
        rows, columns = self.kernels.hessian_at
        nonzeros = np.empty((len(rows), 4, m))
        c = _pad(self.controls[k, :, :m])
        for i in range(4):
            part = self.kernels.hessian(_pad(sweep.q[k][i]), c, theta, _pad(mu[i]))[0]
            assert part is not None
            nonzeros[:, i] = part[:, :m]
        H_qq = np.zeros((m, 4, Q_, Q_))
        both = np.moveaxis(nonzeros[self._both], 0, 2).swapaxes(0, 1)
        H_qq[:, :, rows[self._both], columns[self._both]] = both
        H_qq[:, :, columns[self._both], rows[self._both]] = both
        Q = sweep.Q[k]
        U = 0.5 * (H_qq @ Q)
        mixed = np.moveaxis(nonzeros[self._mixed], 0, 2).swapaxes(0, 1)
        U[:, :, rows[self._mixed], columns[self._mixed] - Q_ + size] += mixed
        Q, U = Q.reshape(m, 4 * Q_, -1), U.reshape(m, 4 * Q_, -1)
        nodes += np.swapaxes(Q[:, :, :size], 1, 2) @ U + np.swapaxes(U[:, :, :size], 1, 2) @ Q
        cross = Q[:, :, size:].reshape(-1, P).T @ U[:, :, size:].reshape(-1, P)
        shared += cross + cross.T
        total = nonzeros[self._own].sum(axis=(1, 2))
        r, col = rows[self._own] - Q_, columns[self._own] - Q_
        shared[r, col] += total
        off = r != col
        shared[col[off], r[off]] += total[off]


class Shooting:
    """All intervals of a Segments, evaluated in blocks that fit the processor's cache, each of one group of columns.

    theta: all coefficients, (all,) or by group (G, all); group: that of each block.
    """

    def __init__(self, kernels_: Kernels, segments: Segments, columns: Columns, block: int = 128) -> None:
        self.P, self.segments, self.columns = len(kernels_.free), segments, columns
        changes = np.flatnonzero((np.diff(columns.interval) != 0) | (np.diff(segments.steps) > 0)) + 1
        self.slices = []
        for first, last in pairwise([0, *changes.tolist(), segments.intervals]):
            edges = np.linspace(first, last, max(1, round((last - first) / block)) + 1).round().astype(int)
            self.slices += [slice(a, b) for a, b in pairwise(edges) if b > a]
        self.group = [int(columns.interval[s.start]) for s in self.slices]
        self.blocks = [
            Intervals(kernels_, segments.steps[s], np.ascontiguousarray(segments.controls[:, :, s]), segments.h)
            for s in self.slices
        ]

    def _each(self, theta: np.ndarray) -> list[np.ndarray]:
        """All coefficients of each block."""
        return [theta if theta.ndim == 1 else theta[g] for g in self.group]

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K-1, S, M) from start states (S, M) and all coefficients."""
        each = zip(self.blocks, self.slices, self._each(theta), strict=True)
        ends, inside = zip(*(b.values(start[:, s], own) for b, s, own in each), strict=True)
        return np.concatenate(ends, axis=1), np.concatenate(inside, axis=2)

    def sweep(self, start: np.ndarray, theta: np.ndarray) -> list[Sweep]:
        """Forward sweeps with sensitivities, one per block."""
        each = zip(self.blocks, self.slices, self._each(theta), strict=True)
        return [b.sweep(start[:, s], own) for b, s, own in each]

    def hessian(
        self, sweeps: list[Sweep], theta: np.ndarray, end_weight: np.ndarray, cost: SampleCost
    ) -> tuple[np.ndarray, np.ndarray]:
        """As ``Intervals.hessian``, for all blocks: (M, S, S + P) and, by group, (G, P, P)."""
        rows, shared = [], np.zeros((self.columns.groups, self.P, self.P))
        each = zip(self.blocks, self.slices, self.group, self._each(theta), sweeps, strict=True)
        for b, s, group, own, sweep in each:
            nodes, part = b.hessian(sweep, own, end_weight[:, s], cost.block(s))
            rows.append(nodes)
            shared[group] += part
        return np.concatenate(rows), shared

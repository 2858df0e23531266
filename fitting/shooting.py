"""Values, first and second derivatives of many shooting intervals at once.

An interval integrates K Runge-Kutta steps from its start node with inputs held over each step. For all intervals
together this gives the end state and the interior states, their sensitivities with respect to the start node and the
free coefficients, and the Hessian of any weighted sum of them (exact, by a backward sweep of adjoints through the
stages and a product of stacked sensitivities). Only the right-hand side is symbolic; the chain rule through time is
dense linear algebra over intervals.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from fitting.segments import Segments
from mmg.batch import BatchFunction, batch_functions, padded
from mmg.model import Model

STAGE_FRACTION = (0.0, 0.5, 0.5, 1.0)
STAGE_WEIGHT = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
"""Classical fourth-order Runge-Kutta: stage i starts from the step's start plus fraction h times stage i-1."""


@dataclass
class Kernels:
    """Right-hand side, Jacobian and Hessian as batch functions of (psi, u, v, r), controls, coefficients.

    free: positions of the free coefficients among all (P of them). ``jacobian_at``: row and column of each nonzero of
    the (6, 4 + P) Jacobian; ``hessian_at``: of the upper triangle of the (4 + P, 4 + P) Hessian of mu . rates.
    """

    rates: BatchFunction
    jacobian: BatchFunction
    hessian: BatchFunction
    jacobian_at: tuple[np.ndarray, np.ndarray]
    hessian_at: tuple[np.ndarray, np.ndarray]
    free: np.ndarray
    interpreted_because: str


def kernels(model: Model, free: np.ndarray, compiled: bool = True) -> Kernels:
    """Derivative kernels of a model for the coefficients at positions ``free``."""
    q, c = ca.SX.sym("q", 4), ca.SX.sym("c", 4)
    theta, mu = ca.SX.sym("theta", len(model.symbols)), ca.SX.sym("mu", 6)
    k = ca.cse(model.rates(ca.vertcat(0, 0, q), c, theta))
    z = ca.vertcat(q, *[theta[int(i)] for i in free])
    J = ca.jacobian(k, z)
    H = ca.triu(ca.hessian(ca.dot(mu, k), z)[0])
    options = {"cse": True}
    functions = [
        ca.Function("f_rates", [q, c, theta], [k], options),
        ca.Function("f_jacobian", [q, c, theta], [k, J], options),
        ca.Function("f_hessian", [q, c, theta, mu], [H], options),
    ]
    batch, reason = batch_functions(functions, compiled)
    return Kernels(
        *batch,
        jacobian_at=tuple(np.array(part) for part in J.sparsity().get_triplet()),
        hessian_at=tuple(np.array(part) for part in H.sparsity().get_triplet()),
        free=np.asarray(free, dtype=int),
        interpreted_because=reason,
    )


@dataclass
class Sweep:
    """What a forward sweep with sensitivities leaves for the gradient, the Jacobian and the Hessian.

    end: (6, M); interior: (K-1, 6, M); S_end: (M, 6, 6 + P); S_interior: list of (m_k, 6, 6 + P);
    stages: per step and stage (q (4, m), Jacobian (m, 6, 4 + P), Q (m, 4, 6 + P)).
    """

    end: np.ndarray
    interior: np.ndarray
    S_end: np.ndarray
    S_interior: list[np.ndarray]
    stages: list[list[tuple[np.ndarray, np.ndarray, np.ndarray]]]


class Shooting:
    """Evaluates all intervals of a Segments with the kernels of a model."""

    def __init__(self, kernels_: Kernels, segments: Segments) -> None:
        self.kernels = kernels_
        self.segments = segments
        self.P = len(kernels_.free)
        self.active = [int((segments.steps > k).sum()) for k in range(segments.K)]

    def _pad(self, array: np.ndarray, count: int) -> np.ndarray:
        """The first ``count`` columns, padded with copies of the first one to a whole number of lanes."""
        missing = padded(count) - count
        part = array[:, :count]
        return np.hstack([part, np.repeat(part[:, :1], missing, axis=1)]) if missing else part

    def _rates(self, q: np.ndarray, c: np.ndarray, theta: np.ndarray, count: int) -> np.ndarray:
        result = self.kernels.rates(self._pad(q, count), self._pad(c, count), theta)[0]
        assert result is not None
        return result[:, :count]

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (6, M) and interior states (K-1, 6, M) from start states (6, M) and all coefficients."""
        seg, h = self.segments, self.segments.h
        z = start.copy()
        interior = np.zeros(seg.targets.shape)
        for k, m in enumerate(self.active):
            if m == 0:
                break
            z0, c = z[:, :m], seg.controls[k]
            rate, total = np.zeros((6, m)), np.zeros((6, m))
            for fraction, weight in zip(STAGE_FRACTION, STAGE_WEIGHT, strict=True):
                rate = self._rates(z0[2:] + fraction * h * rate[2:], c, theta, m)
                total += weight * rate
            z[:, :m] = z0 + h * total
            if k < seg.K - 1:
                interior[k, :, :m] = z[:, :m]
        return z, interior

    def _jacobian(
        self, q: np.ndarray, c: np.ndarray, theta: np.ndarray, m: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rates (6, m) and dense Jacobian (m, 6, 4 + P)."""
        k, nonzeros = self.kernels.jacobian(self._pad(q, m), self._pad(c, m), theta)
        assert k is not None and nonzeros is not None
        J = np.zeros((m, 6, 4 + self.P))
        rows, columns = self.kernels.jacobian_at
        J[:, rows, columns] = nonzeros[:, :m].T
        return k[:, :m], J

    def sweep(self, start: np.ndarray, theta: np.ndarray) -> Sweep:
        """Forward sweep with sensitivities; arguments as in ``values``."""
        seg, h, P = self.segments, self.segments.h, self.P
        M = seg.intervals
        z = start.copy()
        S = np.zeros((M, 6, 6 + P))
        S[:, np.arange(6), np.arange(6)] = 1.0
        interior, S_interior, stages = np.zeros(seg.targets.shape), [], []
        for k, m in enumerate(self.active):
            if m == 0:
                break
            z0, S0, c = z[:, :m], S[:m], seg.controls[k]
            rate, total = np.zeros((6, m)), np.zeros((6, m))
            dRate, dTotal = None, np.zeros((m, 6, 6 + P))
            step = []
            for fraction, weight in zip(STAGE_FRACTION, STAGE_WEIGHT, strict=True):
                q = z0[2:] + fraction * h * rate[2:]
                Q = S0[:, 2:].copy() if dRate is None else S0[:, 2:] + fraction * h * dRate[:, 2:]
                rate, J = self._jacobian(q, c, theta, m)
                dRate = J[:, :, :4] @ Q
                dRate[:, :, 6:] += J[:, :, 4:]
                total += weight * rate
                dTotal += weight * dRate
                step.append((q, J, Q))
            stages.append(step)
            z[:, :m] = z0 + h * total
            S[:m] += h * dTotal
            if k < seg.K - 1:
                interior[k, :, :m] = z[:, :m]
                S_interior.append(S[:m].copy())
        return Sweep(z, interior, S, S_interior, stages)

    def hessian(
        self, sweep: Sweep, theta: np.ndarray, end_weight: np.ndarray, residual: np.ndarray, weight: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Hessian of sum over intervals of end_weight . end + 1/2 sum weight (interior - target)^2.

        end_weight: (6, M); residual: (K-1, 6, M) interior minus target; weight: (K-1, 6, M). Returns the rows of the
        start nodes (M, 6, 6 + P), symmetric within their first six columns, and the (P, P) block of the coefficients.
        """
        seg, P = self.segments, self.P
        nodes = np.zeros((seg.intervals, 6, 6 + P))
        shared = np.zeros((P, P))
        adjoint = end_weight.copy()
        for k in range(len(sweep.stages) - 1, -1, -1):
            m = self.active[k]
            if k < seg.K - 1:
                w = weight[k, :, :m]
                adjoint[:, :m] += w * residual[k, :, :m]
                S = sweep.S_interior[k]
                WS = w.T[:, :, None] * S
                nodes[:m] += np.swapaxes(S[:, :, :6], 1, 2) @ WS
                shared += S[:, :, 6:].reshape(-1, P).T @ WS[:, :, 6:].reshape(-1, P)
            adjoint[:, :m] = self._step_hessian(k, sweep, theta, adjoint[:, :m], nodes[:m], shared)
        return nodes, shared

    def _step_hessian(
        self,
        k: int,
        sweep: Sweep,
        theta: np.ndarray,
        adjoint: np.ndarray,
        nodes: np.ndarray,
        shared: np.ndarray,
    ) -> np.ndarray:
        """Adds the curvature of one step to ``nodes`` and ``shared``; returns the adjoint at the step's start."""
        h, m, P = self.segments.h, adjoint.shape[1], self.P
        back, later = adjoint.copy(), np.zeros((6, m))
        multipliers: list[np.ndarray] = [np.empty(0)] * 4
        for i in (3, 2, 1, 0):
            _, J, _ = sweep.stages[k][i]
            mu = h * STAGE_WEIGHT[i] * adjoint + later
            pulled = np.zeros((6, m))
            pulled[2:] = np.einsum("mij,im->jm", J[:, :, :4], mu)
            back += pulled
            later = h * STAGE_FRACTION[i] * pulled
            multipliers[i] = mu
        for i in range(4):
            q, _, Q = sweep.stages[k][i]
            nonzeros = self.kernels.hessian(
                self._pad(q, m), self._pad(self.segments.controls[k], m), theta, self._pad(multipliers[i], m)
            )[0]
            assert nonzeros is not None
            self._scatter(nonzeros[:, :m], Q, nodes, shared)
        return back

    def _scatter(self, nonzeros: np.ndarray, Q: np.ndarray, nodes: np.ndarray, shared: np.ndarray) -> None:
        """Chain rule: H += Q^T U + U^T Q + H_thth with U = 1/2 H_qq Q + H_qth."""
        P, m = self.P, Q.shape[0]
        rows, columns = self.kernels.hessian_at
        state = rows < 4
        both = state & (columns < 4)
        mixed = state & (columns >= 4)
        U = np.zeros((m, 4, 6 + P))
        H_qq = np.zeros((m, 4, 4))
        H_qq[:, rows[both], columns[both]] = nonzeros[both].T
        H_qq[:, columns[both], rows[both]] = nonzeros[both].T
        U += 0.5 * (H_qq @ Q)
        U[:, rows[mixed], columns[mixed] + 2] += nonzeros[mixed].T
        nodes += np.swapaxes(Q[:, :, :6], 1, 2) @ U + np.swapaxes(U[:, :, :6], 1, 2) @ Q
        cross = Q[:, :, 6:].reshape(-1, P).T @ U[:, :, 6:].reshape(-1, P)
        shared += cross + cross.T
        own = ~state
        total = nonzeros[own].sum(axis=1)
        r, c = rows[own] - 4, columns[own] - 4
        np.add.at(shared, (r, c), total)
        off = r != c
        np.add.at(shared, (c[off], r[off]), total[off])

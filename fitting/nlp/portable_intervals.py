"""Shooting intervals without compiled code: one interval as an expression of CasADi, mapped over all of them.

The compiled kernel (``mmg.compile.interval_source``, which has the same chain rule) is tried against these.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from fitting.nlp.prior import group_sums
from mmg.compile.batch import BatchFunction
from mmg.compile.intervals import Lanes
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS, rk4_step


class PortableIntervals:
    """What ``mmg.compile.intervals.IntervalKernel`` does, whose methods say what they take and return, N = S + P.

    whole: as of ``mmg.compile.interval_source.interval_source``.
    """

    def __init__(self, whole: ca.Function) -> None:
        self.S, self.Q, self.P = whole.size1_out(0), whole.size1_in(0), whole.size2_out(1) - whole.size1_in(0)
        self._sizes = whole.numel_in(1), whole.numel_in(2)
        given = whole.sx_in()
        k, J, H = whole(*given)
        self._rates = ca.Function("rates", given[:3], [k], {"cse": True})
        self._jacobian = ca.Function("jacobian", given[:3], [k, J], {"cse": True})
        self._hessian = ca.Function("hessian", given, [ca.triu2symm(H)], {"cse": True})
        self._made: dict[tuple, BatchFunction] = {}

    def values(self, lanes: Lanes, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As of ``IntervalKernel``."""
        end, interior = self._run(lanes, ("values",), start, theta)
        return end, interior.reshape(-1, self.S, lanes.M)

    def linearise(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """As of ``IntervalKernel``."""
        ends, slope = self._run(lanes, ("slopes",), start, theta, pull)
        return _matrices(ends, self.S), slope.T

    def curve(
        self,
        lanes: Lanes,
        start: np.ndarray,
        theta: np.ndarray,
        pull: np.ndarray,
        cost: tuple[np.ndarray, np.ndarray],
        weight: np.ndarray | None,
        slot: np.ndarray,
        middle: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """As of ``IntervalKernel``."""
        kind = ("curvature", tuple(cost[1].tolist()), weight is not None, middle)
        given = (pull, cost[0], *([] if weight is None else [weight]))
        ends, slope, rows, shared = self._run(lanes, kind, start, theta, *given)
        total = group_sums(slot[lanes.position], _matrices(shared, self.P), int(slot.max()) + 1)
        return _matrices(ends, self.S), slope.T, _matrices(rows, self.S), total

    def _run(
        self, lanes: Lanes, kind: tuple, start: np.ndarray, theta: np.ndarray, *more: np.ndarray
    ) -> list[np.ndarray]:
        """Outputs (elements, M) of the function of this ``kind``, which is made when it is first asked for."""
        (K, C, _), at, M = lanes.controls.shape, lanes.position, lanes.M
        if (kind, K, lanes.h) not in self._made:
            self.K, self.h = K, lanes.h
            name, *rest = kind
            self._made[kind, K, lanes.h] = BatchFunction(getattr(self, f"_{name}")(*rest), None)
        by_interval = theta[0] if len(theta) == 1 else np.ascontiguousarray(theta[lanes.group[at]].T)
        exist = (np.arange(K)[:, None] < lanes.steps[at]).astype(float)
        held = lanes.controls[..., at].reshape(K * C, M)
        return self._made[kind, K, lanes.h](start, held, exist, by_interval, *(a.reshape(-1, M) for a in more))

    def _arguments(self) -> list[ca.MX]:
        """Start (S, 1), inputs (C, K), which steps exist (K, 1), and coefficients (all, 1) of one interval."""
        C, every = self._sizes
        shapes = {"start": (self.S, 1), "inputs": (C, self.K), "exists": (self.K, 1), "theta": (every, 1)}
        return [ca.MX.sym(name, *shape) for name, shape in shapes.items()]

    def _values(self) -> ca.Function:
        """Of the arguments: end and interior states."""
        z, c, exists, theta = arguments = self._arguments()
        found = []
        for k in range(self.K):
            end = rk4_step(lambda at, _, k=k: self._rates(at[-self.Q :], c[:, k], theta), z, self.h)  # type: ignore[misc]
            z = z + exists[k] * (end - z)
            found.append(exists[k] * z)
        return ca.Function("values", arguments, [z, ca.horzcat(ca.MX(self.S, 0), *found[:-1])])

    def _sweep(self, z: ca.MX, c: ca.MX, exists: ca.MX, theta: ca.MX) -> tuple[list[ca.MX], list[list]]:
        """Sensitivities (S, N) after each step; and by step and stage the arguments (Q,) of the rates, their
        sensitivities (Q, N) and the Jacobian (S, Q) of the rates."""
        S, Q, P = self.S, self.Q, self.P
        Z, after, steps = ca.MX(ca.horzcat(ca.DM.eye(S), ca.DM(S, P))), [], []
        for k in range(self.K):
            rate, slope, stages = ca.MX(S, 1), ca.MX(S, S + P), []
            total, summed = rate, slope
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                q, G = (a[-Q:, :] + node * self.h * b[-Q:, :] for a, b in ((z, rate), (Z, slope)))
                rate, J = self._jacobian(q, c[:, k], theta)
                slope = J[:, :Q] @ G + ca.horzcat(ca.MX(S, S), J[:, Q:])
                total, summed = total + weight * rate, summed + weight * slope
                stages.append((q, G, J[:, :Q]))
            z, Z = z + exists[k] * self.h * total, Z + exists[k] * self.h * summed
            after.append(Z)
            steps.append(stages)
        return after, steps

    def _slopes(self) -> ca.Function:
        """Of the arguments and the gradient to the interior states: sensitivities of the end, gradient (1, N)."""
        arguments, pull = self._arguments(), ca.MX.sym("pull", self.S, self.K - 1)
        after, _ = self._sweep(*arguments)
        return ca.Function("slopes", [*arguments, pull], [ca.densify(after[-1]), self._slope(after, pull)])

    def _slope(self, after: Sequence[ca.MX], pull: ca.MX) -> ca.MX:
        return ca.densify(sum((pull[:, k].T @ after[k] for k in range(self.K - 1)), ca.MX(1, self.S + self.P)))

    def _curvature(self, own: Sequence[int], weighted: bool, middle: bool) -> ca.Function:
        """Of those and the samples' Hessians, upper triangles by rows, and of the weight of the end where it is
        ``weighted``: the same, and the Hessian's rows of the start and block of the coefficients."""
        arguments, pull = self._arguments(), ca.MX.sym("pull", self.S, self.K - 1)
        (after, steps), S, N, n = self._sweep(*arguments), self.S, self.S + self.P, self.S + len(own)
        rows, columns = np.triu_indices(n)
        cost, weight = ca.MX.sym("cost", len(rows), self.K - 1), ca.MX.sym("weight", S)
        at, chosen = np.empty((n, n), dtype=int), ca.DM(len(own), N)
        at[rows, columns] = at[columns, rows] = np.arange(len(rows))
        for row, column in enumerate(own):
            chosen[row, S + column] = 1.0
        H, adjoint = ca.MX(N, N), weight
        for k in reversed(range(self.K)):
            if k < self.K - 1:
                moved = ca.vertcat(after[k], chosen)
                H += moved.T @ (ca.reshape(cost[at.ravel().tolist(), k], n, n) @ moved)
                adjoint = adjoint + pull[:, k]
            if weighted:
                bent, adjoint = self._bent(arguments, k, steps[k], adjoint, middle)
                H += bent
        inputs = [*arguments, pull, cost, *([weight] if weighted else [])]
        found = after[-1], self._slope(after, pull), H[:S, :], H[S:, S:]
        return ca.Function("curvature", inputs, [ca.densify(a) for a in found])

    def _bent(self, arguments: list[ca.MX], k: int, stages: list, adjoint: ca.MX, middle: bool) -> tuple[ca.MX, ca.MX]:
        """What the second derivatives of the rates in step k add to the Hessian (N, N), by the ``adjoint`` (S,) of its
        end; and the adjoint of its begin.

        With U = 1/2 H_qq G + H_qp of a stage, G being dq: H += G^T U + U^T G + H_pp.
        """
        S, Q, h, (_, c, exists, theta) = self.S, self.Q, self.h, arguments
        multipliers: list[ca.MX] = []
        back, later = adjoint, ca.MX(S, 1)
        for (_, _, J), node, weight in zip(reversed(stages), reversed(NODES), reversed(WEIGHTS), strict=True):
            multipliers.insert(0, exists[k] * (h * weight * adjoint + later))
            pulled = ca.vertcat(ca.MX(S - Q, 1), J.T @ multipliers[0])
            back, later = back + pulled, h * node * pulled
        if middle:
            stages, multipliers = stages[MIDDLE : MIDDLE + 1], [sum(multipliers, ca.MX(S, 1))]
        total = ca.MX(S + self.P, S + self.P)
        for (q, G, _), mu in zip(stages, multipliers, strict=True):
            H = self._hessian(q, c[:, k], theta, mu)
            U = 0.5 * (H[:Q, :Q] @ G) + ca.horzcat(ca.MX(Q, S), H[:Q, Q:])
            GU = G.T @ U
            total += GU + GU.T + ca.diagcat(ca.MX(S, S), H[Q:, Q:])
        return total, back


def _matrices(values: np.ndarray, rows: int) -> np.ndarray:
    """Matrices (M, rows, columns) from their elements by columns (rows columns, M)."""
    return np.ascontiguousarray(values.reshape(-1, rows, values.shape[1]).transpose(2, 1, 0))

"""Shooting intervals without compiled code: one interval as an expression of CasADi, mapped over all of them.

The compiled kernel (``mmg.compile.interval_source``, which has the same chain rule) is tried against these.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from fitting.nlp.sample_cost import Curved, SampleCost
from mmg.compile.batch import BatchFunction
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS, rk4_step


class PortableIntervals:
    """M intervals of a ship with S states and P free coefficients, N = S + P.

    whole: as of ``mmg.compile.interval_source.interval_source``; steps: (M,) of each interval; controls: (K, C, M) held
    over steps of h [s]; group: (M,) of each interval among those of the coefficients theta (G, all).
    """

    def __init__(
        self, whole: ca.Function, steps: np.ndarray, controls: np.ndarray, h: float, group: np.ndarray
    ) -> None:
        self.S, self.Q, self.P = whole.size1_out(0), whole.size1_in(0), whole.size2_out(1) - whole.size1_in(0)
        self.K, self.C, self.M = controls.shape
        self.h, self.group = h, group
        self._held = controls.reshape(-1, self.M), (np.arange(self.K)[:, None] < steps).astype(float)
        given = whole.sx_in()
        k, J, H = whole(*given)
        self._all = whole.numel_in(2)
        self._rates = ca.Function("rates", given[:3], [k], {"cse": True})
        self._jacobian = ca.Function("jacobian", given[:3], [k, J], {"cse": True})
        self._hessian = ca.Function("hessian", given, [ca.triu2symm(H)], {"cse": True})
        self._made: dict[tuple, BatchFunction] = {}

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K - 1, S, M) from start states (S, M) and coefficients (G, all)."""
        end, interior = self._run(("values",), start, theta)
        return end, interior.reshape(self.K - 1, self.S, self.M)

    def linearise(self, start: np.ndarray, theta: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the ends (M, S, N), and gradient (M, N) of what has ``pull`` (K - 1, S, M) to the interior
        states; start, theta: as of ``values``."""
        ends, slope = self._run(("slopes",), start, theta, pull)
        return self._matrices(ends, self.S), slope.T

    def curve(
        self,
        start: np.ndarray,
        theta: np.ndarray,
        cost: SampleCost,
        weight: np.ndarray | None,
        owner: np.ndarray,
        owners: int,
        middle: bool = False,
    ) -> Curved:
        """The same with the Hessian of ``weight`` (S, M) . ends + ``cost`` (weight None: of the cost alone to first
        order in the states), that of the coefficients summed by ``owner`` (M,), of ``owners``; start, theta: as of
        ``values``; middle: as of ``mmg.compile.intervals.IntervalKernel.curve``."""
        kind = ("curvature", tuple(cost.own.tolist()), weight is not None, middle)
        given = (cost.pull, cost.triangles(), *([] if weight is None else [weight]))
        ends, slope, rows, shared = self._run(kind, start, theta, *given)
        found = [self._matrices(a, size) for a, size in ((ends, self.S), (rows, self.S), (shared, self.P))]
        return Curved(found[0], slope.T, found[1], found[2]).of_groups(owner, owners)

    def _matrices(self, values: np.ndarray, rows: int) -> np.ndarray:
        """Matrices (M, rows, columns) from their elements by columns (rows columns, M)."""
        return np.ascontiguousarray(values.reshape(-1, rows, self.M).transpose(2, 1, 0))

    def _run(self, kind: tuple, start: np.ndarray, theta: np.ndarray, *more: np.ndarray) -> list[np.ndarray]:
        """Outputs (elements, M) of the function of this ``kind``, which is made when it is first asked for."""
        if kind not in self._made:
            name, *rest = kind
            self._made[kind] = BatchFunction(getattr(self, f"_{name}")(*rest), None)
        by_interval = theta[0] if len(theta) == 1 else np.ascontiguousarray(theta[self.group].T)
        given = [start, *self._held, by_interval, *(a.reshape(-1, self.M) for a in more)]
        return self._made[kind](*given)

    def _arguments(self) -> list[ca.MX]:
        """Start (S, 1), inputs (C, K), which steps exist (K, 1), and coefficients (all, 1) of one interval."""
        shapes = {"start": (self.S, 1), "inputs": (self.C, self.K), "exists": (self.K, 1), "theta": (self._all, 1)}
        return [ca.MX.sym(name, *shape) for name, shape in shapes.items()]

    def _values(self) -> ca.Function:
        """Of the arguments: end and interior states."""
        z, c, exists, theta = arguments = self._arguments()
        found = []
        for k in range(self.K):
            end = rk4_step(lambda at, _, k=k: self._rates(at[-self.Q :], c[:, k], theta), z, self.h)  # type: ignore[misc]
            z = z + exists[k] * (end - z)
            found.append(exists[k] * z)
        return ca.Function("values", arguments, [z, ca.horzcat(*found[:-1])])

    def _sweep(self, z: ca.MX, c: ca.MX, exists: ca.MX, theta: ca.MX) -> tuple[list[ca.MX], list[list]]:
        """Sensitivities (S, N) after each step; and by step and stage the arguments (Q,) of the rates, their
        sensitivities (Q, N) and the Jacobian (S, Q) of the rates."""
        S, Q, P = self.S, self.Q, self.P
        Z, after, steps = ca.MX(ca.horzcat(ca.DM.eye(S), ca.DM(S, P))), [], []
        for k in range(self.K):
            rate, slope, total, summed, stages = ca.MX(S, 1), ca.MX(S, S + P), 0.0, 0.0, []
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
        multipliers, back, later = [], adjoint, ca.MX(S, 1)
        for (_, _, J), node, weight in zip(reversed(stages), reversed(NODES), reversed(WEIGHTS), strict=True):
            multipliers.insert(0, exists[k] * (h * weight * adjoint + later))
            pulled = ca.vertcat(ca.MX(S - Q, 1), J.T @ multipliers[0])
            back, later = back + pulled, h * node * pulled
        if middle:
            stages, multipliers = stages[MIDDLE : MIDDLE + 1], [sum(multipliers)]
        total = ca.MX(S + self.P, S + self.P)
        for (q, G, _), mu in zip(stages, multipliers, strict=True):
            H = self._hessian(q, c[:, k], theta, mu)
            U = 0.5 * (H[:Q, :Q] @ G) + ca.horzcat(ca.MX(Q, S), H[:Q, Q:])
            GU = G.T @ U
            total += GU + GU.T + ca.diagcat(ca.MX(S, S), H[Q:, Q:])
        return total, back

"""Shooting intervals without compiled code: one interval as an expression of CasADi, mapped over all of them.

The compiled kernel (``mmg.compile.interval_source``, which has the same chain rule) is tried against these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from fitting.nlp.prior import group_sums
from mmg.compile.batch import BatchFunction
from mmg.compile.intervals import Lanes, Wanted
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS, rk4_step


class PortableIntervals:
    """What ``mmg.compile.intervals.IntervalKernel`` does, whose methods say what they take and return; N = S + P, and
    the Q states from S - Q on act.

    whole: as of ``mmg.compile.interval_source.derivatives``.
    """

    def __init__(self, whole: ca.Function) -> None:
        self.S, self.Q, self.P = whole.size1_out(0), whole.size1_in(0), whole.size2_out(1) - whole.size1_in(0)
        self._sizes = whole.numel_in(1), whole.numel_in(2)
        given = whole.sx_in()
        k, J, *H = whole(*given)
        self._rates = BatchFunction(ca.Function("rates", given[:3], [k], {"cse": True}), None)
        self._jacobian = ca.Function("jacobian", given[:3], [k, J], {"cse": True})
        if H:
            self._hessian = ca.Function("hessian", given, [ca.triu2symm(H[0])], {"cse": True})
        self._made: dict[tuple, BatchFunction] = {}  # by kind, number of steps and step

    def values(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, given: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """As of ``IntervalKernel``."""
        inputs, exist, by_interval = self._lane_inputs(lanes, theta)
        z, after = start, []
        for k, controls in enumerate(inputs):

            def rates(at: np.ndarray, part: float, controls: np.ndarray = controls) -> np.ndarray:
                return self._rates.at(at[-self.Q :], _during(controls, part, self._sizes[0]), by_interval)[0]

            z = np.where(exist[k] > 0, rk4_step(rates, z, lanes.h), z)  # an interval that has ended keeps its end
            if given is not None:
                z = np.where(np.isnan(given[k]), z, given[k])
            after.append(exist[k] * z)
        return z, np.array(after[:-1]).reshape(-1, self.S, lanes.M)

    def linearise(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, wanted: Wanted | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As of ``IntervalKernel``."""
        rows, columns = (np.arange(self.S), np.arange(self.S + self.P)) if wanted is None else wanted
        kind = ("slopes", tuple(rows.tolist()), tuple(columns.tolist()), lanes.changes)
        end, ends, slope = self._run(lanes, kind, start, theta, pull)
        return end, _matrices(ends, len(rows)), slope.T

    def gradient(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """As of ``IntervalKernel``."""
        _, ends, slope = self.linearise(lanes, start, theta, pull)
        return slope + (weight.T[:, None] @ ends)[:, 0]

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
        K, M = len(lanes.controls), lanes.M
        if (kind, K, lanes.h) not in self._made:
            self.K, self.h = K, lanes.h
            name, *rest = kind
            self._made[kind, K, lanes.h] = BatchFunction(getattr(self, f"_{name}")(*rest), None)
        inputs, *rest = self._lane_inputs(lanes, theta)
        return self._made[kind, K, lanes.h](start, inputs.reshape(-1, M), *rest, *(a.reshape(-1, M) for a in more))

    def _lane_inputs(self, lanes: Lanes, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Controls (K, C or 2 C, M) of the intervals, which steps exist (K, M), and coefficients (all,) or (all, M)."""
        at = lanes.position
        by_interval = theta[0] if len(theta) == 1 else np.ascontiguousarray(theta[lanes.group[at]].T)
        exist = (np.arange(len(lanes.controls))[:, None] < lanes.steps[at]).astype(float)
        return lanes.controls[..., at], exist, by_interval

    def _arguments(self, changes: bool = False) -> list[ca.MX]:
        """Of one interval: start (S, 1), inputs (C or 2 C, K), which steps exist (K, 1), coefficients (all, 1)."""
        C, every = self._sizes
        shapes = {"start": (self.S, 1), "exists": (self.K, 1), "theta": (every, 1)}
        z, exists, theta = (ca.MX.sym(name, *shape) for name, shape in shapes.items())
        return [z, ca.MX.sym("inputs", 2 * C if changes else C, self.K), exists, theta]

    def _sweep(
        self, arguments: Sequence[ca.MX], columns: Sequence[int] | None = None
    ) -> tuple[ca.MX, list[ca.MX], list[list]]:
        """End (S,); sensitivities (S, N) after each step; and by step and stage the arguments (Q,) of the rates, their
        sensitivities (Q, N) and the Jacobian (S, Q) of the rates. columns: of the N, those wanted (default: all)."""
        (z, c, exists, theta), S, Q, P = arguments, self.S, self.Q, self.P
        wanted = list(range(S + P) if columns is None else columns)
        Z, after, steps = ca.MX(ca.horzcat(ca.DM.eye(S), ca.DM(S, P))[:, wanted]), [], []
        for k in range(self.K):
            rate, slope, stages = ca.MX(S, 1), ca.MX(S, len(wanted)), []
            total, summed = rate, slope
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                # argument of the stage, and its slope
                q, G = (a[-Q:, :] + node * self.h * b[-Q:, :] for a, b in ((z, rate), (Z, slope)))
                rate, J = self._jacobian(q, _during(c[:, k], node, self._sizes[0]), theta)
                slope = J[:, :Q] @ G + ca.horzcat(ca.MX(S, S), J[:, Q:])[:, wanted]  # chain rule: dk = f_q dq + f_p
                total, summed = total + weight * rate, summed + weight * slope
                stages.append((q, G, J[:, :Q]))
            # a step that is not there adds nothing
            z, Z = z + exists[k] * self.h * total, Z + exists[k] * self.h * summed
            after.append(Z)
            steps.append(stages)
        return z, after, steps

    def _slopes(self, rows: Sequence[int], columns: Sequence[int], changes: bool) -> ca.Function:
        """Of the arguments and the gradient to the interior states: end (S,), rows and columns of its sensitivities,
        and columns of the gradient (1, N)."""
        arguments, pull = self._arguments(changes), ca.MX.sym("pull", self.S, self.K - 1)
        end, after, _ = self._sweep(arguments, columns)
        found = [end, after[-1][list(rows), :], self._slope(after, pull)]
        return ca.Function("slopes", [*arguments, pull], [ca.densify(a) for a in found])

    def _slope(self, after: Sequence[ca.MX], pull: ca.MX) -> ca.MX:
        return ca.densify(sum((pull[:, k].T @ after[k] for k in range(self.K - 1)), ca.MX(1, after[-1].size2())))

    def _curvature(self, own: Sequence[int], weighted: bool, middle: bool) -> ca.Function:
        """Of those and the samples' Hessians, upper triangles by rows, and of the weight of the end where it is
        ``weighted``: the same, and the Hessian's rows of the start and block of the coefficients."""
        arguments, pull = self._arguments(), ca.MX.sym("pull", self.S, self.K - 1)
        _, after, steps = self._sweep(arguments)
        S, N, n = self.S, self.S + self.P, self.S + len(own)
        rows, columns = np.triu_indices(n)
        cost, weight = ca.MX.sym("cost", len(rows), self.K - 1), ca.MX.sym("weight", S)
        at, chosen = np.empty((n, n), dtype=int), ca.DM(len(own), N)
        at[rows, columns] = at[columns, rows] = np.arange(len(rows))  # where a pair of variables is among the triangle
        for row, column in enumerate(own):
            chosen[row, S + column] = 1.0
        H, adjoint = ca.MX(N, N), weight
        for k in reversed(range(self.K)):  # adjoints go backwards
            if k < self.K - 1:  # the end itself has no sample: it is a node
                moved = ca.vertcat(after[k], chosen)
                # the sample's Hessian, by the chain rule
                H += moved.T @ (ca.reshape(cost[at.ravel().tolist(), k], n, n) @ moved)
                adjoint = adjoint + pull[:, k]  # the sample pulls on its own state too
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
            multipliers.insert(0, exists[k] * (h * weight * adjoint + later))  # stages are gone through backwards
            pulled = ca.vertcat(ca.MX(S - Q, 1), J.T @ multipliers[0])
            back, later = back + pulled, h * node * pulled
        if middle:
            # the midpoint rule for the bending alone
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


def _during(controls: Any, part: float, C: int) -> Any:
    """Inputs (C, ...) after a ``part`` of a step: the ``controls`` (C, ...), or their means and changes (2 C, ...)."""
    return controls[:C] if controls.shape[0] == C else controls[:C] + (part - 0.5) * controls[C:]

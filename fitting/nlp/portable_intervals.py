"""Shooting intervals without compiled code: the rates and their derivatives by CasADi at all intervals, the chain rule
through the stages of each step by numpy. The compiled kernel (``mmg.compile.interval_source``, which has the same chain
rule) is tried against these.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from fitting.nlp.prior import group_sums
from mmg.compile.batch import BatchFunction
from mmg.compile.intervals import Lanes, Wanted
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS, rk4_step


class _Stage(NamedTuple):
    """Of a stage: arguments of the rates (Q, M), their sensitivities (M, Q, n), Jacobian (M, S, Q) of the rates."""

    q: np.ndarray
    G: np.ndarray
    J: np.ndarray


class PortableIntervals:
    """What ``mmg.compile.intervals.IntervalKernel`` does, whose methods say what they take and return; N = S + P, and
    the Q states from S - Q on act.

    whole: as of ``mmg.compile.interval_source.derivatives``.
    """

    def __init__(self, whole: ca.Function) -> None:
        self.S, self.Q, self.P = whole.size1_out(0), whole.size1_in(0), whole.size2_out(1) - whole.size1_in(0)
        self._inputs, given = whole.numel_in(1), whole.sx_in()
        k, J, *H = whole(*given)
        self._rates = _at_points("rates", given[:3], [k])
        self._jacobian = _at_points("jacobian", given[:3], [k, J])
        if H:
            self._hessian = _at_points("hessian", given, [ca.triu2symm(H[0])])

    def values(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, given: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """As of ``IntervalKernel``."""
        inputs, exist, by_interval = self._lane_inputs(lanes, theta)
        z, after = start, []
        for k, controls in enumerate(inputs):

            def rates(at: np.ndarray, part: float, controls: np.ndarray = controls) -> np.ndarray:
                return self._rates.at(at[-self.Q :], self._during(controls, part), by_interval)[0]

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
        end, after, _ = self._sweep(lanes, start, theta, columns)
        return end, after[-1][:, rows], _slope(after, pull)

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
        S, N, (triangles, own) = self.S, self.S + self.P, cost
        _, after, steps = self._sweep(lanes, start, theta, np.arange(N), keep=weight is not None)
        rows, columns = np.triu_indices(S + len(own))  # of the samples' Hessians, by rows
        chosen = np.broadcast_to(np.eye(N)[S + own], (lanes.M, len(own), N))
        H, adjoint = np.zeros((lanes.M, N, N)), weight
        for k in reversed(range(len(after))):  # adjoints go backwards
            if k < len(triangles):  # the end itself has no sample: it is a node
                sample = np.empty((lanes.M, S + len(own), S + len(own)))
                sample[:, rows, columns] = sample[:, columns, rows] = triangles[k].T
                moved = np.concatenate([after[k], chosen], axis=1)
                H += np.swapaxes(moved, 1, 2) @ (sample @ moved)  # the sample's Hessian, by the chain rule
            if adjoint is not None:
                if k < len(triangles):
                    adjoint = adjoint + pull[k]  # the sample pulls on its own state too
                bent, adjoint = self._bent(lanes, theta, k, steps[k], adjoint, middle)
                H += bent
        shared = group_sums(slot[lanes.position], np.ascontiguousarray(H[:, S:, S:]), int(slot.max()) + 1)
        return after[-1], _slope(after, pull), np.ascontiguousarray(H[:, :S]), shared

    def _lane_inputs(self, lanes: Lanes, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Controls (K, C or 2 C, M) of the intervals, which steps exist (K, M), and coefficients (all,) or (all, M)."""
        at = lanes.position
        by_interval = theta[0] if len(theta) == 1 else np.ascontiguousarray(theta[lanes.group[at]].T)
        exist = (np.arange(len(lanes.controls))[:, None] < lanes.steps[at]).astype(float)
        return lanes.controls[..., at], exist, by_interval

    def _during(self, controls: np.ndarray, part: float) -> np.ndarray:
        """Inputs (C, M) after a ``part`` of a step: the ``controls`` (C, M), or their means and changes (2 C, M)."""
        C = self._inputs
        return controls if len(controls) == C else controls[:C] + (part - 0.5) * controls[C:]

    def _sweep(
        self, lanes: Lanes, start: np.ndarray, theta: np.ndarray, columns: np.ndarray, keep: bool = False
    ) -> tuple[np.ndarray, list[np.ndarray], list[list[_Stage]]]:
        """End (S, M); sensitivities (M, S, n) after each step to those of the N variables in ``columns`` (n,); the
        stages of each step where they are to be kept."""
        inputs, exist, by_interval = self._lane_inputs(lanes, theta)
        S, Q, M, h = self.S, self.Q, lanes.M, lanes.h
        z, Z = start, np.broadcast_to(np.eye(S, S + self.P)[:, columns], (M, S, len(columns)))
        after, steps = list[np.ndarray](), list[list[_Stage]]()
        for controls, there in zip(inputs, exist, strict=True):
            rate, slope, stages = np.zeros((S, 1)), np.zeros((1, 1, 1)), []
            total, summed = rate, slope
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                q, G = (z + node * h * rate)[-Q:], (Z + node * h * slope)[:, -Q:]  # argument, and its slope
                rate, jacobian = self._jacobian.at(q, self._during(controls, node), by_interval)
                J = _matrices(jacobian, S)
                direct = np.concatenate([np.zeros((M, S, S)), J[:, :, Q:]], axis=2)[:, :, columns]
                slope = J[:, :, :Q] @ G + direct  # chain rule: dk = f_q dq + f_p
                total, summed = total + weight * rate, summed + weight * slope
                stages.append(_Stage(q, G, J[:, :, :Q]))
            # a step that is not there adds nothing
            z, Z = z + there * h * total, Z + (there * h)[:, None, None] * summed
            after.append(Z)
            steps += [stages] if keep else []
        return z, after, steps

    def _bent(
        self, lanes: Lanes, theta: np.ndarray, k: int, stages: list[_Stage], adjoint: np.ndarray, middle: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the second derivatives of the rates in step k add to the Hessian (M, N, N), by the ``adjoint`` (S, M) of
        its end; and the adjoint of its begin.

        With U = 1/2 H_qq G + H_qp of a stage, G being dq: H += G^T U + U^T G + H_pp.
        """
        inputs, exist, by_interval = self._lane_inputs(lanes, theta)
        S, Q, N, h = self.S, self.Q, self.S + self.P, lanes.h
        multipliers: list[np.ndarray] = []
        back, later = adjoint, np.zeros_like(adjoint)
        for stage, node, weight in zip(reversed(stages), reversed(NODES), reversed(WEIGHTS), strict=True):
            multipliers.insert(0, exist[k] * (h * weight * adjoint + later))  # stages are gone through backwards
            pulled = np.zeros_like(adjoint)
            pulled[-Q:] = np.einsum("msq,sm->qm", stage.J, multipliers[0])
            back, later = back + pulled, h * node * pulled
        if middle:
            # the midpoint rule for the bending alone
            stages, multipliers = stages[MIDDLE : MIDDLE + 1], [sum(multipliers, np.zeros_like(adjoint))]
        total = np.zeros((lanes.M, N, N))
        for stage, mu in zip(stages, multipliers, strict=True):
            H = _matrices(self._hessian.at(stage.q, inputs[k], by_interval, mu)[0], Q + self.P)
            U = 0.5 * (H[:, :Q, :Q] @ stage.G)
            U[:, :, S:] += H[:, :Q, Q:]
            GU = np.swapaxes(stage.G, 1, 2) @ U
            total += GU + np.swapaxes(GU, 1, 2)
            total[:, S:, S:] += H[:, Q:, Q:]
        return total, back


def _at_points(name: str, arguments: list[ca.SX], results: list[ca.SX]) -> BatchFunction:
    """A function of dense ``results`` by CasADi at many points."""
    return BatchFunction(ca.Function(name, arguments, [ca.densify(a) for a in results], {"cse": True}), None)


def _slope(after: list[np.ndarray], pull: np.ndarray) -> np.ndarray:
    """Gradient (M, n) of a cost of the states ``after`` each step but the last, by its own ``pull`` (K - 1, S, M)."""
    parts = (np.einsum("sm,msn->mn", p, Z) for p, Z in zip(pull, after[:-1], strict=True))
    return sum(parts, np.zeros((len(after[-1]), after[-1].shape[2])))


def _matrices(values: np.ndarray, rows: int) -> np.ndarray:
    """Matrices (M, rows, columns) from their elements by columns (rows columns, M)."""
    return np.ascontiguousarray(values.reshape(-1, rows, values.shape[1]).transpose(2, 1, 0))

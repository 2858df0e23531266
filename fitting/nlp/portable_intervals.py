"""Shooting intervals without compiled code, by numpy and CasADi's own evaluation; compiled ones are tested by these.

Only the right-hand side is symbolic; the chain rule through time is dense linear algebra over all intervals at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from fitting.nlp.group_sums import group_sums
from fitting.nlp.sample_cost import Curved, SampleCost
from mmg.compile.batch import BatchFunction
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS, rk4_step


class Functions:
    """Rates of a ship with their derivatives at many points, interpreted.

    whole: SXFunction (q (Q,), inputs, coefficients, multipliers (S,)) -> rates (S,), their Jacobian (S, Q + P) to q and
    the P free coefficients, upper triangle of the Hessian of multipliers . rates. ``jacobian_at`` and ``hessian_at``:
    row and column of each nonzero.
    """

    def __init__(self, whole: ca.Function) -> None:
        self.S, self.Q = whole.size1_out(0), whole.size1_in(0)
        self.P = whole.size2_out(1) - self.Q
        self._given = whole.sx_in()
        k, J, self._hessian = whole(*self._given)
        self.rates, self.jacobian = self._batch("f_rates", 3, k), self._batch("f_jacobian", 3, k, J)
        both = (np.array(A.sparsity().get_triplet(), dtype=int) for A in (J, self._hessian))
        self.jacobian_at, self.hessian_at = both

    @cached_property
    def hessian(self) -> BatchFunction:
        """Of the multipliers . rates; made when it is first asked for, as it takes longer than the rest together."""
        return self._batch("f_hessian", 4, self._hessian)

    def _batch(self, name: str, arguments: int, *results: ca.SX) -> BatchFunction:
        return BatchFunction(ca.Function(name, self._given[:arguments], list(results), {"cse": True}), None)


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
    S_interior: list[np.ndarray] = field(default_factory=list)
    q: list[np.ndarray] = field(default_factory=list)
    J_q: list[np.ndarray] = field(default_factory=list)
    Q: list[np.ndarray] = field(default_factory=list)


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

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K-1, S, M) from start states (S, M) and all coefficients."""
        z, interior = start.copy(), np.zeros((max(self.K - 1, 0), self.S, self.M))
        for k, m in enumerate(self.active):
            c = self.controls[k, :, :m]
            z[:, :m] = rk4_step(
                lambda at, _, c=c: self.functions.rates.at(at[self.first :], c, theta)[0],  # type: ignore[misc]
                z[:, :m],
                self.h,
            )
            if k < self.K - 1:
                interior[k, :, :m] = z[:, :m]
        return z, interior

    def sweep(self, start: np.ndarray, theta: np.ndarray) -> Sweep:
        """Forward sweep with sensitivities; arguments as in ``values``."""
        z, S = start.copy(), np.zeros((self.M, self.S, self.S + self.P))
        S[:, np.arange(self.S), np.arange(self.S)] = 1.0
        result = Sweep(z, np.zeros((max(self.K - 1, 0), self.S, self.M)), S)
        for k, m in enumerate(self.active):
            self._step(k, z[:, :m], S[:m], theta, result)
            if k < self.K - 1:
                result.interior[k, :, :m] = z[:, :m]
                result.S_interior.append(S[:m].copy())
        return result

    def _step(self, k: int, z: np.ndarray, S: np.ndarray, theta: np.ndarray, result: Sweep) -> None:
        """One Runge-Kutta step of states (S, m) and sensitivities (m, S, S + P), both in place."""
        h, m, first, c = self.h, z.shape[1], self.first, self.controls[k, :, : z.shape[1]]
        rate, slope = np.zeros_like(z), np.zeros_like(S)
        total, summed = np.zeros_like(z), np.zeros_like(S)
        qs, Js = np.empty((4, self.Q, m)), np.empty((m, 4, self.S, self.Q))
        Qs = np.empty((m, 4, self.Q, S.shape[2]))
        rows, columns = self.functions.jacobian_at
        for i, (fraction, weight) in enumerate(zip(NODES, WEIGHTS, strict=True)):
            qs[i] = z[first:] + fraction * h * rate[first:]
            Qs[:, i] = S[:, first:] + fraction * h * slope[:, first:]
            rate, nonzeros = self.functions.jacobian.at(qs[i], c, theta)
            J = np.zeros((m, self.S, self.Q + self.P))
            J[:, rows, columns] = nonzeros.T
            Js[:, i] = J[:, :, : self.Q]
            slope = Js[:, i] @ Qs[:, i]
            slope[:, :, self.S :] += J[:, :, self.Q :]
            total += weight * rate
            summed += weight * slope
        z += h * total
        S += h * summed
        result.q.append(qs)
        result.J_q.append(Js)
        result.Q.append(Qs)

    def slope(self, sweep: Sweep, pull: np.ndarray) -> np.ndarray:
        """Gradient (M, S + P) of the cost of the interior states to start node and coefficients, from that to the
        states (K - 1, S, M)."""
        total = np.zeros((self.M, self.S + self.P))
        for k, S in enumerate(sweep.S_interior):
            total[: len(S)] += (pull[k, :, : len(S)].T[:, None, :] @ S)[:, 0]
        return total

    def curve(
        self, sweep: Sweep, theta: np.ndarray, cost: SampleCost, weight: np.ndarray | None, middle: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Hessian of sum over intervals of weight . end + cost of the interior states.

        weight: (S, M), or None for the cost alone to first order in the states; middle: as of ``Blocks.curve``.
        Returns the rows of the start nodes (M, S, S + P), symmetric within their first S columns, and the block of the
        coefficients of each interval (M, P, P).
        """
        sums = np.zeros((self.M, self.S, self.S + self.P)), np.zeros((self.M, self.P, self.P))
        adjoint = None if weight is None else weight.copy()
        for k in reversed(range(len(self.active))):
            m = self.active[k]
            if k < self.K - 1:
                self._add(sums, *cost.through(k, sweep.S_interior[k]))
            if adjoint is None:
                continue
            if k < self.K - 1:
                adjoint[:, :m] += cost.pull[k, :, :m]
            mu, q, Q = self._adjoints(adjoint[:, :m], sweep.J_q[k]), sweep.q[k], sweep.Q[k]
            if middle:
                mu, q, Q = mu.sum(axis=0)[None], q[MIDDLE : MIDDLE + 1], Q[:, MIDDLE : MIDDLE + 1]
            for i, multipliers in enumerate(mu):
                self._curvature(sums, q[i], self.controls[k, :, :m], theta, multipliers, Q[:, i])
        return sums

    def _add(self, sums: tuple[np.ndarray, np.ndarray], left: np.ndarray, right: np.ndarray) -> None:
        """Adds left^T right (m, S + P, S + P) to the ``sums`` of ``curve``."""
        nodes, shared = sums
        m, size = len(left), self.S
        nodes[:m] += np.swapaxes(left[:, :, :size], 1, 2) @ right
        shared[:m] += np.swapaxes(left[:, :, size:], 1, 2) @ right[:, :, size:]

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
        sums: tuple[np.ndarray, np.ndarray],
        q: np.ndarray,
        c: np.ndarray,
        theta: np.ndarray,
        mu: np.ndarray,
        Q: np.ndarray,
    ) -> None:
        """Adds mu (S, m) . (second derivative of the rates of one stage) by the chain rule to the ``sums`` of
        ``curve``; q: (Q, m) arguments of the stage, Q: (m, Q, S + P) their sensitivities, c: its inputs.

        With U = 1/2 H_qq Q + H_qth: H += Q^T U + U^T Q + H_thth.
        """
        m, width = len(Q), self.Q + self.P
        rows, columns = self.functions.hessian_at
        H = np.zeros((m, width, width))
        H[:, rows, columns] = H[:, columns, rows] = self.functions.hessian.at(q, c, theta, mu)[0].T
        U = 0.5 * (H[:, : self.Q, : self.Q] @ Q)
        U[:, :, self.S :] += H[:, : self.Q, self.Q :]
        self._add(sums, Q, U)
        self._add(sums, U, Q)
        sums[1][:m] += H[:, self.Q :, self.Q :]


class Blocks:
    """All intervals in blocks that fit the processor's cache, each of one group of coefficients.

    functions: of the ship; steps: (M,) of each interval, longest first among those of a group; controls: (K, C, M) held
    over steps of h [s]; group: (M,) of the coefficients (G, all).
    """

    def __init__(
        self,
        functions: Functions,
        steps: np.ndarray,
        controls: np.ndarray,
        h: float,
        group: np.ndarray,
        block: int = 512,
    ) -> None:
        self.P = functions.P
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
        ``values``; middle: second derivatives of the rates are taken once a step, in its middle, with the multipliers
        of all stages."""
        found, shared = [], np.zeros((owners, self.P, self.P))
        for b, s, g in zip(self.blocks, self.slices, self.group, strict=True):
            sweep = b.sweep(start[:, s], theta[g])
            rows, own = b.curve(sweep, theta[g], cost.block(s), None if weight is None else weight[:, s], middle)
            shared += group_sums(owner[s], own, len(shared))
            found.append((sweep.S_end, b.slope(sweep, cost.pull[:, :, s]), rows))
        ends, slope, rows = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Curved(ends, slope, rows, shared)

"""Values, first and second derivatives of many shooting intervals at once.

An interval integrates K Runge-Kutta steps from its start node with inputs held over each step. For all intervals
together this gives the end state and the interior states, their sensitivities with respect to the start node and the
free coefficients, and the Hessian of any weighted sum of them (exact, by adjoints that go back through the stages).
With a C compiler one kernel of the ship does all that (mmg/compile/intervals.py), else CasADi.

y = h(z, theta): the identity for most ships; lags, lever arms, gains and biases of the effects that enter there.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from fitting.nlp.prior import group_sums
from fitting.nlp.windows import Chains
from mmg.compile.batch import LOOP_FLAGS, MORE, BatchFunction, batch_functions, differences, finite_at
from mmg.compile.cache import load_library
from mmg.compile.codegen import EXPORT, c_file
from mmg.compile.intervals import IntervalKernel, Lanes, Wanted, derivatives
from mmg.model import Model
from mmg.runge_kutta import MIDDLE, NODES, WEIGHTS, rk4_step


@dataclass(frozen=True)
class Curved:
    """Second derivatives of intervals: ends (M, S, S + P) sensitivities, slope (M, S + P) of the samples' cost, rows
    (M, S, S + P) of the start nodes, shared (windows or groups, P, P) of the coefficients."""

    ends: np.ndarray
    slope: np.ndarray
    rows: np.ndarray
    shared: np.ndarray


@dataclass
class SampleCost:
    """Derivatives of the cost of the interior states, by step and interval.

    pull: (K-1, S, M) gradient with respect to the state; weight: (K-1, S, M) diagonal of its Hessian; full: instead,
    (K-1, M, S + O, S + O) Hessian with respect to the state and the free coefficients at positions ``own`` (O of them).
    """

    pull: np.ndarray
    weight: np.ndarray
    full: np.ndarray | None = None
    own: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    def triangles(self) -> np.ndarray:
        """Upper triangles of the Hessians, row by row: (K - 1, n (n + 1) / 2, M) for n = S + O."""
        steps, S, M = self.pull.shape
        n = S + len(self.own)
        rows, columns = np.triu_indices(n)
        if self.full is not None:
            return np.ascontiguousarray(np.moveaxis(self.full[:, :, rows, columns], 2, 1))
        triangles = np.zeros((steps, len(rows), M))
        triangles[:, rows == columns] = self.weight  # without instruments columns are states: the Hessian is diagonal
        return triangles


class Measurement:
    """h of a model, for the free coefficients at positions ``free`` among all of them.

    identity: h copies the first six states; the other methods need not be called then. own: positions, among the free
    coefficients, of those that h depends on (O of them). States are (S, m), columns (6, m), coefficients (all,).
    """

    def __init__(self, model: Model, free: np.ndarray, compiled: bool = True) -> None:
        self.S, self.identity, self.own = len(model.states), not model.measured, np.zeros(0, dtype=int)
        if self.identity:
            return
        z, theta = ca.SX.sym("z", self.S), ca.SX.sym("theta", len(model.symbols))
        mu, y = ca.SX.sym("mu", 6), model.columns(z, theta)
        coefficients = ca.vertcat(*[theta[int(i)] for i in free])
        touched = ca.which_depends(y, coefficients, 1) if len(free) else []  # 1: at all, not only nonlinearly
        self.own = np.flatnonzero(touched)
        x = ca.vertcat(z, *[theta[int(free[i])] for i in self.own])
        J, H = ca.densify(ca.jacobian(y, x)), ca.densify(ca.hessian(ca.dot(mu, y), x)[0])
        functions = [
            ca.Function("h_values", [z, theta], [y], {"cse": True}),
            ca.Function("h_jacobian", [z, theta], [J], {"cse": True}),
            ca.Function("h_hessian", [z, theta, mu], [H], {"cse": True}),
        ]
        self._batch = batch_functions(functions, compiled)[0]

    def values(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Logged columns (6, m)."""
        return z[:6] if self.identity else self._batch[0].at(z, theta)[0]

    def jacobian(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """d y / d (z, own coefficients), (m, 6, S + O)."""
        flat = self._batch[1].at(z, theta)[0]
        return np.ascontiguousarray(flat.T.reshape(-1, self.S + len(self.own), 6).swapaxes(1, 2))

    def slope(self, z: np.ndarray, we: np.ndarray, theta: np.ndarray, free: int) -> tuple[np.ndarray, np.ndarray]:
        """Gradient of 1/2 sum w e^2 with respect to states z (m, S) and, directly, the ``free`` coefficients (m, free).

        we: (m, 6) weighted residuals. The latter has one row of zeros if the measurement model depends on none.
        """
        if self.identity:
            return np.hstack([we, np.zeros((len(we), self.S - 6))]), np.zeros((1, free))
        direct = np.zeros((len(we), free))
        pull = (we[:, None, :] @ self.jacobian(z.T, theta))[:, 0]
        direct[:, self.own] = pull[:, self.S :]
        return pull[:, : self.S], direct

    def curvature(self, z: np.ndarray, w: np.ndarray, we: np.ndarray | None, theta: np.ndarray) -> np.ndarray:
        """Hessian of 1/2 sum w e^2 with respect to states z (m, S) and own coefficients, (m, S + O, S + O).

        w, we: (m, 6) weights and weighted residuals; None: to first order in the columns.
        """
        J = self.jacobian(z.T, theta)
        first = np.swapaxes(J, 1, 2) @ (w[:, :, None] * J)
        if we is None:
            return first
        return first + self._batch[2].at(z.T, theta, we.T)[0].T.reshape(first.shape)  # bending of y, by residuals


@dataclass(frozen=True)
class Elimination:
    """The elimination of the nodes of all windows, and the way back, in C: one window after the other, its rows in
    cache. The same as ``fitting.nlp.fisher_information.Eliminated``, and as ``carried`` of the condensing method, which
    are in numpy for what has no compiler."""

    library: ctypes.CDLL

    def eliminated(
        self, chains: Chains, nodes: np.ndarray, node_slope: np.ndarray, maps: np.ndarray, off: np.ndarray,
        inside: tuple[np.ndarray, np.ndarray] | None,
    ) -> tuple[np.ndarray, ...]:  # fmt: skip
        """Rows (W, S, n), slope (W, n), second factor (M, S, n - S), rows (M, S, n) and slope (M, S) ahead: what
        ``Eliminated`` has, from rows (B, S, n) and slopes (B, n) of the nodes, maps (M, S, n) and off (M, S or more) of
        the intervals, and rows (M, S, n) and slopes (M, n) of the samples inside them, or None."""
        (M, S, n), W = maps.shape, len(chains.first) - 1
        given = [_contiguous(a) for a in (nodes, node_slope, *(inside or (None, None)), maps, off)]
        shapes = ((W, S, n), (W, n), (M, S, n - S), (M, S, n), (M, S))
        found = tuple(np.empty(shape) for shape in shapes)
        sizes, row = [ctypes.c_longlong(k) for k in (W, S, n)], ctypes.c_longlong(off.shape[1])
        at = chains.first, chains.number, chains.start, chains.end
        if self.library.eliminate(*sizes, *_pointers(*at), *_pointers(*given), row, *_pointers(*found)):
            raise MemoryError("no memory for the elimination of nodes")
        return found

    def carried(
        self, chains: Chains, maps: np.ndarray, off: np.ndarray, first: np.ndarray, p: np.ndarray | None, nodes: int
    ) -> np.ndarray:
        """Steps (nodes, S) of all nodes from those of the first ones (W, S) and of the coefficients p (W or 1, n - S),
        None for none; maps: (M, S, n), off: (M, S)."""
        (_, S, n), W = maps.shape, len(chains.first) - 1
        given = [_contiguous(a) for a in (maps, off, first, p)]
        steps, sizes = np.zeros((nodes, S)), [ctypes.c_longlong(k) for k in (W, S, n)]
        row = ctypes.c_longlong(n - S if p is not None and len(p) > 1 else 0)  # 0: all windows read the same row
        at = chains.first, chains.number, chains.start, chains.end
        self.library.carry(*sizes, *_pointers(*at), *_pointers(*given), row, *_pointers(steps))
        return steps


def _contiguous(values: np.ndarray | None) -> np.ndarray | None:
    """As C reads them; who calls it keeps the copy until the call has ended."""
    return None if values is None else np.ascontiguousarray(values, dtype=float)


def _pointers(*arrays: np.ndarray | None) -> list[ctypes.c_void_p]:
    """Addresses of ``arrays`` for the C functions, null for None."""
    return [ctypes.c_void_p(None if a is None else a.ctypes.data) for a in arrays]


@cache
def elimination(compiled: bool) -> Elimination | None:
    """The functions, compiled or from the cache; None where that is not possible or not wanted."""
    library = load_library(EXPORT + c_file(__file__, "elimination.c"), LOOP_FLAGS)[0] if compiled else None
    return Elimination(library) if library else None


class _Stage(NamedTuple):
    """Of a stage: arguments of the rates (Q, M), their sensitivities (M, Q, n), Jacobian (M, S, Q) of the rates."""

    q: np.ndarray
    G: np.ndarray
    J: np.ndarray


class PortableIntervals:
    """What ``mmg.compile.intervals.IntervalKernel`` does, without compiled code: the rates and their derivatives by
    CasADi at all intervals, the chain rule through the stages of each step by numpy. The methods of that say what these
    take and return; N = S + P, and the Q states from S - Q on act.

    whole: as of ``mmg.compile.intervals.derivatives``.
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


class Kernels:
    """Right-hand side, Jacobian and Hessian of a ``model`` for its intervals.

    A state has S rows, on the last of which, from ``first`` on, the rates depend. free: positions of the free
    coefficients among all (P of them); compiled: whether to use a C compiler. ``interpreted_because``: why none is.
    """

    def __init__(self, model: Model, free: np.ndarray, compiled: bool = True) -> None:
        self.model, self.free = model, np.asarray(free, dtype=int)
        self.S, self.first = len(model.states), model.first
        q, c = ca.SX.sym("q", self.S - self.first), ca.SX.sym("c", len(model.controls))
        theta = ca.SX.sym("theta", len(model.symbols))
        # zeros: states before ``first`` do not act
        rates = ca.cse(model.rates(ca.vertcat(ca.SX.zeros(self.first), q), c, theta))
        self.whole = derivatives(rates, q, c, theta, self.free, second=True)
        self.interval: IntervalKernel | None = None
        self.interpreted_because = "compilation switched off"
        if compiled:
            self.interval, self.interpreted_because = IntervalKernel.of(
                self.whole, self._tried, f"the equations of {model.ship.name} and their derivatives"
            )
        self.measurement = Measurement(model, self.free, compiled)

    @cached_property
    def portable(self) -> PortableIntervals:
        """The same as the compiled kernel, interpreted."""
        return PortableIntervals(self.whole)

    @property
    def elimination(self) -> Elimination | None:
        """Compiled functions that eliminate nodes, where intervals are compiled."""
        return elimination(self.interval is not None)

    def _tried(self, kernel: IntervalKernel) -> str:
        """What is wrong with a new ``kernel``, "" for nothing: on a few intervals its numbers are those without it."""
        # four windows of unequal intervals; 11 fill no whole number of vectors
        rng, M, K, theta = np.random.default_rng(0), 11, 3, self.model.ship.values
        steps, window = np.array([3] * 6 + [2] * 3 + [1] * 2), np.arange(M) // 3
        both = np.array([theta, theta * 1.01])  # two groups, whose coefficients differ
        controls = 0.1 * rng.standard_normal((K, len(self.model.controls), MORE * M))
        start, weight = 0.1 * rng.standard_normal((2, self.S, MORE * M))
        # no sample behind an end
        pull, curved = rng.standard_normal((2, K - 1, self.S, M)) * (steps > np.arange(1, K)[:, None])[:, None, :]
        derivatives, q = BatchFunction(self.whole, None), start[self.first :]
        finite = np.flatnonzero(finite_at([a for each in both for a in derivatives.at(q, controls[0], each, weight)]))
        if not len(finite):
            return ""  # there is nothing to compare
        chosen = np.resize(finite, M)  # MORE than M were drawn, as some ships have no finite rates at some points
        start, weight, controls = start[:, chosen], weight[:, chosen], controls[..., chosen]
        cost, found = SampleCost(pull, curved), []
        for way in (kernel, self.portable):
            shooting = Shooting(way, steps, controls, 0.1, window % 2, window)
            every = [shooting.hessian(start, both, cost, by_window=by_window) for by_window in (False, True)]
            every += [shooting.hessian(start, both, cost, weight, middle) for middle in (False, True)]
            parts = [part for c in every for part in (c.ends, c.slope, c.rows, c.shared)]
            parts += [shooting.gradient(start, both, pull, weight)]
            found.append([*shooting.values(start, both), *shooting.linearise(start, both, pull), *parts])
        wrong = differences(found[0], found[1], 1e-9)  # by rounding
        return f"its numbers differ from those without compiled code {wrong}" if wrong else ""


class Shooting:
    """All intervals of a problem.

    kernel: compiled or portable, of the ship; steps: (M,) of each interval; controls: (K, C, M) held over steps of h
    [s]; group: (M,) which of the coefficients (G, all) each interval has; window: (M,) to which it belongs.
    """

    def __init__(
        self,
        kernel: IntervalKernel | PortableIntervals,
        steps: np.ndarray,
        controls: np.ndarray,
        h: float,
        group: np.ndarray,
        window: np.ndarray,
    ) -> None:
        self.kernel, self.lanes = kernel, Lanes.of(steps, controls, h, group, window)
        self._group = np.zeros(int(window.max()) + 1, dtype=int)
        self._group[window] = group

    def values(self, start: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End states (S, M) and interior states (K - 1, S, M) from start states (S, M) and all coefficients ``theta``,
        (all,) or by group (G, all)."""
        return self.kernel.values(self.lanes, start, np.atleast_2d(theta))

    def linearise(self, start: np.ndarray, theta: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the ends (M, S, S + P) to start nodes and coefficients, and the gradient (M, S + P) of a
        cost of the interior states whose own gradient is ``pull`` (K - 1, S, M); start, theta: as of ``values``."""
        return self.kernel.linearise(self.lanes, start, np.atleast_2d(theta), pull)[1:]

    def gradient(self, start: np.ndarray, theta: np.ndarray, pull: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Gradient (M, S + P), to start nodes and coefficients, of a cost of the interior states and the ends, whose
        own gradients are ``pull`` (K - 1, S, M) and ``weight`` (S, M); start, theta: as of ``values``."""
        return self.kernel.gradient(self.lanes, start, np.atleast_2d(theta), pull, weight)

    def hessian(
        self,
        start: np.ndarray,
        theta: np.ndarray,
        cost: SampleCost,
        weight: np.ndarray | None = None,
        middle: bool = False,
        by_window: bool = False,
    ) -> Curved:
        """As ``linearise``, and the Hessian of ``weight`` (S, M) . ends + ``cost``, by None that of the cost to first
        order in the states (Gauss-Newton).

        start, theta: as of ``values``; middle: with second derivatives of the rates once a step, in its middle;
        by_window: whether the block of the coefficients is by window, else by group."""
        every, both = np.atleast_2d(theta), (cost.triangles(), cost.own)
        slot, group = (self.lanes.slot, None) if by_window else self._by_group
        ends, slope, rows, shared = self.kernel.curve(self.lanes, start, every, cost.pull, both, weight, slot, middle)
        # a group has a slot in each share of the work
        return Curved(ends, slope, rows, shared if group is None else group_sums(group, shared, len(every)))

    @cached_property
    def _by_group(self) -> tuple[np.ndarray, np.ndarray]:
        """Slots for the sums of each group, and the groups of these."""
        return self.lanes.parts(self._group)

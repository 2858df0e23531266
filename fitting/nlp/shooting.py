"""Values, first and second derivatives of many shooting intervals at once.

An interval integrates K Runge-Kutta steps from its start node with inputs held over each step. For all intervals
together this gives the end state and the interior states, their sensitivities with respect to the start node and the
free coefficients, and the Hessian of any weighted sum of them (exact, by adjoints that go back through the stages).
With a C compiler one kernel of the ship does all that (mmg/compile/interval_source.py), else CasADi.

y = h(z, theta): the identity for most ships; lags, lever arms, gains and biases of the effects that enter there.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from fitting.nlp.prior import group_sums
from fitting.nlp.windows import Chains
from mmg.compile.batch import LOOP_FLAGS, MORE, BatchFunction, batch_functions, differences, finite_at
from mmg.compile.cache import load_library
from mmg.compile.codegen import EXPORT, c_file
from mmg.compile.interval_source import derivatives
from mmg.compile.intervals import IntervalKernel, Lanes
from mmg.model import Model

if TYPE_CHECKING:
    from fitting.nlp.portable_intervals import PortableIntervals


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
        from fitting.nlp.portable_intervals import PortableIntervals  # late: not where there is a compiler

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

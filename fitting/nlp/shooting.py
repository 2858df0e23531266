"""Values, first and second derivatives of many shooting intervals at once.

An interval integrates K Runge-Kutta steps from its start node with inputs held over each step. For all intervals
together this gives the end state and the interior states, their sensitivities with respect to the start node and the
free coefficients, and the Hessian of any weighted sum of them (exact, by adjoints that go back through the stages).
Where there is a C compiler one kernel of the ship does all of that (mmg/compile/interval_source.py), elsewhere CasADi's
virtual machine.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from fitting.nlp.elimination_c import Elimination, elimination
from fitting.nlp.measurement import Measurement
from fitting.nlp.sample_cost import Curved, SampleCost
from mmg.compile.batch import MORE, BatchFunction, differences, finite_at
from mmg.compile.interval_source import derivatives
from mmg.compile.intervals import IntervalKernel, Lanes
from mmg.model import Model

if TYPE_CHECKING:
    from fitting.nlp.portable_intervals import PortableIntervals


class Kernels:
    """Right-hand side, Jacobian and Hessian of a ``model`` for its intervals.

    A state has S rows, on the last of which, from ``first`` on, the rates depend. free: positions of the free
    coefficients among all (P of them); compiled: whether to use a C compiler. ``interpreted_because`` says why there is
    no compiled kernel.
    """

    def __init__(self, model: Model, free: np.ndarray, compiled: bool = True) -> None:
        self.model, self.free = model, np.asarray(free, dtype=int)
        self.S, self.first = len(model.states), model.first
        q, c = ca.SX.sym("q", self.S - self.first), ca.SX.sym("c", len(model.controls))
        theta = ca.SX.sym("theta", len(model.symbols))
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
        rng, M, K, theta = np.random.default_rng(0), 11, 3, self.model.ship.values
        steps, window = np.array([3] * 6 + [2] * 3 + [1] * 2), np.arange(M) // 3
        both = np.array([theta, theta * 1.01])
        controls = 0.1 * rng.standard_normal((K, len(self.model.controls), MORE * M))
        start, weight = 0.1 * rng.standard_normal((2, self.S, MORE * M))
        pull, curved = rng.standard_normal((2, K - 1, self.S, M)) * (steps > np.arange(1, K)[:, None])[:, None, :]
        derivatives, q = BatchFunction(self.whole, None), start[self.first :]
        finite = np.flatnonzero(finite_at([a for each in both for a in derivatives.at(q, controls[0], each, weight)]))
        if not len(finite):
            return ""  # there is nothing to compare
        chosen = np.resize(finite, M)
        start, weight, controls = start[:, chosen], weight[:, chosen], controls[..., chosen]
        cost, found = SampleCost(pull, curved), []
        for way in (kernel, self.portable):
            shooting = Shooting(way, steps, controls, 0.1, window % 2, window)
            both_ways = [shooting.quadratics(start, both, cost, by_window) for by_window in (False, True)]
            both_ways += [shooting.hessian(start, both, cost, weight, middle) for middle in (False, True)]
            parts = [part for c in both_ways for part in (c.ends, c.slope, c.rows, c.shared)]
            found.append([*shooting.values(start, both), *shooting.linearise(start, both, pull), *parts])
        wrong = differences(found[0], found[1], 1e-9)  # by rounding
        return f"its numbers differ from those without compiled code {wrong}" if wrong else ""


class Shooting:
    """All intervals of a problem.

    kernel: compiled or portable, of the ship; steps: (M,) of each interval; controls: (K, C, M) held over steps of h
    [s]; group: (M,) which of the coefficients (G, all) each interval has; window: (M,) to which it belongs. theta: all
    coefficients, (all,) or by group (G, all).
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
        """End states (S, M) and interior states (K - 1, S, M) from start states (S, M) and all coefficients."""
        return self.kernel.values(self.lanes, start, np.atleast_2d(theta))

    def linearise(self, start: np.ndarray, theta: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the ends (M, S, S + P) to start nodes and coefficients, and the gradient (M, S + P) of a
        cost of the interior states whose own gradient is ``pull`` (K - 1, S, M); start, theta: as of ``values``."""
        return self.kernel.linearise(self.lanes, start, np.atleast_2d(theta), pull)[1:]

    def quadratics(self, start: np.ndarray, theta: np.ndarray, cost: SampleCost, by_window: bool = True) -> Curved:
        """The same, and the Hessian of the ``cost`` to first order in the states; start, theta: as of ``values``.

        by_window: whether the Hessian of the coefficients is by window, else by group."""
        return (
            self._curved(start, theta, cost, None, self.lanes.slot) if by_window else self.hessian(start, theta, cost)
        )

    def hessian(
        self,
        start: np.ndarray,
        theta: np.ndarray,
        cost: SampleCost,
        weight: np.ndarray | None = None,
        middle: bool = False,
    ) -> Curved:
        """The same, and the whole Hessian of ``weight`` (S, M) . ends + ``cost``; that of the coefficients by group;
        start, theta: as of ``values``; weight None: as of ``quadratics``; middle: with second derivatives of the rates
        once a step, in its middle."""
        slot, group = self._by_group
        return self._curved(start, theta, cost, weight, slot, middle).of_groups(group, len(np.atleast_2d(theta)))

    def _curved(
        self,
        start: np.ndarray,
        theta: np.ndarray,
        cost: SampleCost,
        weight: np.ndarray | None,
        slot: np.ndarray,
        middle: bool = False,
    ) -> Curved:
        both, every = (cost.triangles(), cost.own), np.atleast_2d(theta)
        return Curved(*self.kernel.curve(self.lanes, start, every, cost.pull, both, weight, slot, middle))

    @cached_property
    def _by_group(self) -> tuple[np.ndarray, np.ndarray]:
        """Slots for the sums of each group, and the groups of these."""
        return self.lanes.parts(self._group)

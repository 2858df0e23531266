"""One time step of a ship and its derivatives, at all samples of a path at once.

The ship is the full model (``candidates.FullModel``), so that one compiled model serves all hypotheses: a hypothesis is
a choice of columns. A latent force X, Y, N acts as the body-fixed force of ``tow``, constant over each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from fitting.nlp.shooting import PortableIntervals
from mmg.compile.batch import batch_functions, differences, finite_points
from mmg.compile.codegen import LANES
from mmg.compile.intervals import IntervalKernel, Lanes, derivatives
from mmg.effects import EFFECTS
from mmg.model import Model, assemble, columns, settled, states_behind
from mmg.ship import Ship

FORCE = ("tow.X", "tow.Y", "tow.N")  # Coefficients of the latent force


@dataclass(frozen=True)
class LinearModel:
    """The model about a path: z+ = end + F dz + G dp + force df, y = logged + H dz + D dp, for the A active states and
    P columns.

    end: (K, R, S) all states; F: (K, R, A, A); G: (K, R, A, P); force: (K, R, A, 3); logged: (K + 1, R, 6);
    H: (K + 1, R, 6, A); observed: (K + 1, R, 6, d) the part of D by the columns ``observing`` (d,), the rest is zero.
    """

    end: np.ndarray
    F: np.ndarray
    G: np.ndarray
    force: np.ndarray
    logged: np.ndarray
    H: np.ndarray
    observed: np.ndarray
    observing: np.ndarray


class TransitionModel:
    """Steps of length h [s] of a ``ship`` with S states and C inputs; compiled: use generated C code.

    symbols: the P coefficients that may be columns, in the order of the ship; late: those of the ship that make inputs
    late, which the model does not do (``acting_inputs``).
    """

    def __init__(self, ship: Ship, symbols: Sequence[str], h: float, compiled: bool = True) -> None:
        self.ship, self.h = ship, h
        self._made_of = (ship, tuple(symbols), h, compiled)
        self.model: Model = assemble(ship, acted=True)
        self.late = tuple(s for s in ship.symbols if "." in s and EFFECTS[s.split(".")[0]].moves)
        chosen = set(symbols) | set(FORCE)
        self.symbols = tuple(s for s in ship.symbols if s in chosen)
        self.at = np.array([ship.symbols.index(s) for s in self.symbols])
        self.S, self.C, self.P = len(self.model.states), len(self.model.controls), len(self.symbols)
        self.force = np.array([ship.symbols.index(s) for s in FORCE])
        self._force_columns = np.array([self.symbols.index(s) for s in FORCE])
        every = ca.SX.sym("theta", len(ship.symbols))
        q, c, force = (ca.SX.sym(name, n) for name, n in (("q", self.S), ("c", self.C), ("force", len(FORCE))))
        pushed = ca.SX(every)  # a copy: += would change the symbols themselves
        pushed[self.force.tolist()] += force
        what = f"the equations of {ship.name} with all effects"
        whole = derivatives(
            ca.cse(self.model.rates(q, c, pushed)), q, ca.vertcat(c, force), every, self.at, second=False
        )
        kernel, self.interpreted_because = None, "compilation switched off"
        if compiled:
            kernel, self.interpreted_because = IntervalKernel.of(whole, partial(step_faults, whole), what)
        self._intervals = kernel or PortableIntervals(whole)
        rates, self._rates_at = self._derivatives(self.model.rates(q, c, every), [q, c, every], self.force)
        logged, self._logged_at = self._derivatives(self.model.columns(q, every), [q, every], self.at)
        functions = [
            ca.Function(f"{name}_{order}", *f, {"cse": True})
            for name, pair in (("rates", rates), ("logged", logged))
            for order, f in zip(("jacobian", "hessian"), pair, strict=True)
        ]
        six, own = ca.SX.sym("six", 6), ca.SX.sym("own", len(self.model.measured_by))
        functions += [
            ca.Function("initial", [six, c, every], [ca.densify(self.model.initial(six, c, every))], {"cse": True}),
            ca.Function("columns", [q, own], [ca.densify(self.model.columns_by(q, own))], {"cse": True}),
        ]
        made, _ = batch_functions(functions, kernel is not None, what)
        self._rates, self._rates_hessian, self._logged, self._logged_hessian, self._initial, self._columns = made

    def __reduce__(self) -> tuple:
        """Built again in another process, where the compiled code comes from the cache."""
        return TransitionModel, self._made_of

    def _derivatives(
        self, value: ca.SX, given: Sequence[ca.SX], by: np.ndarray
    ) -> tuple[list[tuple[Sequence[ca.SX], list[ca.SX]]], tuple[np.ndarray, np.ndarray]]:
        """Arguments and results of two functions of what is ``given``, states first and all coefficients last: a
        ``value`` and its Jacobian by states and the coefficients ``by``; the gradient by columns of a weighted sum of
        the nonzeros of that Jacobian. Returns them with the rows and columns of these nonzeros."""
        states, theta = given[0], given[-1]
        J = ca.jacobian(value, ca.vertcat(states, *[theta[int(i)] for i in by]))
        weight = ca.SX.sym("weight", J.nnz())
        gradient = ca.gradient(ca.dot(weight, J.nz[:]), ca.vertcat(*[theta[int(i)] for i in self.at]))
        rows, places = (np.array(a, dtype=int) for a in J.sparsity().get_triplet())
        return [(given, [value, J]), ([*given, weight], [ca.densify(gradient)])], (rows, places)

    def settled(self, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) logged as ``six`` (6, M) under ``controls`` (C, M), memory states settled; theta: coefficients
        (all,) or by window (all, R)."""
        return states_behind(self.model, six, controls, theta, lambda *at: self._initial.at(*at)[0], self._columns_at)

    def _columns_at(self, z: np.ndarray, own: np.ndarray) -> np.ndarray:
        return self._columns.at(z, own)[0]

    def coefficients(self, theta: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Coefficients by point (all, M) with the latent ``force`` (3, M) [N, N, N m] added to that of ``tow``.

        theta: (all,), or (all, R) by window where the points are K times those of R windows.
        """
        every = spread(theta, force.shape[1])
        every[self.force] += force  # (3, M) on those of the coefficients (all, M)
        return every

    def advance(self, z: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) a step after z (S, M) under ``controls``, inputs (C, M) or with their changes behind (2 C, M);
        theta: coefficients (all,) or (all, M)."""
        lanes = self._lanes(controls[None], np.zeros((1, 3, z.shape[1])), _groups(theta, np.arange(z.shape[1])))
        return self._intervals.values(lanes, z, np.atleast_2d(theta.T))[0]

    def _lanes(self, inputs: np.ndarray, force: np.ndarray, group: np.ndarray) -> Lanes:
        """M intervals of K steps with ``inputs`` (K, C, M), or with their changes behind them (K, 2 C, M), and latent
        ``force`` (K, 3, M); group: (M,) which coefficients each has."""
        M, changes = len(group), inputs.shape[1] > self.C
        parts = [inputs[:, : self.C], force, *([inputs[:, self.C :], np.zeros_like(force)] if changes else [])]
        steps, slot = np.full(M, len(inputs)), np.zeros(M, dtype=int)
        return Lanes.of(steps, np.concatenate(parts, axis=1), self.h, group, slot, changes)

    def logged(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Logged columns (K + 1, R, 6) of a path z (K + 1, R, S); theta: coefficients (all,) or by window (all, R)."""
        return columns(self.model, z.swapaxes(1, 2), theta, self._columns_at).swapaxes(1, 2)

    def with_passive_states(
        self, z: np.ndarray, inputs: np.ndarray, theta: np.ndarray, force: np.ndarray, passive: np.ndarray
    ) -> np.ndarray:
        """The path z (K + 1, R, S) with its ``passive`` states, on which nothing depends, simulated; first settled.

        inputs: (K, R, C), or with their changes (K, R, 2 C); theta: coefficients (all,) or (all, R); force: (K, R, 3)
        latent [N, N, N m], whose further rows are not used.
        """
        z = z.copy()
        z[0][:, passive] = settled(self.model, z[0][:, :6].T, inputs[0].T[: self.C], theta).T[:, passive]
        return self.follow(z, inputs, theta, passive, force=force[: len(inputs)])

    def follow(
        self,
        z: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        carried: np.ndarray | None = None,
        whole: np.ndarray | None = None,
        force: np.ndarray | None = None,
    ) -> np.ndarray:
        """Paths (K + 1, R, S) simulated from the first states of z (K + 1, R, S).

        inputs, theta: as of ``linearise``; carried: positions of the states that are simulated, the others stay as
        given (default: all); whole: (K, R) steps after which all states are the simulated ones; force: (K, R, 3) latent
        [N, N, N m], or None.
        """
        K, R = inputs.shape[:2]
        given = None
        if carried is not None:
            calculated = np.zeros((K, R, self.S), dtype=bool)
            calculated[..., carried] = True
            if whole is not None:
                calculated[whole] = True
            given = np.where(calculated, np.nan, z[1:]).swapaxes(1, 2)  # nan: the kernel takes what it has simulated
        push = np.zeros((K, 3, R)) if force is None else force.swapaxes(1, 2)
        lanes = self._lanes(inputs.swapaxes(1, 2), push, _groups(theta, np.arange(R)))
        end, interior = self._intervals.values(lanes, z[0].T, np.atleast_2d(theta.T), given)
        return np.concatenate([z[:1], interior.swapaxes(1, 2), end.T[None]])

    def linearise(
        self,
        z: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        force: np.ndarray,
        columns: np.ndarray,
        active: np.ndarray,
        count: np.ndarray | None = None,
    ) -> LinearModel:
        """The model about a path z (K + 1, R, S) with ``inputs`` (K, R, C), or with their changes over each step behind
        them (K, R, 2 C), and latent ``force`` (K, R, 3).

        theta: coefficients (all,) or (all, R); columns: (P,) positions in ``symbols`` to differentiate by; active: (A,)
        positions of states, which must not depend on the others; count: (R,) steps of each window that are wanted, of
        the others it says nothing (default: all).
        """
        (K, R), A, P, S = inputs.shape[:2], len(active), len(columns), self.S
        # once each, sorted
        each, where = np.unique(np.concatenate([columns, self._force_columns]), return_inverse=True)
        exist = np.flatnonzero(np.arange(K)[:, None] < (K if count is None else count) * np.ones(R))
        start, held, push = (a.reshape(K * R, -1)[exist].T for a in (z[:-1], inputs, force))
        # each step of each window is an interval
        lanes = self._lanes(held[None], push[None], _groups(theta, exist % R))
        wanted = active, np.concatenate([active, S + each])
        ends = self._intervals.linearise(lanes, start, np.atleast_2d(theta.T), np.zeros((0, S, len(exist))), wanted)
        J = ends[1]
        parts = [ends[0].T, J[..., :A], J.take(A + where[:P], axis=2), J.take(A + where[P:], axis=2)]
        if len(exist) < K * R:
            parts = [_spread_rows(a, exist, K * R) for a in parts]
        end, F, G, by_force = (a.reshape(K, R, *a.shape[1:]) for a in parts)
        return LinearModel(end, F, G, by_force, *self._observed(z, theta, columns, active))

    def _observed(
        self, z: np.ndarray, theta: np.ndarray, columns: np.ndarray, active: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``logged``, ``H``, ``observed`` and ``observing`` of a ``LinearModel`` along the path z (K + 1, R, S)."""
        (K1, R), (rows, places) = z.shape[:2], self._logged_at
        observing = np.flatnonzero(np.isin(self.S + columns, places))
        wanted = np.concatenate([active, self.S + columns[observing]])
        at, kept = np.nonzero(places[:, None] == wanted)
        y, nonzeros = self._logged.at(z.reshape(K1 * R, -1).T, _of(theta, np.tile(np.arange(R), K1)))
        J = np.zeros((K1 * R, 6, len(wanted)))
        J[:, rows[at], kept] = nonzeros[at].T
        J = J.reshape(K1, R, 6, -1)
        return y.T.reshape(K1, R, 6), J[..., : len(active)], J[..., len(active) :], observing

    def rates(self, z: np.ndarray, c: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates (M, S), and their Jacobian (M, S, S + 3) by states and latent force, at z (S, M), inputs c (C, M),
        theta (all, M)."""
        rate, nonzeros = self._rates.at(z, c, theta)
        J = np.zeros((z.shape[1], self.S, self.S + 3))
        J[(slice(None), *self._rates_at)] = nonzeros.T
        return rate.T, J

    def logdet_gradient(
        self,
        z: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        force: np.ndarray,
        weight: np.ndarray,
        weight_logged: np.ndarray,
        columns: np.ndarray,
        active: np.ndarray,
    ) -> np.ndarray:
        """Derivative (R, P) by the ``columns``, window by window, of a weighted sum of the Jacobians of steps and
        logged columns (second derivatives of the model, contracted).

        weight: (K, R, A, A + 3) of the Jacobian d rates / d (active states, latent force) at the middle of each step;
        weight_logged: (K + 1, R, 6, A); z, inputs, theta, force, active: as of ``linearise``.
        """
        R, place = np.arange(inputs.shape[1]), self._places(active)
        k, r, of_rates = _weights(weight, *(place[at] for at in self._rates_at))
        rates = self._rates_hessian.at(*self._middles(z, inputs, theta, force, k, r), of_rates)[0]
        sums = (r == R[:, None]) @ rates.T  # by window
        rows, places = self._logged_at
        k, r, of_logged = _weights(weight_logged, rows, np.where(places < self.S, place[places], -1))
        logged = self._logged_hessian.at(z[k, r].T, _of(theta, r), of_logged)[0]
        return np.asarray(sums + (r == R[:, None]) @ logged.T)[:, columns]

    def weighted_rates(
        self,
        z: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        force: np.ndarray,
        weight: np.ndarray,
        active: np.ndarray,
    ) -> np.ndarray:
        """Sum (R,) over the steps of each window of the Jacobian of the rates by states and latent force in the middle
        of the step, times ``weight`` (K, R, A, A + 3); z, inputs, theta, force, active: as of ``linearise``."""
        place = self._places(active)
        k, r, of_rates = _weights(weight, *(place[at] for at in self._rates_at))
        found = self._rates.at(*self._middles(z, inputs, theta, force, k, r))[1]
        return np.bincount(r, (found * of_rates).sum(axis=0), inputs.shape[1])

    def _places(self, active: np.ndarray) -> np.ndarray:
        """Place of each state and symbol among the ``active`` states (A,) and the latent force, -1 for none."""
        place = np.full(self.S + self.P, -1)
        place[active], place[self.S : self.S + 3] = np.arange(len(active)), len(active) + np.arange(3)
        return place

    def _middles(
        self, z: np.ndarray, inputs: np.ndarray, theta: np.ndarray, force: np.ndarray, k: np.ndarray, r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (S, M), inputs (C, M) and coefficients (all, M) in the middle of steps k (M,) of windows r (M,), by
        the midpoint rule."""
        middle = 0.5 * (z[k, r] + z[k + 1, r]).T
        return middle, inputs[k, r, : self.C].T, self.coefficients(_of(theta, r), force[k, r].T)


def _weights(weight: np.ndarray, row: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grid times (M,) and windows (M,) of the points where one of ``weight`` (K, R, rows, columns) is not zero, and
    there those of the nonzeros at ``row`` and ``column``, (nonzeros, M); 0 where one of these is -1."""
    k, r = np.nonzero(weight.any(axis=(2, 3)))
    source = np.where((row >= 0) & (column >= 0), row * weight.shape[3] + column, -1)
    return k, r, np.where(source >= 0, weight[k, r].reshape(len(k), -1)[:, source], 0.0).T


def _of(theta: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Coefficients ``theta`` (all,), or (all, R) by window at points of a ``window`` (M,): (all, M)."""
    return theta[:, window] if theta.ndim > 1 else theta


def _spread_rows(rows: np.ndarray, at: np.ndarray, count: int) -> np.ndarray:
    """An array of ``count`` rows that has ``rows`` at these places, and 0 elsewhere."""
    whole = np.zeros((count, *rows.shape[1:]))
    whole[at] = rows
    return whole


def _groups(theta: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Which coefficients each interval of a ``window`` has, of ``theta`` (all,) or by window (all, R)."""
    return window if theta.ndim > 1 else np.zeros_like(window)


def step_faults(whole: ca.Function, kernel: IntervalKernel) -> str:
    """What is wrong with two steps of a new ``kernel`` of the function ``whole`` of ``derivatives``, "" for nothing."""
    M, S = LANES + 1, kernel.S
    (q, c, theta), _ = finite_points(whole, M, 0)
    controls = np.repeat(np.vstack([c, 0.1 * c])[None], 2, axis=0)
    lanes = Lanes.of(np.full(M, 2), controls, 1e-3, np.arange(M), np.zeros(M, dtype=int), True)
    given = np.full((2, S, M), np.nan)
    given[0, 0] = q[0]  # one state is given, so that both ways are tried
    pull = np.random.default_rng(0).standard_normal((1, S, M))
    found = [
        [*way.values(lanes, q, theta.T, given), *way.linearise(lanes, q, theta.T, pull)]
        for way in (kernel, PortableIntervals(whole))
    ]
    wrong = differences(found[0], found[1], 1e-9)  # by rounding
    return f"its steps differ from those without compiled code {wrong}" if wrong else ""


def spread(theta: np.ndarray, points: int) -> np.ndarray:
    """Coefficients (all, points) from ``theta`` (all,), or from (all, R) of R windows that repeat up to ``points``."""
    return (
        np.tile(theta, (1, points // theta.shape[1])) if theta.ndim > 1 else np.repeat(theta[:, None], points, axis=1)
    )

"""One time step of a ship and its derivatives, at all samples of a path at once.

The ship is the full model (``candidates.FullModel``), so that one compiled model serves all hypotheses: a hypothesis is
a choice of columns. A latent force X, Y, N acts as the body-fixed force of ``tow``, constant over each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mmg.compile import paths as along
from mmg.compile.batch import batch_functions
from mmg.compile.paths import Entries, WindowPaths, advanced, pushed, spread_over
from mmg.effects import EFFECTS
from mmg.model import Model, assemble, settled, states_behind
from mmg.ship import Ship

FORCE = ("tow.X", "tow.Y", "tow.N")
"""Coefficients of the latent force."""


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

    @property
    def D(self) -> np.ndarray:
        """All of D, (K + 1, R, 6, P)."""
        D = np.zeros((*self.logged.shape, self.G.shape[3]))
        D[..., self.observing] = self.observed
        return D


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
        q, c, every = (ca.SX.sym(name, n) for name, n in (("q", self.S), ("c", self.C), ("theta", len(ship.symbols))))
        rates = self._derivatives("rates", self.model.rates(q, c, every), [q, c, every], self.force)
        logged = self._derivatives("logged", self.model.columns(q, every), [q, every], [])
        (functions, (self._rows, self._columns), self._rate_hessian_at) = rates
        functions, self._logged_at, self._logged_hessian_at = [*functions, *logged[0]], logged[1], logged[2]
        batch, self.interpreted_because = batch_functions(
            functions, compiled, f"the equations of {ship.name} with all effects"
        )
        (
            self._rates,
            self._jacobian,
            self._rate_hessian,
            self._logged_columns,
            self._logged_jacobian,
            self._logged_hessian,
        ) = batch

    def __reduce__(self) -> tuple:
        """Built again in another process, where the compiled code comes from the cache."""
        return TransitionModel, self._made_of

    def _derivatives(
        self, name: str, value: ca.SX, given: Sequence[ca.SX], by: Sequence[int] | np.ndarray
    ) -> tuple[list[ca.Function], tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Functions of what is ``given``, states first and all coefficients last: a ``value``; that and its Jacobian by
        states and columns; the gradient by columns of a weighted sum of its Jacobian by states and the coefficients
        ``by``. Returns them with the rows and columns of the nonzeros of both Jacobians."""
        states, theta = given[0], given[-1]
        own = ca.vertcat(*[theta[int(i)] for i in self.at])
        J = ca.jacobian(value, ca.vertcat(states, own))
        B = ca.jacobian(value, ca.vertcat(states, *[theta[int(i)] for i in by]))
        weight = ca.SX.sym("weight", B.nnz())
        gradient = ca.densify(ca.gradient(ca.dot(weight, B.nz[:]), own))
        functions = [
            ca.Function(f"d_{name}", given, [value], {"cse": True}),
            ca.Function(f"d_{name}_jacobian", given, [value, J], {"cse": True}),
            ca.Function(f"d_{name}_hessian", [*given, weight], [gradient], {"cse": True}),
        ]
        return functions, _nonzeros_at(J), _nonzeros_at(B)

    def settled(self, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) logged as ``six`` (6, M) under ``controls`` (C, M), memory states settled; theta: coefficients
        (all,) or by window (all, R)."""
        return states_behind(self.model, six, controls, theta)

    def coefficients(self, theta: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Coefficients by point (all, M) with the latent ``force`` (3, M) [N, N, N m] added to that of ``tow``.

        theta: (all,), or (all, R) by window where the points are K times those of R windows.
        """
        return pushed(theta, force, self.force, force.shape[1])

    def advance(self, z: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) a step after z (S, M) under ``controls``, inputs (C, M) or with their changes behind (2 C, M);
        theta: coefficients (all,) or (all, M)."""
        return advanced(self._rates, z, controls, theta, self.h, self.C)

    def logged(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Logged columns (K + 1, R, 6) of a path z (K + 1, R, S); theta: coefficients (all,) or by window (all, R)."""
        rows, R = z.shape[:2]
        every = spread(theta, rows * R) if theta.ndim > 1 else theta
        (y,) = self._logged_columns.at(np.ascontiguousarray(z.reshape(rows * R, -1).T), every)
        return y.T.reshape(rows, R, 6)

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
        marked = np.full(self.S, carried is None)
        marked[[] if carried is None else carried] = True
        marks = np.zeros((K, R), dtype=bool) if whole is None else whole
        paths = WindowPaths(z, inputs, theta, self.h, self.C, force, self.force)
        return along.follow(paths, self._rates, marked, marks)

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
        each, where = np.unique(np.concatenate([columns, self._force_columns]), return_inverse=True)
        sensed = np.intersect1d(columns, self._logged_at[1] - self.S)
        observing = np.flatnonzero(np.isin(columns, sensed))
        A, P, S = len(active), len(columns), self.S
        of_steps, of_logged = (_places(S, self.P, active, some) for some in (each, sensed))
        steps = Entries.chosen((self._rows, self._columns), *of_steps)
        logged = Entries.chosen(self._logged_at, np.arange(6), of_logged[1])
        paths = WindowPaths(z, inputs, theta, self.h, self.C, force, self.force, count)
        end, F, G, by_force = along.steps(paths, self._jacobian, steps, A, A + where[:P], A + where[P:])
        y, H, D = along.logged(paths, self._logged_jacobian, logged, A, len(sensed))
        D = D[..., np.searchsorted(sensed, columns[observing])]
        return LinearModel(end, F, G, by_force, y, H, D, observing)

    def rates(self, z: np.ndarray, c: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates (M, S), and their Jacobian (M, S, S + 3) by states and latent force, at z (S, M), inputs c (C, M),
        theta (all, M)."""
        rate, nonzeros = self._jacobian.at(z, c, theta)
        place = np.full(self.S + self.P, -1)
        place[: self.S], place[self.S + self._force_columns] = np.arange(self.S), self.S + np.arange(3)
        own = np.flatnonzero(place[self._columns] >= 0)
        J = np.zeros((z.shape[1], self.S, self.S + 3))
        J[:, self._rows[own], place[self._columns[own]]] = nonzeros[own].T
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
        A, S = len(active), self.S
        place = np.full(S + 3, -1)
        place[active], place[S:] = np.arange(A), A + np.arange(3)
        result = np.zeros((z.shape[1], self.P))
        paths = WindowPaths(z, inputs, theta, self.h, self.C, force, self.force)
        for function, of_rates, at, given in (
            (self._rate_hessian, True, self._rate_hessian_at, weight),
            (self._logged_hessian, False, self._logged_hessian_at, weight_logged),
        ):
            row, column = place[at[0]] if of_rates else at[0], place[at[1]]
            source = np.where((row >= 0) & (column >= 0), row * given.shape[3] + column, -1)
            result += along.weighted(paths, function, of_rates, given, source)
        return result[:, columns]


def _places(S: int, P: int, active: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place of each of S states among the ``active`` ones, and of each of them and of P coefficients among the active
    states and ``columns``; -1: not among them."""
    row, column = np.full(S, -1), np.full(S + P, -1)
    row[active] = column[active] = np.arange(len(active))
    column[S + columns] = len(active) + np.arange(len(columns))
    return row, column


def spread(theta: np.ndarray, points: int) -> np.ndarray:
    """Coefficients (all, points) from ``theta`` (all,), or from (all, R) of R windows that repeat up to ``points``."""
    return spread_over(theta, points)


def _nonzeros_at(matrix: ca.SX) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the structural nonzeros."""
    rows, columns = (np.array(a, dtype=int) for a in matrix.sparsity().get_triplet())
    return rows, columns

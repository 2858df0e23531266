"""One time step of a ship and its derivatives, at all samples of a path at once.

The ship is the full model (``candidates.FullModel``), so that one compiled model serves all hypotheses: a hypothesis is
a choice of columns. A latent force X, Y, N acts as the body-fixed force of ``tow``, constant over each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mmg.compile.batch import BatchFunction, batch_functions
from mmg.model import Model, assemble, settled, states_behind
from mmg.runge_kutta import NODES, WEIGHTS, rk4_step
from mmg.ship import Ship

FORCE = ("tow.X", "tow.Y", "tow.N")
BLOCK = 256
"""Points of a block: its arrays stay in the processor's cache."""


@dataclass(frozen=True)
class LinearModel:
    """The model about a path: z+ = end + F dz + G dp + force df, y = logged + H dz + D dp, for the A active states and
    P columns.

    end: (K, R, S) all states; F: (K, R, A, A); G: (K, R, A, P); force: (K, R, A, 3); logged: (K + 1, R, 6);
    H: (K + 1, R, 6, A); D: (K + 1, R, 6, P).
    """

    end: np.ndarray
    F: np.ndarray
    G: np.ndarray
    force: np.ndarray
    logged: np.ndarray
    H: np.ndarray
    D: np.ndarray


class TransitionModel:
    """Steps of length h [s] of a ``ship`` with S states and C inputs; compiled: use generated C code.

    symbols: the P coefficients that may be columns, in the order of the ship.
    """

    def __init__(self, ship: Ship, symbols: Sequence[str], h: float, compiled: bool = True) -> None:
        self.ship, self.h = ship, h
        self._made_of = (ship, tuple(symbols), h, compiled)
        self.model: Model = assemble(ship)
        chosen = set(symbols) | set(FORCE)
        self.symbols = tuple(s for s in ship.symbols if s in chosen)
        self.at = np.array([ship.symbols.index(s) for s in self.symbols])
        self.S, self.C, self.P = len(self.model.states), len(self.model.controls), len(self.symbols)
        self.force = np.array([ship.symbols.index(s) for s in FORCE])
        self._force_columns = np.array([self.symbols.index(s) for s in FORCE])
        functions = [*self._rate_functions(), *self._logged_functions()]
        batch, self.interpreted_because = batch_functions(functions, compiled)
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

    def _rate_functions(self) -> list[ca.Function]:
        """Rates; their Jacobian by states and columns; gradient by columns of a weighted sum of that by the states."""
        q, c = ca.SX.sym("q", self.S), ca.SX.sym("c", self.C)
        theta = ca.SX.sym("theta", len(self.ship.symbols))
        k = self.model.rates(q, c, theta)
        own = ca.vertcat(*[theta[int(i)] for i in self.at])
        J = ca.jacobian(k, ca.vertcat(q, own))
        self._rows, self._columns = (np.array(a, dtype=int) for a in J.sparsity().get_triplet())
        B = ca.jacobian(k, ca.vertcat(q, *[theta[int(i)] for i in self.force]))
        self._rate_hessian_at = tuple(np.array(a, dtype=int) for a in B.sparsity().get_triplet())
        weight = ca.SX.sym("weight", B.nnz())
        logdet_gradient = ca.densify(ca.gradient(ca.dot(weight, _nonzeros(B)), own))
        options = {"cse": True}
        return [
            ca.Function("d_rates", [q, c, theta], [k], options),
            ca.Function("d_jacobian", [q, c, theta], [k, J], options),
            ca.Function("d_rate_hessian", [q, c, theta, weight], [logdet_gradient], options),
        ]

    def _logged_functions(self) -> list[ca.Function]:
        """The same of the logged columns."""
        z, theta = ca.SX.sym("z", self.S), ca.SX.sym("theta", len(self.ship.symbols))
        y = self.model.columns(z, theta)
        own = ca.vertcat(*[theta[int(i)] for i in self.at])
        J = ca.jacobian(y, ca.vertcat(z, own))
        self._logged_at = tuple(np.array(a, dtype=int) for a in J.sparsity().get_triplet())
        H = ca.jacobian(y, z)
        self._logged_hessian_at = tuple(np.array(a, dtype=int) for a in H.sparsity().get_triplet())
        weight = ca.SX.sym("weight", H.nnz())
        logdet_gradient = ca.densify(ca.gradient(ca.dot(weight, _nonzeros(H)), own))
        options = {"cse": True}
        return [
            ca.Function("d_logged", [z, theta], [y], options),
            ca.Function("d_logged_jacobian", [z, theta], [y, J], options),
            ca.Function("d_logged_rate_hessian", [z, theta, weight], [logdet_gradient], options),
        ]

    def settled(self, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) logged as ``six`` (6, M) under ``controls`` (C, M), memory states settled; theta: coefficients
        (all,) or by window (all, R)."""
        return states_behind(self.model, six, controls, theta)

    def coefficients(self, theta: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Coefficients by point (all, M) with the latent ``force`` (3, M) [N, N, N m] added to that of ``tow``.

        theta: (all,), or (all, R) by window where the points are K times those of R windows.
        """
        every = spread(theta, force.shape[1]).copy()
        every[self.force] += force
        return every

    def advance(self, z: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) a step after z (S, M) under ``controls``, inputs (C, M) or with their changes behind (2 C, M);
        theta: coefficients (all,) or (all, M)."""
        return rk4_step(lambda state, part: _at(self._rates, state, self._during(controls, part), theta)[0], z, self.h)

    def _during(self, controls: np.ndarray, part: float) -> np.ndarray:
        """Inputs (C, M) after a part of the step; controls: as of ``advance``."""
        mean, change = controls[: self.C], controls[self.C :]
        return mean + (part - 0.5) * change if len(change) else mean

    def logged(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Logged columns (K + 1, R, 6) of a path z (K + 1, R, S); theta: coefficients (all,) or by window (all, R)."""
        rows, R = z.shape[:2]
        every = spread(theta, rows * R) if theta.ndim > 1 else theta
        return _at(self._logged_columns, np.ascontiguousarray(z.reshape(rows * R, -1).T), every)[0].T.reshape(
            rows, R, 6
        )

    def with_passive_states(
        self, z: np.ndarray, inputs: np.ndarray, theta: np.ndarray, force: np.ndarray, passive: np.ndarray
    ) -> np.ndarray:
        """The path z (K + 1, R, S) with its ``passive`` states, on which nothing depends, simulated; first settled.

        inputs: (K, R, C), or with their changes (K, R, 2 C); theta: coefficients (all,) or (all, R); force: (K, R, 3)
        latent [N, N, N m].
        """
        z = z.copy()
        z[0][:, passive] = settled(self.model, z[0][:, :6].T, inputs[0].T[: self.C], theta).T[:, passive]
        for k in range(len(inputs)):
            end = self.advance(z[k].T, inputs[k].T, self.coefficients(theta, force[k].T))
            z[k + 1][:, passive] = end.T[:, passive]
        return z

    def linearise(
        self,
        z: np.ndarray,
        inputs: np.ndarray,
        theta: np.ndarray,
        force: np.ndarray,
        columns: np.ndarray,
        active: np.ndarray,
    ) -> LinearModel:
        """The model about a path z (K + 1, R, S) with ``inputs`` (K, R, C), or with their changes over each step behind
        them (K, R, 2 C), and latent ``force`` (K, R, 3).

        theta: coefficients (all,) or (all, R); columns: (P,) positions in ``symbols`` to differentiate by; active: (A,)
        positions of states, which must not depend on the others.
        """
        K, R = inputs.shape[:2]
        M, P, A = K * R, len(columns), len(active)
        start, held = z[:-1].reshape(M, -1).T, inputs.reshape(M, -1).T
        every = self.coefficients(theta, force.reshape(M, 3).T)
        each, where = np.unique(np.concatenate([columns, self._force_columns]), return_inverse=True)
        wanted = np.concatenate([active, self.S + each])
        end, J = np.empty((M, self.S)), np.empty((M, A, len(wanted)))
        for a in range(0, M, BLOCK):
            s = slice(a, min(a + BLOCK, M))
            end[s], J[s] = self._step(start[:, s], held[:, s], every[:, s], active, wanted)
        J = J.reshape(K, R, A, -1)[..., np.concatenate([np.arange(A), A + where])]
        logged, H, D = self._logged(z, theta, columns, active)
        end = end.reshape(K, R, -1)
        return LinearModel(end, J[..., :A], J[..., A : A + P], J[..., A + P :], logged, H, D)

    def rates(self, z: np.ndarray, c: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates (M, S), and their Jacobian (M, S, S + 3) by states and latent force, at z (S, M), inputs c (C, M),
        theta (all, M)."""
        rate, nonzeros = _at(self._jacobian, z, c, theta)
        J = np.zeros((z.shape[1], self.S, self.S + self.P))
        J[:, self._rows, self._columns] = nonzeros.T
        return rate.T, J[..., np.concatenate([np.arange(self.S), self.S + self._force_columns])]

    def _step(
        self, z: np.ndarray, c: np.ndarray, theta: np.ndarray, rows: np.ndarray, columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """End (m, S) of one step from z (S, m) under c, (C, m) or (2 C, m), and the Jacobian of its ``rows`` (the first
        of the ``columns``)."""
        m, A, h = z.shape[1], len(rows), self.h
        rate, total = np.zeros_like(z), np.zeros_like(z)
        straight = np.zeros((m, A, len(columns)))
        straight[:, np.arange(A), np.arange(A)] = 1.0
        slope, summed = np.zeros_like(straight), np.zeros_like(straight)
        row, column = np.full(self.S, -1), np.full(self.S + self.P, -1)
        row[rows], column[columns] = np.arange(A), np.arange(len(columns))
        kept = (row[self._rows] >= 0) & (column[self._columns] >= 0)
        at = row[self._rows[kept]], column[self._columns[kept]]
        for fraction, weight in zip(NODES, WEIGHTS, strict=True):
            rate, nonzeros = _at(self._jacobian, z + fraction * h * rate, self._during(c, fraction), theta)
            J = np.zeros((m, A, len(columns)))
            J[:, at[0], at[1]] = nonzeros[kept].T
            slope = J[:, :, :A] @ (straight + fraction * h * slope)
            slope[:, :, A:] += J[:, :, A:]
            total += weight * rate
            summed += weight * slope
        return (z + h * total).T, straight + h * summed

    def _logged(
        self, z: np.ndarray, theta: np.ndarray, columns: np.ndarray, active: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Logged columns (K + 1, R, 6) and their derivatives by active state and by coefficient."""
        rows, R = z.shape[:2]
        every = spread(theta, rows * R) if theta.ndim > 1 else theta
        y, nonzeros = _at(self._logged_jacobian, np.ascontiguousarray(z.reshape(rows * R, -1).T), every)
        J = np.zeros((rows * R, 6, self.S + self.P))
        J[:, self._logged_at[0], self._logged_at[1]] = nonzeros.T
        J = J.reshape(rows, R, 6, -1)
        return y.T.reshape(rows, R, 6), J[..., active], J[..., self.S + columns]

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
        K, R = inputs.shape[:2]
        M = K * R
        middle = 0.5 * (z[:-1] + z[1:]).reshape(M, -1).T
        full = np.zeros((M, self.S, self.S + 3))
        into = np.concatenate([active, self.S + np.arange(3)])
        full[:, active[:, None], into[None]] = weight.reshape(M, len(active), -1)
        chosen = np.ascontiguousarray(full[:, self._rate_hessian_at[0], self._rate_hessian_at[1]].T)
        every = self.coefficients(theta, force.reshape(M, 3).T)
        found = _at(self._rate_hessian, middle, inputs.reshape(M, -1).T, every, chosen)[0]
        result = found.reshape(-1, K, R).sum(axis=1)
        M = (K + 1) * R
        full = np.zeros((M, 6, self.S))
        full[:, :, active] = weight_logged.reshape(M, 6, -1)
        chosen = np.ascontiguousarray(full[:, self._logged_hessian_at[0], self._logged_hessian_at[1]].T)
        every = spread(theta, M) if theta.ndim > 1 else theta
        found = _at(self._logged_hessian, z.reshape(M, -1).T, every, chosen)[0]
        result += found.reshape(-1, K + 1, R).sum(axis=1)
        return result[columns].T


def spread(theta: np.ndarray, points: int) -> np.ndarray:
    """Coefficients (all, points) from ``theta`` (all,), or from (all, R) of R windows that repeat up to ``points``."""
    return (
        np.tile(theta, (1, points // theta.shape[1])) if theta.ndim > 1 else np.repeat(theta[:, None], points, axis=1)
    )


def _nonzeros(matrix: ca.SX) -> ca.SX:
    """The structural nonzeros as a column."""
    return matrix.nz[:]


def _at(function: BatchFunction, *inputs: np.ndarray) -> list[np.ndarray]:
    """A batch function at m points, inputs (rows, m) or (rows,) for all."""
    return function.at(*inputs)

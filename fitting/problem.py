"""The calibration as one nonlinear program: objective, constraints and their exact derivatives.

Variables x: node states (each divided by its channel's scale), then the free coefficients as p = (theta - prior) / std.
Objective: 1/2 sum (z - y)^2 / sigma^2 over all measured grid samples + 1/2 |p|^2, the negative log posterior of
independent Gaussian residuals and priors. Constraints: the state at the end of each shooting interval equals the next
node. (Multiple shooting, Bock & Plitt 1984.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from fitting.segments import Segments
from fitting.shooting import Kernels, Shooting, Sweep
from mmg.ship import Ship


@dataclass(frozen=True)
class Prior:
    """Gaussian prior and bounds of the free coefficients, each of shape (P,)."""

    symbols: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, ship: Ship) -> Prior:
        """The prior that a ship file states: value +- std within its bounds."""
        chosen = [ship.coefficients[s] for s in ship.free]
        return cls(
            ship.free,
            *(np.array([getattr(c, key) for c in chosen]) for key in ("value", "std", "lower", "upper")),
        )


class Problem:
    """The nonlinear program over the intervals of ``segments``.

    sigma: (6,) standard deviation of the residual of each state channel. All evaluations cache on x.
    """

    def __init__(self, ship: Ship, prior: Prior, kernels: Kernels, segments: Segments, sigma: np.ndarray) -> None:
        self.ship, self.prior, self.segments = ship, prior, segments
        self.sigma = np.asarray(sigma, dtype=float)
        speed = np.sqrt(np.mean(segments.nodes[:, 3] ** 2 + segments.nodes[:, 4] ** 2)) + 1e-3
        length = ship.particulars["L"]
        self.scale = np.array([length / 3, length / 3, 0.1, 0.3 * speed, 0.1 * speed, 0.1 * speed / length])
        self.kernels = kernels
        self.shooting = Shooting(kernels, segments)
        self.base = ship.values
        self.B, self.P, self.M = len(segments.nodes), len(prior.mean), segments.intervals
        self.n, self.m = 6 * self.B + self.P, 6 * self.M
        self.node_weight = self._pinned() / self.sigma**2
        self.weight = segments.mask / self.sigma[None, :, None] ** 2
        self._build_sparsity()
        self._values_at: np.ndarray | None = None
        self._sweep_at: np.ndarray | None = None

    def _pinned(self) -> np.ndarray:
        """Node mask in which a channel that a window never measures is pinned at the window's first node."""
        seg = self.segments
        mask = seg.node_mask.copy()
        measured = np.zeros((len(seg.run), 6))
        np.add.at(measured, seg.node_window, seg.node_mask)
        np.add.at(measured, seg.window, seg.mask.sum(axis=0).T)
        first = np.unique(seg.node_window, return_index=True)[1]
        for w, b in enumerate(first):
            mask[b, measured[w] == 0] = 1.0
        return mask

    # -- variables ---------------------------------------------------------------------------------------------
    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Node states (B, 6) in SI and scaled coefficients p (P,)."""
        return x[: 6 * self.B].reshape(self.B, 6) * self.scale, x[6 * self.B :]

    def join(self, nodes: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.concatenate([(nodes / self.scale).reshape(-1), p])

    def coefficients(self, p: np.ndarray) -> np.ndarray:
        """All coefficients, free ones from p, shape (number of coefficients,)."""
        theta = self.base.copy()
        theta[self.kernels.free] = self.prior.mean + self.prior.std * p
        return theta

    def start(self, p: np.ndarray | None = None) -> np.ndarray:
        """Nodes on the measurements, coefficients at the prior mean (or at p)."""
        inside = np.clip(np.zeros(self.P) if p is None else p, *self.p_bounds())
        return self.join(self.segments.nodes, inside)

    def p_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return (
            (self.prior.lower - self.prior.mean) / self.prior.std,
            (self.prior.upper - self.prior.mean) / self.prior.std,
        )

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of x: the coefficients' own, none for the nodes."""
        free = np.full(6 * self.B, np.inf)
        lower, upper = self.p_bounds()
        return np.concatenate([-free, lower]), np.concatenate([free, upper])

    # -- values ------------------------------------------------------------------------------------------------
    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Node states (B, 6), scaled coefficients, interval ends (6, M) and interior states at x, cached."""
        if self._values_at is None or not np.array_equal(x, self._values_at):
            x = x.copy()  # IPOPT hands over views of its own memory
            nodes, p = self.split(x)
            end, interior = self.shooting.values(nodes[self.segments.start].T, self.coefficients(p))
            self._values = (nodes, p, end, interior)
            self._values_at = x
        return self._values

    def objective(self, x: np.ndarray) -> float:
        nodes, p, _, interior = self.evaluate(x)
        e, ei = nodes - self.segments.nodes, interior - self.segments.targets
        return 0.5 * float((self.node_weight * e * e).sum() + (self.weight * ei * ei).sum() + p @ p)

    def defects(self, x: np.ndarray) -> np.ndarray:
        """End of interval minus next node, divided by the channel's scale, shape (6 M,), interval by interval."""
        nodes, _, end, _ = self.evaluate(x)
        return ((end.T - nodes[self.segments.end]) / self.scale).reshape(-1)

    # -- derivatives -------------------------------------------------------------------------------------------
    def sweep(self, x: np.ndarray) -> list[Sweep]:
        """Forward sweeps with sensitivities at x, one per block of intervals."""
        if self._sweep_at is None or not np.array_equal(x, self._sweep_at):
            x = x.copy()
            nodes, p = self.split(x)
            self._sweep = self.shooting.sweep(nodes[self.segments.start].T, self.coefficients(p))
            end = np.concatenate([s.end for s in self._sweep], axis=1)
            interior = np.concatenate([s.interior for s in self._sweep], axis=2)
            self._values = (nodes, p, end, interior)
            self._values_at = self._sweep_at = x
        return self._sweep

    def gradient(self, x: np.ndarray) -> np.ndarray:
        sweeps, seg = self.sweep(x), self.segments
        nodes, p = self.split(x)
        d_nodes = self.node_weight * (nodes - seg.nodes)
        d_theta = np.zeros(self.P)
        for sweep, s in zip(sweeps, self.shooting.slices, strict=True):
            start = seg.start[s]
            for k, S in enumerate(sweep.S_interior):
                m = len(S)
                we = (self.weight[k, :, s] * (sweep.interior[k] - seg.targets[k, :, s]))[:, :m]
                pulled = (we.T[:, None, :] @ S)[:, 0]
                d_nodes[start[:m]] += pulled[:, :6]
                d_theta += pulled[:, 6:].sum(axis=0)
        return np.concatenate([(d_nodes * self.scale).reshape(-1), d_theta * self.prior.std + p])

    def _build_sparsity(self) -> None:
        seg, P, M, B = self.segments, self.P, self.M, self.B
        i, j = np.meshgrid(np.arange(6), np.arange(6), indexing="ij")
        rows = 6 * np.arange(M)[:, None, None]
        block = (rows + i, 6 * seg.start[:, None, None] + j)
        ends = (6 * np.arange(M)[:, None] + np.arange(6), 6 * seg.end[:, None] + np.arange(6))
        ip, jp = np.meshgrid(np.arange(6), np.arange(P), indexing="ij")
        dense = (rows + ip, 6 * B + jp + 0 * rows)
        r = np.concatenate([part[0].reshape(-1) for part in (block, ends, dense)])
        c = np.concatenate([part[1].reshape(-1) for part in (block, ends, dense)])
        self.jacobian_sparsity, self._jacobian_order = _sparsity(r, c, self.m, self.n)
        iu, ju = np.triu_indices(6)
        own = (6 * np.arange(B)[:, None] + iu, 6 * np.arange(B)[:, None] + ju)
        border = (6 * np.arange(B)[:, None, None] + ip, 6 * B + jp + 0 * np.arange(B)[:, None, None])
        pu, qu = np.triu_indices(P)
        r = np.concatenate([own[0].reshape(-1), border[0].reshape(-1), 6 * B + pu])
        c = np.concatenate([own[1].reshape(-1), border[1].reshape(-1), 6 * B + qu])
        self.hessian_sparsity, self._hessian_order = _sparsity(r, c, self.n, self.n)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Nonzeros of d defects / dx in the order of ``jacobian_sparsity``."""
        S = np.concatenate([sweep.S_end for sweep in self.sweep(x)])
        block = S[:, :, :6] * (self.scale[None, :] / self.scale[:, None])
        theta = S[:, :, 6:] * (self.prior.std[None, :] / self.scale[:, None])
        ends = np.full(self.m, -1.0)
        return np.concatenate([block.reshape(-1), ends, theta.reshape(-1)])[self._jacobian_order]

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Nonzeros of the upper triangle of the Hessian of factor objective + multipliers . defects."""
        sweeps, seg = self.sweep(x), self.segments
        _, p, _, interior = self._values
        weight = factor * self.weight
        lam = (multipliers.reshape(self.M, 6) / self.scale).T
        rows, shared = self.shooting.hessian(sweeps, self.coefficients(p), lam, interior - seg.targets, weight)
        nodes = np.zeros((self.B, 6, 6 + self.P))
        nodes[seg.start] += rows
        nodes[:, np.arange(6), np.arange(6)] += factor * self.node_weight
        s, t = self.scale, self.prior.std
        rows_u, columns_u = np.triu_indices(6)
        own = (nodes[:, :, :6] * np.outer(s, s))[:, rows_u, columns_u]
        border = nodes[:, :, 6:] * np.outer(s, t)
        shared = shared * np.outer(t, t) + factor * np.eye(self.P)
        values = np.concatenate([own.reshape(-1), border.reshape(-1), shared[np.triu_indices(self.P)]])
        return values[self._hessian_order]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """z - y at all measured grid samples, shape (samples, 6), NaN where not measured; nodes first."""
        nodes, _, _, interior = self.evaluate(x)
        seg = self.segments
        at_nodes = np.where(seg.node_mask > 0, nodes - seg.nodes, np.nan)
        inside = np.where(seg.mask > 0, interior - seg.targets, np.nan)
        return np.vstack([at_nodes, np.moveaxis(inside, 1, 2).reshape(-1, 6)])

    def with_sigma(self, sigma: np.ndarray) -> Problem:
        """The same problem with other noise levels."""
        return Problem(self.ship, self.prior, self.kernels, self.segments, sigma)

    def with_bounds(self, lower: np.ndarray, upper: np.ndarray) -> Problem:
        """The same problem with other bounds of the coefficients, (P,) each."""
        prior = replace(self.prior, lower=lower, upper=upper)
        return Problem(self.ship, prior, self.kernels, self.segments, self.sigma)


def _sparsity(rows: np.ndarray, columns: np.ndarray, n: int, m: int) -> tuple[ca.Sparsity, np.ndarray]:
    """CasADi's compressed-column pattern of distinct triplets and the order that sorts their values into it."""
    order = np.lexsort((rows, columns))
    counts = np.bincount(columns, minlength=m)
    pointers = np.concatenate([[0], np.cumsum(counts)])
    return ca.Sparsity(n, m, pointers.tolist(), rows[order].tolist()), order

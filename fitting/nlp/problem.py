"""The calibration as one nonlinear program: objective, constraints and their exact derivatives.

Variables x: node states (each divided by its channel's scale), then the free coefficients as p = (theta - prior) / std;
those of one run are L of the P, all of them unless runs have constants of their own (fitting/nlp/prior.py).
Objective: 1/2 sum phi((z - y)^2 / sigma^2) over all measured grid samples + 1/2 |p|^2, the negative log posterior of
independent residuals (Gaussian: phi(s) = s; others in loss.py) and priors, and 1/2 sum of the squared, scaled
residuals of the forces of captive tests, if there are any. Constraints: the state at the end of each shooting interval
equals the next node. (Multiple shooting, Bock & Plitt 1984.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from fitting.nlp.loss import Loss
from fitting.nlp.prior import Columns, neutral_values
from fitting.nlp.prior import Prior as Prior
from fitting.nlp.shooting import Kernels, SampleCost, Shooting
from fitting.nlp.windows import Segments
from mmg.model import assemble, states_behind
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.nlp.captive import Captive, CaptiveForces


Pattern = tuple[ca.Sparsity, np.ndarray]
"""A compressed-column pattern, and the order that sorts values, as they are assembled, into it."""


def sparsity_patterns(seg: Segments, S: int, P: int, columns: Columns) -> tuple[Pattern, Pattern]:
    """Patterns of the Jacobian (S M, S B + P) and of the upper triangle of the Hessian, over the intervals of ``seg``.

    S, P: numbers of states and coefficients. Nodes and intervals border on the ``columns`` of their group.
    """
    M, B, n = seg.intervals, len(seg.nodes), S * len(seg.nodes) + P
    i, j = np.meshgrid(np.arange(S), np.arange(S), indexing="ij")
    rows = S * np.arange(M)[:, None, None]
    block = (rows + i, S * seg.start[:, None, None] + j)
    ends = (S * np.arange(M)[:, None] + np.arange(S), S * seg.end[:, None] + np.arange(S))
    at = columns.at[columns.interval][:, None, :]
    dense = np.broadcast_arrays(rows + np.arange(S)[:, None], S * B + at)
    jacobian = _sparsity((block, ends, dense), S * M, n)
    iu, ju = np.triu_indices(S)
    own = (S * np.arange(B)[:, None] + iu, S * np.arange(B)[:, None] + ju)  # a node meets no other node, only p
    at = columns.at[columns.node][:, None, :]
    border = np.broadcast_arrays(S * np.arange(B)[:, None, None] + np.arange(S)[:, None], S * B + at)
    shared = tuple(S * B + index for index in np.triu_indices(P))
    return jacobian, _sparsity((own, border, shared), n, n)


def upper_triangle(nodes: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Values of the Hessian's upper triangle in the order in which its pattern assembles them: of rows of the nodes
    (B, S, S + L) and of the coefficients ``shared`` (P, P)."""
    S = nodes.shape[1]
    i, j = np.triu_indices(S)
    parts = (nodes[:, i, j], nodes[:, :, S:], shared[np.triu_indices(len(shared))])
    return np.concatenate([part.reshape(-1) for part in parts])


def _sparsity(parts: Sequence[Sequence[np.ndarray]], n: int, m: int) -> Pattern:
    """CasADi's compressed-column pattern (n, m) of distinct places, rows and columns of each of the ``parts``, and the
    order that sorts their values into it."""
    rows, columns = (np.concatenate([part[k].reshape(-1) for part in parts]) for k in (0, 1))
    order = np.lexsort((rows, columns))  # by column first: lexsort takes its last key as the first
    counts = np.bincount(columns, minlength=m)
    pointers = np.concatenate([[0], np.cumsum(counts)])
    return ca.Sparsity(n, m, pointers.tolist(), rows[order].tolist()), order


class Problem:
    """The nonlinear program over the intervals of ``segments``.

    sigma: (6,) standard deviation of the residual of each state channel; loss: cost of residuals; captive: forces of
    captive tests as further residuals. All evaluations cache on x. To another process goes what the problem is made of
    (``of``); its compiled code is taken from the cache there.
    """

    def __init__(
        self,
        ship: Ship,
        prior: Prior,
        kernels: Kernels,
        segments: Segments,
        sigma: np.ndarray,
        loss: Loss | None = None,
        captive: CaptiveForces | None = None,
    ) -> None:
        self.ship, self.prior, self.segments = ship, prior, segments
        self.loss, self.captive = loss or Loss(), captive
        self.sigma = np.asarray(sigma, dtype=float)
        # rms over the nodes [m/s]; 1e-3: no scale of zero for a ship at rest
        speed, length = np.sqrt(np.mean((segments.nodes[:, 3:5] ** 2).sum(axis=1))) + 1e-3, ship.particulars["L"]
        # typical changes over a window: unknowns of order 1 for IPOPT
        scale = np.array([length / 3, length / 3, 0.1, 0.3 * speed, 0.1 * speed, 0.1 * speed / length])
        self.scale = np.concatenate([scale, kernels.model.sizes])
        self.kernels, self.S = kernels, kernels.S
        self.columns = Columns.of(prior, segments)
        intervals = (segments.steps, segments.controls, segments.h, self.columns.interval, segments.window)
        self.shooting = Shooting(kernels.interval or kernels.portable, *intervals)
        self.base, self.std, self.L = ship.values, prior.std[self.columns.at], self.columns.at.shape[1]
        self.B, self.P, self.M = len(segments.nodes), len(prior.mean), segments.intervals
        self.n, self.m = self.S * self.B + self.P, self.S * self.M
        at_nodes, inside = segments.variances(self.sigma, self.loss.tau)
        self.node_weight, self.weight = segments.pinned() / at_nodes, segments.mask / inside
        self.measured_nodes = states_behind(kernels.model, segments.nodes.T, segments.node_controls, self.base).T
        self.memory_weight = np.zeros((self.B, self.S - 6))
        # a prior of typical sizes at first nodes alone: what came before is not logged
        self.memory_weight[np.unique(segments.node_window, return_index=True)[1]] = 1 / kernels.model.sizes**2
        # nan equals nothing: no x is cached yet
        self._values_at = self._slopes_at = self._errors_at = np.full(self.n, np.nan)

    @classmethod
    def of(
        cls,
        ship: Ship,
        prior: Prior,
        segments: Segments,
        sigma: np.ndarray,
        loss: Loss | None = None,
        captive: Captive | None = None,
        compiled: bool = True,
    ) -> Problem:
        """The problem with kernels made for it; captive: points of captive tests; compiled: use a C compiler."""
        free = prior.positions(ship)
        kernel = Kernels(assemble(ship), free, compiled)
        if not captive:
            return cls(ship, prior, kernel, segments, sigma, loss)
        from fitting.nlp.captive import CaptiveForces  # late: few fits have captive tests

        forces = CaptiveForces(kernel.model, free[: prior.shared], captive, compiled)
        return cls(ship, prior, kernel, segments, sigma, loss, forces)

    def __reduce__(self) -> tuple:
        points, compiled = self.captive.points if self.captive else None, not self.kernels.interpreted_because
        # compiled code is not pickled
        return Problem.of, (self.ship, self.prior, self.segments, self.sigma, self.loss, points, compiled)

    @cached_property
    def patterns(self) -> tuple[Pattern, Pattern]:
        """Where the nonzeros of the constraint Jacobian and of the Hessian's upper triangle lie, and their order."""
        return sparsity_patterns(self.segments, self.S, self.P, self.columns)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Node states (B, S) in SI and scaled coefficients p (P,)."""
        return x[: self.S * self.B].reshape(self.B, self.S) * self.scale, x[self.S * self.B :]

    def join(self, nodes: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.concatenate([(nodes / self.scale).reshape(-1), p])

    def coefficients(self, p: np.ndarray) -> np.ndarray:
        """All coefficients, free ones from p, (all,); by run (R, all) if runs have constants of their own."""
        values = (self.prior.mean + self.prior.std * p)[self.columns.at]
        theta = np.tile(self.base, (len(values), 1))
        theta[:, self.kernels.free] = values
        return theta if self.prior.constants else theta[0]

    def captive_coefficients(self, p: np.ndarray) -> np.ndarray:
        """All coefficients of captive tests (all,), which have no constants of a run."""
        theta = neutral_values(self.ship, self.prior.constants)
        theta[self.kernels.free[: self.prior.shared]] = (self.prior.mean + self.prior.std * p)[: self.prior.shared]
        return theta

    def start(self, p: np.ndarray | None = None) -> np.ndarray:
        """Nodes on the measurements, coefficients at the prior mean (or at p)."""
        inside = np.clip(np.zeros(self.P) if p is None else p, *self.p_bounds())
        return self.join(self.measured_nodes, inside)

    def p_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.prior.scaled_bounds

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of x: the coefficients' own, none for the nodes."""
        infinite, (lower, upper) = np.full(self.S * self.B, np.inf), self.p_bounds()
        return np.concatenate([-infinite, lower]), np.concatenate([infinite, upper])

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Node states (B, S), scaled coefficients, interval ends (S, M) and interior states at x, cached."""
        if not np.array_equal(x, self._values_at):
            x = x.copy()  # IPOPT hands over views of its own memory
            nodes, p = self.split(x)
            end, interior = self.shooting.values(nodes[self.segments.start].T, self.coefficients(p))
            self._values = (nodes, p, end, interior)
            self._values_at = x
        return self._values

    def errors(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Model minus measured columns at the nodes (B, 6) and inside the intervals (K - 1, 6, M), cached."""
        nodes, p, _, interior = self.evaluate(x)
        if self._errors_at is not self._values_at:  # the same array, not an equal one: evaluate has just compared x
            measured, seg = self.kernels.measurement.values, self.segments
            at_nodes, at_intervals = self._theta(p)
            inside = np.array([measured(z, at_intervals) for z in interior]).reshape(seg.targets.shape)
            self._errors = measured(nodes.T, at_nodes).T - seg.nodes, inside - seg.targets
            self._errors_at = self._values_at
        return self._errors

    def objective(self, x: np.ndarray) -> float:
        e, ei = self.errors(x)
        nodes, p, _, _ = self.evaluate(x)
        memory = self.memory_weight * (nodes[:, 6:] - self.measured_nodes[:, 6:]) ** 2
        # phi of each sample, before the half
        samples = self.loss.cost(self.node_weight, e).sum() + self.loss.cost(self.weight, ei).sum()
        # 2: its cost has the half already
        captive = 2 * self.captive.cost(self.captive_coefficients(p)) if self.captive else 0.0
        return 0.5 * float(samples + memory.sum() + captive + p @ p)  # p is in prior standard deviations

    def defects(self, x: np.ndarray) -> np.ndarray:
        """End of interval minus next node, divided by the channel's scale, shape (S M,), interval by interval."""
        nodes, _, end, _ = self.evaluate(x)
        return ((end.T - nodes[self.segments.end]) / self.scale).reshape(-1)

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the interval ends (M, S, S + L) to start node and coefficients, and the gradient (M, S + L)
        of the cost of the samples inside each interval, SI, at x, cached."""
        if not np.array_equal(x, self._slopes_at):
            nodes, p, _, _ = self.evaluate(x)
            pull, own = self.sample_pull(x)
            ends, slope = self.shooting.linearise(nodes[self.segments.start].T, self.coefficients(p), pull)
            self.keep_slopes(x, ends, slope, own)
        return self._slopes

    def keep_slopes(self, x: np.ndarray, ends: np.ndarray, slope: np.ndarray, own: np.ndarray) -> None:
        """Keeps what ``slopes`` gives at x (n,); slope lacks ``own`` (M, L), what the measurement alone adds."""
        slope[:, self.S :] += own  # instruments depend on coefficients directly, not only through the states
        self._slopes, self._slopes_at = (ends, slope), x.copy()

    def sample_pull(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient of the cost of the samples inside the intervals: to the states (K - 1, S, M) and, through the
        measurement alone, to the coefficients (M, L), SI."""
        _, p, _, interior = self.evaluate(x)
        ei = self.errors(x)[1]
        we = self.loss.weight(self.weight, ei) * ei
        if self.kernels.measurement.identity or not len(we):
            # states beyond the six are not measured
            return np.pad(we, ((0, 0), (0, self.S - 6), (0, 0))), np.zeros((self.M, self.L))
        z, theta, shaped = self._inside(interior, p)
        pull, own = self.kernels.measurement.slope(z.T, np.moveaxis(we, 1, 2).reshape(-1, 6), theta, self.L)
        return np.moveaxis(shaped(pull), 2, 1), shaped(own).sum(axis=0)

    def _inside(self, interior: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, Callable]:
        """Interior states as points (S, m), their coefficients, and what shapes their values as (K - 1, M, ...)."""
        theta, steps = self._theta(p)[1], len(interior)
        theta = theta if theta.ndim == 1 else np.tile(theta, (1, steps))
        points = np.ascontiguousarray(np.moveaxis(interior, 1, 0)).reshape(self.S, -1)
        return points, theta, lambda values: values.reshape(steps, self.M, *values.shape[1:])

    def gradient(self, x: np.ndarray) -> np.ndarray:
        (_, slope), S, columns = self.slopes(x), self.S, self.columns
        nodes, p = self.split(x)
        e = self.errors(x)[0]
        pulled = self.loss.weight(self.node_weight, e) * e  # d cost / d column
        d_nodes, direct = self.kernels.measurement.slope(nodes, pulled, self._theta(p)[0], self.L)
        d_theta = columns.total(direct, columns.node) + columns.total(slope[:, S:], columns.interval)
        if self.captive:
            d_theta[0, : columns.shared] += self.captive.gradient(self.captive_coefficients(p))
        d_nodes[:, 6:] += self.memory_weight * (nodes[:, 6:] - self.measured_nodes[:, 6:])
        d_nodes[self.segments.start] += slope[:, :S]  # each node begins one interval at most, so += counts none twice
        return np.concatenate([(d_nodes * self.scale).reshape(-1), columns.vector(d_theta * self.std, self.P) + p])

    def _theta(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All coefficients at each node and of each interval: (all, B) and (all, M), or (all,) where all are shared."""
        theta = self.coefficients(p)
        return self.columns.points(theta, self.columns.node), self.columns.points(theta, self.columns.interval)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Nonzeros of d defects / dx in the order of ``patterns``."""
        sensitivity, scale = self.slopes(x)[0], self.scale[:, None]
        block = sensitivity[:, :, : self.S] * (self.scale / scale)  # d scaled end / d scaled start
        std = self.columns.each(self.std, self.columns.interval)[:, None, :]
        theta = sensitivity[:, :, self.S :] * (std / scale)
        ends = np.full(self.m, -1.0)  # each defect has minus the next node
        return np.concatenate([block.reshape(-1), ends, theta.reshape(-1)])[self.patterns[0][1]]

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Upper triangle of the Hessian of factor objective + multipliers . defects, nonzeros by ``patterns``."""
        return upper_triangle(*self.hessian_parts(x, factor, multipliers))[self.patterns[1][1]]

    def hessian_parts(
        self, x: np.ndarray, factor: float, multipliers: np.ndarray, middle: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """By blocks: rows of the nodes (B, S, S + L), coefficients (P, P); middle: as of ``Shooting.hessian``."""
        S, columns = self.S, self.columns
        at_nodes, p, _, _ = self.evaluate(x)
        # defects are scaled, the kernel's ends are not
        lam = np.ascontiguousarray((multipliers.reshape(self.M, S) / self.scale).T)
        ei, (pull, own) = self.errors(x)[1], self.sample_pull(x)
        cost = self.sample_cost(x, factor * pull, factor * self.loss.second_derivative(self.weight, ei), factor)
        found = self.shooting.hessian(at_nodes[self.segments.start].T, self.coefficients(p), cost, lam, middle)
        if factor == 1.0:  # IPOPT asks for others, with which the cost's slope is another one
            self.keep_slopes(x, found.ends, found.slope, own)
        shared, nodes = found.shared, np.zeros((self.B, S, S + self.L))
        nodes[self.segments.start] = found.rows
        if self.captive:
            shared[0, : columns.shared, : columns.shared] += factor * self.captive.hessian(self.captive_coefficients(p))
        e = self.errors(x)[0]
        second = self.loss.second_derivative(self.node_weight, e)
        if self.kernels.measurement.identity:
            nodes[:, np.arange(6), np.arange(6)] += factor * second
        else:
            pull = self.loss.weight(self.node_weight, e) * e
            H = factor * self.kernels.measurement.curvature(at_nodes, second, pull, self._theta(p)[0])
            own = self.kernels.measurement.own  # few coefficients are of instruments: H has their columns alone
            nodes[:, :, np.concatenate([np.arange(S), S + own])] += H[:, :S]
            shared[:, own[:, None], own] += columns.total(H[:, S:, S:], columns.node)
        nodes[:, np.arange(6, S), np.arange(6, S)] += factor * self.memory_weight
        t = self.std[:, None, :]  # chain rule of p = (theta - mean) / std
        nodes *= self.scale[:, None] * columns.unit(self.scale, self.std, columns.node)
        shared = columns.matrix(shared * (np.swapaxes(t, 1, 2) * t), self.P) + factor * np.eye(self.P)
        return nodes, shared

    def sample_cost(self, x: np.ndarray, pull: np.ndarray, weight: np.ndarray, bending: float) -> SampleCost:
        """Derivatives of the cost of the samples inside the intervals at x (n,).

        pull: (K - 1, S, M) gradient; weight: (K - 1, 6, M) second derivative by the residuals; bending: factor on what
        the curvature of the measurement adds, 0 for the Hessian of Gauss and Newton.
        """
        h, (_, p, _, interior) = self.kernels.measurement, self.evaluate(x)
        if h.identity or not len(weight):
            return SampleCost(pull, np.pad(weight, ((0, 0), (0, self.S - 6), (0, 0))))
        z, theta, shaped = self._inside(interior, p)
        flat, ei = np.moveaxis(weight, 1, 2).reshape(-1, 6), self.errors(x)[1]
        we = bending * np.moveaxis(self.loss.weight(self.weight, ei) * ei, 1, 2).reshape(-1, 6)
        full = h.curvature(z.T, flat, we if bending else None, theta)
        return SampleCost(pull, weight, shaped(full), h.own)

    def weights_at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """1 / sigma^2 of the samples at the nodes (B, 6) and inside (K - 1, 6, M), reduced by a robust loss."""
        e, ei = self.errors(x)
        return self.loss.weight(self.node_weight, e), self.loss.weight(self.weight, ei)

    def with_sigma(self, sigma: np.ndarray, tau: np.ndarray | None = None) -> Problem:
        """The same problem with other noise levels; tau: (6,) correlation times of residuals [samples]."""
        return self.with_changes(sigma=sigma, loss=self.loss if tau is None else replace(self.loss, tau=tau))

    def with_bounds(self, lower: np.ndarray, upper: np.ndarray) -> Problem:
        """The same problem with other bounds of the coefficients, (P,) each. All else is shared."""
        other = object.__new__(Problem)  # not the constructor: nothing that it makes depends on the bounds
        other.__dict__ |= self.__dict__ | {"patterns": self.patterns}
        other.prior = replace(self.prior, lower=lower, upper=upper)
        return other

    def with_changes(self, **changes: Any) -> Problem:
        """The same problem with other arguments of its constructor; a ship may differ in what is not free."""
        names = ("ship", "prior", "kernels", "segments", "sigma", "loss", "captive")
        changed = Problem(**{name: getattr(self, name) for name in names} | changes)
        if "patterns" in self.__dict__ and not changes.keys() & {"ship", "prior", "kernels", "segments"}:
            changed.__dict__["patterns"] = self.patterns  # they depend on nothing else
        return changed

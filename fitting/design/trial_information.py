"""What trials that have not been run would tell of the coefficients: many of them at once, by their inputs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.nlp.prior import Prior
from fitting.nlp.sample_cost import SampleCost
from fitting.nlp.shooting import Kernels, Shooting
from mmg.model import columns
from mmg.rollout import Simulator


@dataclass(frozen=True)
class TrialInformation:
    """Information of simulated trials as the fit of a run takes it: the same right-hand side, noise and windows.

    simulator: of the calibrated ship; prior: of her free coefficients, in whose standard deviations all is; sigma: (6,)
    noise of the states, infinite where one is not measured; dt: step [s]; window: steps of a window.
    """

    simulator: Simulator
    prior: Prior
    sigma: np.ndarray
    dt: float
    window: int

    def __reduce__(self) -> tuple:
        return TrialInformation, (self.simulator, self.prior, self.sigma, self.dt, self.window)

    @cached_property
    def kernels(self) -> Kernels:
        """Right-hand side and Jacobian of the ship."""
        free = self.prior.positions(self.simulator.ship)
        return Kernels(self.simulator.model, free, self.simulator.compiled)

    def motions(self, start: np.ndarray, inputs: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """States (N + 1, S, K) from starts (6, K) under inputs (N, C, K); theta: (all,) or (all, K) coefficients."""
        return self.simulator.run(start, inputs, self.dt, theta)

    def of(self, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Fisher information (K, P, P) of motions ``states`` (N + 1, S, K) under ``inputs`` (N, C, K), prior excluded.

        The state at the begin of each window is unknown.
        """
        N, S, K = len(inputs), states.shape[1], states.shape[2]
        W = max(1, round(N / self.window))
        m, P = N // W, len(self.prior.symbols)
        first = m * np.arange(W)
        begin = np.concatenate([states[k] for k in first], axis=1)
        held = np.concatenate([inputs[k : k + m] for k in first], axis=2)
        theta = self.simulator.ship.values
        each = np.arange(W * K)
        held = np.ascontiguousarray(held)
        kernel = self.kernels.interval or self.kernels.portable
        shooting = Shooting(kernel, np.full(W * K, m), held, self.dt, np.zeros(W * K, dtype=int), each)
        end, interior = shooting.values(begin, theta)
        found = shooting.quadratics(begin, theta, self._cost(interior, theta))
        V = np.zeros((W * K, S + P, S + P))
        V[:, :S], V[:, S:, S:] = found.rows, found.shared
        V[:, S:, :S] = np.swapaxes(found.rows[:, :, S:], 1, 2)
        still = np.zeros((W * K, S, S + P))
        still[:, np.arange(S), np.arange(S)] = 1.0
        for z, sensitivity in ((begin, still), (end, found.ends)):
            J = self._columns(z, sensitivity, theta) / self.sigma[:, None]
            V += np.swapaxes(J, 1, 2) @ J
        unit = np.append(np.ones(S), self.prior.std)
        V *= np.outer(unit, unit)
        V[:, np.arange(S), np.arange(S)] += np.append(np.full(6, 1e-9), 1 / self.simulator.model.sizes**2)
        across = np.linalg.solve(V[:, :S, :S], V[:, :S, S:])
        F = V[:, S:, S:] - np.swapaxes(V[:, :S, S:], 1, 2) @ across
        F = np.nan_to_num(0.5 * (F + np.swapaxes(F, 1, 2)), nan=0.0, posinf=0.0, neginf=0.0)
        return F.reshape(W, K, P, P).sum(axis=0)

    def _cost(self, interior: np.ndarray, theta: np.ndarray) -> SampleCost:
        """Information (K - 1, ...) of the logged columns on the interior states (K - 1, S, M)."""
        h, (steps, S, M) = self.kernels.measurement, interior.shape
        pull = np.zeros(interior.shape)
        if h.identity or not steps:
            weight = np.zeros((steps, S, M))
            weight[:, :6] = self.sigma[:, None] ** -2.0
            return SampleCost(pull, weight)
        J = h.jacobian(np.moveaxis(interior, 1, 0).reshape(S, -1), theta) / self.sigma[:, None]
        full = (np.swapaxes(J, 1, 2) @ J).reshape(steps, M, S + len(h.own), S + len(h.own))
        return SampleCost(pull, pull, full, h.own)

    def _columns(self, z: np.ndarray, sensitivity: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Sensitivities (m, 6, S + P) of the logged columns from those of the states (m, S, S + P)."""
        h = self.kernels.measurement
        if h.identity:
            return sensitivity[:, :6]
        S = sensitivity.shape[1]
        J = h.jacobian(z, theta)
        total = J[:, :, :S] @ sensitivity
        total[:, :, S + h.own] += J[:, :, S:]
        return total

    def logged(self, states: np.ndarray) -> np.ndarray:
        """The six columns (N + 1, 6, K) that would be logged of ``states`` (N + 1, S, K)."""
        return np.asarray(columns(self.simulator.model, states, self.simulator.ship.values))


@dataclass(frozen=True)
class Present:
    """What is known before a trial.

    precision: (P, P) of the free coefficients, in prior standard deviations; worth: factor on the information of a
    trial for residuals correlated beyond the noise model; wanted: (m, P) combinations of the coefficients that are to
    be known better; names: of these (m,).
    """

    precision: np.ndarray
    worth: float
    wanted: np.ndarray
    names: tuple[str, ...]

    def variances(self, fisher: np.ndarray | None = None) -> np.ndarray:
        """Variances (..., m) of what is wanted with trials of information ``fisher`` (..., P, P); None: now."""
        A = self.precision if fisher is None else self.precision + self.worth * fisher
        return np.einsum("mp,...pq,mq->...m", self.wanted, np.linalg.inv(A), self.wanted)

    def gain(self, fisher: np.ndarray) -> np.ndarray:
        """Mean logarithm of the variances with trials of information ``fisher`` (..., P, P) less that of now, (...)."""
        return np.log(self.variances(fisher) / self.variances()).mean(axis=-1)

"""What trials that have not been run would tell of the coefficients, and which windows of a long log tell most."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.nlp.fisher_information import information
from fitting.nlp.prior import Prior, group_sums
from fitting.nlp.problem import Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import Segments
from fitting.prediction.innovations import UNEXPLAINED, Innovations, information_of
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

    def __reduce__(self) -> tuple:  # without the kernels: in another process they are taken from the cache
        return TrialInformation, (self.simulator, self.prior, self.sigma, self.dt, self.window)

    @cached_property
    def kernels(self) -> Kernels:
        """Right-hand side and Jacobian of the ship."""
        free = self.prior.positions(self.simulator.ship)
        return Kernels(self.simulator.model, free, self.simulator.compiled)

    def of(self, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Fisher information (K, P, P) of motions ``states`` (N + 1, S, K) under ``inputs`` (N, C, K), prior excluded.
        The state at the begin of each window, which is one shooting interval, is unknown."""
        (N, C, K), S, P = inputs.shape, states.shape[1], len(self.prior.symbols)
        windows = max(1, round(N / self.window))
        m, M = N // windows, windows * K  # steps of a window; the first windows of all trials, then the second
        first, each, measured = m * np.arange(windows), np.arange(M), np.isfinite(self.sigma).astype(float)
        controls = np.ascontiguousarray(np.concatenate([inputs[k : k + m] for k in first], axis=2))
        ends = np.stack([states[first], states[first + m]])  # (2, windows, S, K)
        segments = Segments(
            h=self.dt,
            K=m,
            steps=np.full(M, m),
            start=2 * each,  # nodes: begin and end of each window in turn
            end=2 * each + 1,
            controls=controls,
            targets=np.zeros((m - 1, 6, M)),  # information knows no residuals
            mask=np.tile(measured[:, None], (m - 1, 1, M)),
            nodes=(nodes := ends.transpose(1, 3, 0, 2).reshape(2 * M, S))[:, :6],
            node_mask=np.tile(measured, (2 * M, 1)),
            node_controls=controls[[0, -1]].transpose(1, 2, 0).reshape(C, 2 * M),
            window=each,
            node_window=np.repeat(each, 2),
            run=np.tile(np.arange(K), windows),
            trials=(),
            duration=N * self.dt,
        )
        sigma = np.where(measured > 0, self.sigma, 1.0)  # the mask leaves these states out
        problem = Problem(self.simulator.ship, self.prior, self.kernels, segments, sigma)
        fisher = information(problem, problem.join(nodes, np.zeros(P))).fisher
        return np.nan_to_num(fisher, posinf=0.0, neginf=0.0).reshape(windows, K, P, P).sum(axis=0)

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


# The choice ends where a further window adds less than this to the mean log information of a coefficient. Set by hand:
# 0.02 nats are 1 % of a standard deviation.
LEAST = 0.02


@dataclass(frozen=True)
class ChosenWindows:
    """Chosen windows. windows: their numbers, the one that tells most first; gains: log determinant of the information
    that each adds; of: windows that were looked at; all: log determinant that all of them together add."""

    windows: tuple[int, ...]
    gains: tuple[float, ...]
    of: int
    all: float


def window_information(innovations: Innovations) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the windows (W,) and their information (W, P, P) on the candidates of ``innovations``, in units of
    their typical sizes. Windows with a stretch that was moved by something else are left out."""
    information, _, distance = information_of(innovations)
    windows, position = np.unique(innovations.window, return_inverse=True)
    information *= np.outer(innovations.typical, innovations.typical)  # by candidate in SI -> in typical sizes
    total, worst = group_sums(position, information, len(windows)), np.zeros(len(windows))
    np.maximum.at(worst, position, distance)
    sound = worst < UNEXPLAINED
    return windows[sound], total[sound]


def choose_windows(innovations: Innovations, most: int) -> ChosenWindows:
    """Up to ``most`` windows of ``innovations``, whose candidates are coefficients: each adds most to the log
    determinant of the information that those before it have, beginning with the prior (typical sizes are its standard
    deviations)."""
    numbers, information = window_information(innovations)
    P = len(innovations.typical)
    precision, remaining, chosen, gains = np.eye(P), np.ones(len(numbers), bool), list[int](), list[float]()
    total = float(np.linalg.slogdet(precision + information.sum(axis=0))[1]) if len(numbers) else 0.0
    while remaining.any() and len(chosen) < most:  # greedy D-optimal design
        now = np.linalg.slogdet(precision)[1]
        gain = np.where(remaining, np.linalg.slogdet(precision + information)[1] - now, -np.inf)
        best = int(gain.argmax())
        if chosen and gain[best] < LEAST * P:
            break
        chosen.append(int(numbers[best]))
        gains.append(float(gain[best]))
        precision, remaining[best] = precision + information[best], False
    return ChosenWindows(tuple(chosen), tuple(gains), len(numbers), total)

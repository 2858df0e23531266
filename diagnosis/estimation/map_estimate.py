"""The most likely path, latent force and coefficients under a hypothesis, and what is random re-estimated.

A hypothesis frees the ship's coefficients and the parameters of some effects. Each iteration linearises the model about
the present path, whitens by the filter, takes a Gauss-Newton step in the coefficients with their priors, smooths, and
moves the path, the latent force included: so the linearisation is about the smoothed force, not about none. The sizes
of what is random follow by the fixed point of their likelihood equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.candidates import Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import (
    Adjoint,
    Filtered,
    LinearSystem,
    NoiseModel,
    adjoint,
    filtered,
    responses,
    smoothed,
    system,
)
from diagnosis.estimation.linearised_model import LinearModel, TransitionModel, spread
from diagnosis.estimation.noise_sizes import initial_noise, updated_noise
from diagnosis.estimation.parameters import Priors, active_in_window, active_states, set_values
from fitting.solvers.bounded_step import bounded_step
from mmg.model import settled
from mmg.motion.froude import state_scale


@dataclass(frozen=True)
class Trajectory:
    """States (K + 1, R, S), latent force (K + 1, R, 3) [N, N, N m]."""

    z: np.ndarray
    force: np.ndarray


ExtraColumns = Callable[[LinearModel], tuple[np.ndarray, np.ndarray]]
"""More columns about a linearisation: what they add to the active states over a step (K, R, A, c), and to the logged
columns (K + 1, R, 6, c)."""


@dataclass(frozen=True)
class Linearisation:
    """Everything about one linearisation: the model, the filter, the white columns and residual.

    white: (K + 1, R, 6, P + 1) responses of the columns, in units of their prior std, and last the residual, negative;
    states: (K + 1, R, n, P + 1) predicted; adjoint: of log det; bend: (R, P) derivative of 1/2 log
    det by the columns, by window.
    nll: negative log likelihood without constants, the priors of the free columns and of what is random included.
    """

    linear: LinearModel
    system: LinearSystem
    filter: Filtered
    white: np.ndarray
    states: np.ndarray
    adjoint: Adjoint
    logdet_gradient: np.ndarray
    nll: float


@dataclass(frozen=True)
class Estimate:
    """A hypothesis fitted.

    theta: (all,) coefficients of the wide ship, or (all, R) by window; free: the priors of those that were free; p:
    their values less the prior mean, in prior std; covariance: (P, P) of p; path, noise; nll; iterations used;
    converged.
    """

    theta: np.ndarray
    free: Priors
    p: np.ndarray
    covariance: np.ndarray
    path: Trajectory
    noise: NoiseModel
    nll: float
    iterations: int
    converged: bool

    def value(self, symbol: str, run: int | None = None) -> float:
        """Value of a free parameter, or of the one of a run."""
        i = self.free.columns.index(Column(symbol, run))
        return float(self.free.mean[i] + self.free.std[i] * self.p[i])

    def std(self, symbol: str, run: int | None = None) -> float:
        """Standard error of a free parameter, or of the one of a run."""
        i = self.free.columns.index(Column(symbol, run))
        return float(self.free.std[i] * np.sqrt(self.covariance[i, i]))


def initial_trajectory(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> Trajectory:
    """The measured states, no latent force; what is missing is interpolated in time or zero."""
    y, measured = data.y.copy(), data.measured
    for r in range(y.shape[1]):
        rows = np.arange(len(y))
        for j in range(6):
            if not measured[:, r, j].all():
                known = measured[:, r, j]
                y[:, r, j] = np.interp(rows, rows[known], y[known, r, j]) if known.any() else 0.0
    K1, R = y.shape[:2]
    controls = np.concatenate([data.inputs, data.inputs[-1:]]).reshape(K1 * R, -1).T
    every = spread(theta, K1 * R) if theta.ndim > 1 else theta
    z = steps.settled(y.reshape(K1 * R, 6).T, controls, every)
    return Trajectory(z.T.reshape(K1, R, -1), np.zeros((K1, R, 3)))


SETTLED = 0.03
"""How far, in typical sizes, a memory may be from settled at the start of a window."""


def initial_covariance(
    steps: TransitionModel, data: GriddedTrials, z: np.ndarray, theta: np.ndarray, active: np.ndarray
) -> np.ndarray:
    """Covariance (R, A, A) at the start: motion as good as unknown, memory settled with it but for a little."""
    R = len(z)
    six = np.array([3.0, 3.0, 0.3, 0.3, 0.3, 0.1]) * state_scale(steps.ship.particulars["L"])
    slope = np.zeros((R, steps.S, 6))
    slope[:, np.arange(6), np.arange(6)] = six
    if len(active) > 6:
        start = np.repeat(z[:, :6].T, 7, axis=1).reshape(6, R, 7)
        for j in range(6):
            start[j, :, j + 1] += 1e-4 * six[j]
        controls = np.repeat(data.inputs[0].T, 7, axis=1)
        every = np.repeat(theta, 7, axis=1) if theta.ndim > 1 else theta
        tried = settled(steps.model, start.reshape(6, -1), controls, every).reshape(steps.S, R, 7)
        slope[:, 6:] = np.moveaxis((tried[6:, :, 1:] - tried[6:, :, :1]) / 1e-4, 0, 1)
    P = slope @ slope.swapaxes(1, 2)
    at = np.arange(6, steps.S)
    P[:, at, at] += (SETTLED * steps.model.sizes) ** 2
    return P[:, active[:, None], active[None]]


def linearise_and_filter(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    path: Trajectory,
    noise: NoiseModel,
    free: Priors,
    p: np.ndarray,
    active: np.ndarray,
    extra: ExtraColumns | None = None,
) -> Linearisation:
    """Linearise at coefficients (all,) and a path; columns are those of ``free``, in units of their std, then further.

    further: from the linearisation, more columns; the slope of the log determinant by them is taken as zero.
    """
    columns = np.array([steps.symbols.index(s) for s in free.symbols], dtype=int)
    linear = steps.linearise(path.z, data.inputs, theta, path.force[:-1], columns, active)
    K, R, A = linear.G.shape[:3]
    s = system(linear, noise, initial_covariance(steps, data, path.z[0], theta, active), data.good, data.inside, data.h)
    f = filtered(s)
    left = np.exp(-data.h / noise.tau)
    size = free.std * active_in_window(free.columns, data)  # (R, P)
    pushed, seen = linear.G * size[:, None], linear.D * size[:, None]
    if extra is not None:
        more_pushed, more_seen = extra(linear)
        pushed, seen = np.concatenate([pushed, more_pushed], axis=3), np.concatenate([seen, more_seen], axis=3)
    P = pushed.shape[3]
    forcing = np.zeros((K, R, A + 3, P + 1))
    forcing[:, :, :A, :-1] = pushed
    forcing[:, :, :A, -1] = (linear.end - path.z[1:])[..., active]
    forcing[:, :, A:, -1] = left * path.force[:-1] - path.force[1:]
    seen = np.concatenate([seen, (linear.logged - data.y)[..., None]], axis=3)
    start = np.zeros((R, s.T.shape[2], P + 1))
    start[:, A : A + 3, -1] = -path.force[0]
    if A > 6:
        calm = settled(steps.model, path.z[0, :, :6].T, data.inputs[0].T, theta).T
        start[:, 6:A, -1] = (calm - path.z[0])[:, active[6:]]
    white, states = responses(s, f, forcing, seen, start)
    found = adjoint(s, f)
    weight = np.where(data.inside[..., None, None], found.by_T[:, :, :A, : A + 3], 0.0)
    through = np.concatenate([linear.F, linear.force], axis=3)
    # T = exp of the generator: a change of the generator acts on either side of the step alike
    ahead = weight @ np.concatenate([through, np.broadcast_to(np.eye(A + 3)[A:], (K, R, 3, A + 3))], axis=2).swapaxes(
        2, 3
    )
    weight = 0.5 * (ahead + linear.F.swapaxes(2, 3) @ weight)
    by_Z = np.where(data.good[..., None], found.by_Z[..., :A], 0.0)
    logdet_gradient = (
        steps.logdet_gradient(path.z, data.inputs, theta, path.force[:-1], weight, by_Z, columns, active) * size
    )
    logdet_gradient = np.hstack([logdet_gradient, np.zeros((R, P - len(columns)))])
    nll = 0.5 * float(f.log_det.sum() + (white[..., -1] ** 2).sum() + p @ p) + noise.unusual
    return Linearisation(linear, s, f, white, states, found, logdet_gradient, nll)


@dataclass(frozen=True)
class _Point:
    """Where an iteration stands."""

    p: np.ndarray
    path: Trajectory
    noise: NoiseModel
    nll: float = np.inf


@np.errstate(all="ignore")
def estimate(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    free: Priors,
    noise: NoiseModel,
    path: Trajectory | None = None,
    p: np.ndarray | None = None,
    iterations: int = 8,
    tolerance: float = 0.05,
    steady: bool = False,
) -> Estimate:
    """Fit a hypothesis from coefficients (all,) and, if given, a path and scaled values p.

    Stops when an iteration is expected to gain less than ``tolerance`` of log likelihood, after at most ``iterations``
    linearisations. steady: the sizes of what is random stay as they are.
    """
    active = active_states(steps, free.symbols, theta)
    low, high = (free.lower - free.mean) / free.std, (free.upper - free.mean) / free.std
    typical = initial_noise(steps.ship, data)
    floor = NoiseModel(
        0.02 * typical.force, typical.tau, 0.02 * typical.white, 0.02 * typical.white, typical.colour_tau
    )

    def coefficients(p: np.ndarray) -> np.ndarray:
        return set_values(steps.ship, data, theta, free.columns, free.mean + free.std * p)

    p = np.clip(np.zeros(len(low)) if p is None else p, low, high)
    now = _Point(p, initial_trajectory(steps, data, coefficients(p)) if path is None else path, noise)
    best: tuple | None = None
    share, halved, converged, used = 1.0, 0, False, 0
    while used < iterations:
        used += 1
        linearised = linearise_and_filter(steps, data, coefficients(now.p), now.path, now.noise, free, now.p, active)
        if best is not None and not linearised.nll < best[0].nll + 0.5 * tolerance + 0.05 * best[4] and halved < 2:
            halved, share = halved + 1, 0.3 * share
            start, (dp, dz, df) = best[0], best[1]
            now = _moved(start, dp, dz, df, share, low, high)
            continue
        share, halved = 1.0, 0
        flat = linearised.white.reshape(-1, len(p) + 1)
        gram = flat.T @ flat
        A = gram[:-1, :-1] + np.eye(len(p))
        slope = gram[:-1, -1] + now.p + linearised.logdet_gradient.sum(axis=0)
        dp = bounded_step(A, slope, now.p, low, high)
        gain = -float(slope @ dp + 0.5 * dp @ A @ dp)
        mean, r, u = smoothed(
            linearised.system,
            linearised.filter,
            linearised.white[..., -1] + linearised.white[..., :-1] @ dp,
            linearised.states[..., -1] + linearised.states[..., :-1] @ dp,
        )
        dz = np.zeros_like(now.path.z)
        dz[..., active], df = mean[..., : len(active)], mean[..., len(active) : len(active) + 3]
        renewed_noise = (
            now.noise if steady else updated_noise(now.noise, data, linearised.adjoint, r, u, len(active), floor)
        )
        here = _Point(now.p, now.path, now.noise, linearised.nll)
        best = (here, (dp, dz, df), A, linearised, gain)
        pairs = ((renewed_noise.force, now.noise.force), (renewed_noise.white, now.noise.white))
        quiet = max(float(np.abs(np.log(new / old)).max()) for new, old in pairs) < 0.05
        if gain < tolerance and quiet:
            converged = True
            break
        now = _moved(_Point(now.p, now.path, renewed_noise, linearised.nll), dp, dz, df, 1.0, low, high)
    assert best is not None
    here, _, A, linearised, _ = best
    return Estimate(
        coefficients(here.p), free, here.p, np.linalg.inv(A), here.path, here.noise, here.nll, used, converged
    )


def _moved(
    start: _Point, dp: np.ndarray, dz: np.ndarray, df: np.ndarray, share: float, low: np.ndarray, high: np.ndarray
) -> _Point:
    """A part of the way."""
    path = Trajectory(start.path.z + share * dz, start.path.force + share * df)
    return _Point(np.clip(start.p + share * dp, low, high), path, start.noise)

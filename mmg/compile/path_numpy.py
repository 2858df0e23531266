"""What ``mmg.compile.paths.PathCode`` does, in numpy: the portable path, and what the code must agree with."""

from __future__ import annotations

import numpy as np

from mmg.compile.batch import BatchFunction
from mmg.compile.paths import Entries, WindowPaths
from mmg.runge_kutta import NODES, WEIGHTS, rk4_step

BLOCK = 256
"""Points of a block: its arrays stay in the processor's cache."""


class PortablePaths:
    """The functions of ``PathCode``, which say what they take and return."""

    def steps(
        self,
        paths: WindowPaths,
        jacobian: BatchFunction,
        wanted: Entries,
        A: int,
        of_G: np.ndarray,
        of_force: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Ends of a step and its Jacobian by states, coefficients and force: as of ``PathCode``."""
        K, R, S = len(paths.inputs), *paths.z.shape[1:]
        W = int(max([A - 1, *of_G, *of_force])) + 1
        start, held, theta = _at_steps(paths, paths.z[:-1])
        end, J = np.empty((K * R, S)), np.empty((K * R, A, W))
        for first in range(0, K * R, BLOCK):
            s = slice(first, min(first + BLOCK, K * R))
            end[s], J[s] = _step(paths, start[:, s], held[:, s], theta[:, s], jacobian, wanted, (A, W))
        J = J.reshape(K, R, A, W)
        return end.reshape(K, R, S), J[..., :A], J[..., of_G], J[..., of_force]

    def logged(
        self, paths: WindowPaths, jacobian: BatchFunction, wanted: Entries, A: int, d: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Logged columns and their Jacobian by states and coefficients: as of ``PathCode``."""
        K1, R = paths.z.shape[:2]
        y, nonzeros = jacobian.at(_flat(paths.z), spread_over(paths.theta, K1 * R))
        J = np.zeros((K1 * R, 6, A + d))
        J[:, wanted.row, wanted.column] = nonzeros[wanted.entry].T
        J = J.reshape(K1, R, 6, A + d)
        return y.T.reshape(K1, R, 6), J[..., :A], J[..., A:]

    def weighted(
        self, paths: WindowPaths, gradient: BatchFunction, of_rates: bool, weight: np.ndarray, source: np.ndarray
    ) -> np.ndarray:
        """Sums by window of the gradient of a weighted Jacobian: as of ``PathCode``."""
        K, R = weight.shape[:2]
        flat = weight.reshape(K * R, -1)
        chosen = np.where(source >= 0, flat[:, source], 0.0).T
        if of_rates:
            middle, held, theta = _at_steps(paths, 0.5 * (paths.z[:-1] + paths.z[1:]))
            found = gradient.at(middle, held[: paths.C], theta, chosen)[0]
        else:
            found = gradient.at(_flat(paths.z), spread_over(paths.theta, K * R), chosen)[0]
        return np.asarray(found.reshape(-1, K, R).sum(axis=1).T)

    def follow(self, paths: WindowPaths, rates: BatchFunction, carried: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """The paths with states simulated from the first on: as of ``PathCode``."""
        z = np.array(paths.z, dtype=float)
        for k in range(len(paths.inputs)):
            force = None if paths.force is None else paths.force[k].T
            theta = pushed(paths.theta, force, paths.force_at, z.shape[1])
            end = advanced(rates, z[k].T, paths.inputs[k].T, theta, paths.h, paths.C).T
            z[k + 1] = np.where(carried | whole[k][:, None], end, z[k + 1])
        return z


def advanced(
    rates: BatchFunction, z: np.ndarray, controls: np.ndarray, theta: np.ndarray, h: float, C: int
) -> np.ndarray:
    """States (S, M) a step of h [s] after z (S, M) under ``controls``, inputs (C, M) or with their changes behind (2 C,
    M). rates: (z, inputs, theta) -> rates; theta: coefficients (all,) or (all, M); C: number of inputs."""
    return rk4_step(lambda state, part: rates.at(state, _during(controls, part, C), theta)[0], z, h)


def pushed(theta: np.ndarray, force: np.ndarray | None, at: np.ndarray | None, points: int) -> np.ndarray:
    """Coefficients by point (all, points) with a ``force`` (3, points) added to those ``at`` (3,), or without one.

    theta: (all,), or (all, R) by window where the points are K times those of R windows.
    """
    every = spread_over(theta, points)
    if force is not None:
        every = every.copy()
        every[at] += force
    return every


def spread_over(theta: np.ndarray, points: int) -> np.ndarray:
    """Coefficients (all, points) from ``theta`` (all,), or from (all, R) of R windows that repeat up to ``points``."""
    return (
        np.tile(theta, (1, points // theta.shape[1])) if theta.ndim > 1 else np.repeat(theta[:, None], points, axis=1)
    )


def _flat(z: np.ndarray) -> np.ndarray:
    """Points (S, M) of a path (K, R, S)."""
    return np.ascontiguousarray(z.reshape(-1, z.shape[2]).T)


def _at_steps(paths: WindowPaths, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States z (K, R, S), inputs and coefficients of all steps as points."""
    K, R = paths.inputs.shape[:2]
    force = None if paths.force is None else paths.force.reshape(-1, 3).T
    return _flat(z), paths.inputs.reshape(K * R, -1).T, pushed(paths.theta, force, paths.force_at, K * R)


def _during(controls: np.ndarray, part: float, C: int) -> np.ndarray:
    """Inputs (C, M) after a part of the step; controls: as of ``advanced``."""
    mean, change = controls[:C], controls[C:]
    return mean + (part - 0.5) * change if len(change) else mean


def _step(
    paths: WindowPaths,
    z: np.ndarray,
    c: np.ndarray,
    theta: np.ndarray,
    jacobian: BatchFunction,
    wanted: Entries,
    shape: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray]:
    """End (m, S) of one step from z (S, m) under c, (C, m) or (2 C, m), and the wanted part of its Jacobian (m, *shape)
    whose first columns are those of its rows."""
    m, (A, W), h = z.shape[1], shape, paths.h
    rate, total = np.zeros_like(z), np.zeros_like(z)
    straight = np.zeros((m, A, W))
    straight[:, np.arange(A), np.arange(A)] = 1.0
    slope, summed = np.zeros_like(straight), np.zeros_like(straight)
    for fraction, weight in zip(NODES, WEIGHTS, strict=True):
        rate, nonzeros = jacobian.at(z + fraction * h * rate, _during(c, fraction, paths.C), theta)
        J = np.zeros((m, A, W))
        J[:, wanted.row, wanted.column] = nonzeros[wanted.entry].T
        slope = J[:, :, :A] @ (straight + fraction * h * slope)
        slope[:, :, A:] += J[:, :, A:]
        total += weight * rate
        summed += weight * slope
    return (z + h * total).T, straight + h * summed

"""Paths of many windows of a ship: steps with sensitivities, logged columns, weighted second derivatives, rollouts.

What the ship is comes from its batch kernels (``mmg.compile.batch``). Steps with sensitivities and rollouts are in C,
which calls such a kernel through a pointer, so that it is compiled once for all ships; its points are LANES steps of a
window, in a rollout LANES windows. Without a compiler they are in numpy.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache

import numpy as np

from mmg.compile.batch import BatchFunction
from mmg.compile.cache import load_library
from mmg.compile.codegen import c_file, prelude
from mmg.runge_kutta import NODES, WEIGHTS, rk4_step

FLAGS = (
    "-O2",
    "-ftree-vectorize",
    "-fPIC",
    "-shared",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
    "-w",
)

BLOCK = 256
"""Points of a block in numpy: its arrays stay in the processor's cache."""


@dataclass(frozen=True)
class WindowPaths:
    """Paths of R windows over K steps of h [s] of a ship with S states and C inputs.

    z: (K + 1, R, S) states; inputs: (K, R, C) means over each step, or with their changes over it behind them (K, R, 2
    C); theta: coefficients (all,) or by window (all, R); force: (K, R, 3) added over each step to the coefficients at
    ``force_at`` (3,), or None; count: (R,) steps of each window that exist, or None for all.
    """

    z: np.ndarray
    inputs: np.ndarray
    theta: np.ndarray
    h: float
    C: int
    force: np.ndarray | None = None
    force_at: np.ndarray | None = None
    count: np.ndarray | None = None


@dataclass(frozen=True)
class Entries:
    """Nonzeros of a sparse Jacobian that are wanted, and where they go: entry (e,) positions among all ``nonzeros`` of
    it, row (e,) and column (e,) in the wanted matrix."""

    entry: np.ndarray
    row: np.ndarray
    column: np.ndarray
    nonzeros: int

    @classmethod
    def chosen(cls, at: tuple[np.ndarray, np.ndarray], row: np.ndarray, column: np.ndarray) -> Entries:
        """Those whose rows and columns are wanted. at: rows and columns of all nonzeros; row, column: place in the
        wanted matrix of each row and each column, -1: not wanted."""
        kept = np.flatnonzero((row[at[0]] >= 0) & (column[at[1]] >= 0))
        return cls(kept, row[at[0][kept]], column[at[1][kept]], len(at[0]))


class _Path(ctypes.Structure):
    """The struct Path of the C code."""

    _fields_ = [
        *((name, ctypes.c_longlong) for name in ("K", "R", "S", "C", "all", "changes", "by_window")),
        *((name, ctypes.c_void_p) for name in ("z", "inputs", "theta", "force", "force_at", "count")),
        ("h", ctypes.c_double),
    ]


class _Steps(ctypes.Structure):
    """The struct Steps of the C code."""

    _fields_ = [(name, ctypes.c_longlong) for name in ("A", "W", "P", "count", "nonzeros", "direct")] + [
        (name, ctypes.c_void_p)
        for names in ("entry first column own_entry own_place of_G of_force", "end F G force")
        for name in names.split()
    ]


def steps(
    paths: WindowPaths,
    jacobian: BatchFunction,
    wanted: Entries,
    A: int,
    of_G: np.ndarray,
    of_force: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ends (K, R, S) of a Runge-Kutta step from each state of the paths, and its Jacobian by the A chosen states
    (K, R, A, A), by P coefficients (K, R, A, P) and by the force (K, R, A, 3); of steps that do not exist, 0.

    jacobian: (z, inputs, theta) -> (rates, their Jacobian); wanted: of its nonzeros, columns below A being
    the chosen states and the others coefficients; of_G: (P,), of_force: (3,) columns of these coefficients.
    """
    K, R, S = len(paths.inputs), *paths.z.shape[1:]
    P, W = len(of_G), int(max([A - 1, *of_G, *of_force])) + 1
    if jacobian.library is None or path_code() is None:
        start, held, theta = _at_steps(paths, paths.z[:-1])
        end, J = np.empty((K * R, S)), np.empty((K * R, A, W))
        for first in range(0, K * R, BLOCK):
            s = slice(first, first + BLOCK)
            end[s], J[s] = _step(paths, start[:, s], held[:, s], theta[:, s], jacobian, wanted, (A, W))
        J = J.reshape(K, R, A, W)
        return end.reshape(K, R, S), J[..., :A], J[..., of_G], J[..., of_force]
    empty = np.empty if paths.count is None else np.zeros
    out = empty((K, R, S)), empty((K, R, A, A)), empty((K, R, A, P)), empty((K, R, A, 3))
    through = np.flatnonzero(wanted.column < A)
    through = through[np.argsort(wanted.row[through], kind="stable")]
    rows = np.searchsorted(wanted.row[through], np.arange(A + 1))
    direct = np.flatnonzero(wanted.column >= A)
    places = wanted.row[direct] * W + wanted.column[direct]
    own = (wanted.entry[through], rows, wanted.column[through], wanted.entry[direct], places, of_G, of_force)
    table = [np.ascontiguousarray(a, dtype=np.int64) for a in own]
    sizes = (A, W, P, len(through), wanted.nonzeros, len(direct))
    request = _Steps(*sizes, *(a.ctypes.data for a in (*table, *out)))
    _call("steps", paths, jacobian, ctypes.byref(request))
    return out


def _call(name: str, paths: WindowPaths, kernel: BatchFunction, *rest: object) -> None:
    """Call the compiled function ``name`` with the paths, the kernel and what else it takes."""
    (K, R), given = paths.inputs.shape[:2], (paths.z, paths.inputs, paths.theta, paths.force)
    numbers = [None if a is None else np.ascontiguousarray(a, dtype=float) for a in given]
    whole = [None if a is None else np.ascontiguousarray(a, dtype=np.int64) for a in (paths.force_at, paths.count)]
    path = _Path(
        *(K, R, paths.z.shape[2], paths.C, len(paths.theta), paths.inputs.shape[2] > paths.C, paths.theta.ndim > 1),
        *(None if a is None else a.ctypes.data for a in (*numbers, *whole)),
        paths.h,
    )
    function = ctypes.cast(getattr(kernel.library, kernel.function.name()), ctypes.c_void_p)
    if getattr(path_code(), name)(ctypes.byref(path), function, *rest):
        raise MemoryError(f"no memory for {R} windows of {K} steps")


@cache
def path_code() -> ctypes.CDLL | None:
    """The compiled functions, None where they do not compile."""
    nodes, weights = (", ".join(repr(float(x)) for x in values) for values in (NODES, WEIGHTS))
    return load_library(prelude() + c_file(__file__, "paths.c", nodes=nodes, weights=weights), FLAGS)[0]


def logged(
    paths: WindowPaths, jacobian: BatchFunction, wanted: Entries, A: int, d: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Logged columns (K + 1, R, 6) along the paths, their Jacobian by A states (K + 1, R, 6, A) and by d coefficients
    (K + 1, R, 6, d).

    jacobian: (z, theta) -> (columns, their Jacobian); wanted: of its nonzeros, columns below A being the states.
    """
    K1, R = paths.z.shape[:2]
    y, nonzeros = jacobian.at(_flat(paths.z), spread_over(paths.theta, K1 * R))
    J = np.zeros((K1 * R, 6, A + d))
    J[:, wanted.row, wanted.column] = nonzeros[wanted.entry].T
    J = J.reshape(K1, R, 6, A + d)
    return y.T.reshape(K1, R, 6), J[..., :A], J[..., A:]


def weighted(
    paths: WindowPaths, gradient: BatchFunction, of_rates: bool, weight: np.ndarray, source: np.ndarray
) -> np.ndarray:
    """Sums (R, P) over the steps of each window of the ``paths`` of the gradient of a weighted Jacobian.

    gradient: (z, inputs, theta, weights) -> (P,) at the middle of each step where it is ``of_rates``, or (z, theta,
    weights) -> (P,) at each state; weight: (K or K + 1, R, ...) numbers, of which each point takes those at ``source``
    as its weights (-1: zero).
    """
    K, R = weight.shape[:2]
    flat = weight.reshape(K * R, -1)
    chosen = np.where(source >= 0, flat[:, source], 0.0).T
    if of_rates:
        middle, held, theta = _at_steps(paths, 0.5 * (paths.z[:-1] + paths.z[1:]))
        found = gradient.at(middle, held[: paths.C], theta, chosen)[0]
    else:
        found = gradient.at(_flat(paths.z), spread_over(paths.theta, K * R), chosen)[0]
    return np.asarray(found.reshape(-1, K, R).sum(axis=1).T)


def follow(paths: WindowPaths, rates: BatchFunction, carried: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """The paths (K + 1, R, S) with states simulated from the first on by their ``rates`` (z, inputs, theta): those that
    are ``carried`` (S,), and all of them after the steps marked in ``whole`` (K, R); the others stay as given."""
    z = np.array(paths.z, dtype=float, order="C")
    if rates.library is not None and path_code() is not None:
        marks = [np.ascontiguousarray(a, dtype=np.uint8) for a in (carried, whole)]
        _call("follow", paths, rates, *(ctypes.c_void_p(a.ctypes.data) for a in (*marks, z)))
        return z
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

"""Paths of many windows gone along in C: steps with sensitivities, logged columns, weighted second derivatives,
rollouts. What a ship is comes from its batch kernels (``mmg.compile.batch``)."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache

import numpy as np

from mmg.compile.batch import BatchFunction
from mmg.compile.cache import load_library
from mmg.compile.kernel_threads import even_shares, in_threads
from mmg.compile.path_c import FLAGS, source


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
        *((name, ctypes.c_longlong) for name in ("K", "R", "S", "C", "all", "changes", "by_window", "begin", "end")),
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


class _Logged(ctypes.Structure):
    """The struct Logged of the C code."""

    _fields_ = [(name, ctypes.c_longlong) for name in ("A", "d", "count", "nonzeros")] + [
        (name, ctypes.c_void_p) for name in ("entry", "row", "column", "y", "H", "D")
    ]


class PathCode:
    """The compiled functions of a ``library`` of ``mmg.compile.path_c``."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library

    def steps(
        self,
        paths: WindowPaths,
        jacobian: BatchFunction,
        wanted: Entries,
        A: int,
        of_G: np.ndarray,
        of_force: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Ends (K, R, S) of a Runge-Kutta step from each state of the paths, and its Jacobian by the A chosen states
        (K, R, A, A), by P coefficients (K, R, A, P) and by the force (K, R, A, 3); of steps that do not exist, 0.

        jacobian: compiled (z, inputs, theta) -> (rates, their Jacobian); wanted: of its nonzeros, columns below A being
        the chosen states and the others coefficients; of_G: (P,), of_force: (3,) columns of these coefficients.
        """
        K, R, S = len(paths.inputs), *paths.z.shape[1:]
        P, W = len(of_G), int(max([A - 1, *of_G, *of_force])) + 1
        empty = np.empty if paths.count is None else np.zeros
        out = empty((K, R, S)), empty((K, R, A, A)), empty((K, R, A, P)), empty((K, R, A, 3))
        through = np.flatnonzero(wanted.column < A)
        through = through[np.argsort(wanted.row[through], kind="stable")]
        first = np.searchsorted(wanted.row[through], np.arange(A + 1))
        direct = np.flatnonzero(wanted.column >= A)
        places = wanted.row[direct] * W + wanted.column[direct]
        own = (wanted.entry[through], first, wanted.column[through], wanted.entry[direct], places)
        table = [_whole(a) for a in (*own, of_G, of_force)]
        sizes = (A, W, P, len(through), wanted.nonzeros, len(direct))
        request = _Steps(*sizes, *(a.ctypes.data for a in (*table, *out)))
        self._run("steps", paths, jacobian, ctypes.byref(request))
        return out

    def logged(
        self, paths: WindowPaths, jacobian: BatchFunction, wanted: Entries, A: int, d: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Logged columns (K + 1, R, 6) along the paths, their Jacobian by A states (K + 1, R, 6, A) and by d
        coefficients (K + 1, R, 6, d).

        jacobian: compiled (z, theta) -> (columns, their Jacobian); wanted: of its nonzeros, columns below A being the
        states.
        """
        K1, R = paths.z.shape[:2]
        y, H, D = np.zeros((K1, R, 6)), np.zeros((K1, R, 6, A)), np.zeros((K1, R, 6, d))
        table = [_whole(a) for a in (wanted.entry, wanted.row, wanted.column)]
        request = _Logged(A, d, len(wanted.entry), wanted.nonzeros, *(a.ctypes.data for a in (*table, y, H, D)))
        self._run("logged", paths, jacobian, ctypes.byref(request))
        return y, H, D

    def weighted(
        self, paths: WindowPaths, gradient: BatchFunction, of_rates: bool, weight: np.ndarray, source: np.ndarray
    ) -> np.ndarray:
        """Sums (R, P) over the steps of each window of the gradient of a weighted Jacobian.

        gradient: compiled (z, inputs, theta, weights) -> (P,) at the middle of each step where it is ``of_rates``, or
        (z, theta, weights) -> (P,) at each state; weight: (K or K + 1, R, ...) numbers, of which each point takes those
        at ``source`` as its weights (-1: zero).
        """
        P, R = gradient.function.nnz_out(0), paths.z.shape[1]
        weight, out = _real(weight.reshape(*weight.shape[:2], -1)), np.zeros((R, P))
        at = _whole(source)
        wide, sizes = weight.shape[2], ctypes.c_longlong
        rest = (sizes(of_rates), sizes(len(at)), _at(at), sizes(wide), _at(weight), sizes(P), _at(out))
        self._run("weighted", paths, gradient, *rest)
        return out

    def follow(self, paths: WindowPaths, rates: BatchFunction, carried: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """The paths (K + 1, R, S) with states simulated from the first on: those that are ``carried`` (S,), and all of
        them after the steps marked in ``whole`` (K, R); the others stay as given.

        rates: compiled (z, inputs, theta) -> rates.
        """
        z = np.array(paths.z, dtype=float, order="C")
        marks = [np.ascontiguousarray(a, dtype=np.uint8) for a in (carried, whole)]
        self._run("follow", paths, rates, *(_at(a) for a in (*marks, z)))
        return z

    def _run(self, name: str, paths: WindowPaths, kernel: BatchFunction, *rest: object) -> None:
        """Call a function with the paths, the kernel and what else it takes."""
        K, R, S = len(paths.inputs), *paths.z.shape[1:]
        z, inputs, theta = (_real(a) for a in (paths.z, paths.inputs, paths.theta))
        force = None if paths.force is None else _real(paths.force)
        at = _whole(np.zeros(3) if paths.force_at is None else paths.force_at)
        count = None if paths.count is None else _whole(paths.count)
        sizes = (K, R, S, paths.C, len(theta), inputs.shape[2] > paths.C, theta.ndim > 1)
        places = [None if a is None else a.ctypes.data for a in (z, inputs, theta, force, at, count)]
        function = ctypes.cast(getattr(kernel.library, kernel.function.name()), ctypes.c_void_p)
        work = getattr(self._library, name)

        def part(begin: int, end: int) -> int:
            path = _Path(*sizes, begin, end, *places, paths.h)
            return int(work(ctypes.byref(path), function, *rest))

        if in_threads(part, even_shares(R) if name != "follow" else [(0, R)]):
            raise MemoryError(f"no memory for {R} windows of {K} steps")


@cache
def path_code() -> PathCode | None:
    """The compiled functions, None where they do not compile."""
    library, _ = load_library(source(), FLAGS)
    return None if library is None else PathCode(library)


def _real(a: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(a, dtype=float)


def _whole(a: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(a, dtype=np.int64)


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)

"""Kalman filter, responses, smoother and adjoint of ``diagnosis.estimation.kalman``, by C code where it compiles.

The functions in numpy are the portable path, and what the code must agree with on a small system before it is used.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache

import numpy as np

from diagnosis.estimation import kalman
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.filter_self_test import agrees
from diagnosis.estimation.kalman import Adjoint, Filtered, LinearSystem, SystemParts
from diagnosis.estimation.kalman_c import source
from mmg.compile.cache import load_library
from mmg.compile.codegen import LANES
from mmg.compile.kernel_threads import even_shares, in_threads
from mmg.compile.path_c import FLAGS
from mmg.compile.recycled import room
from mmg.progress import LOGGER


def filtered(s: LinearSystem) -> Filtered:
    """Covariances and gains of the system ``s``. Raises LinAlgError where a covariance is singular."""
    code = _kernel()
    return code.filtered(s) if code else kalman.filtered(s)


def whitened(
    s: LinearSystem,
    f: Filtered,
    columns: DrivenColumns,
    out: np.ndarray | None = None,
    with_states: bool = False,
    rows: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened responses (K + 1, R, 6, c) of ``columns``, written into ``out`` if given, and their predicted states
    (K + 1, R, n, c), an empty array where these are not wanted.

    s, f: system and its filter run; out: (K + 1, R, 6, c), columns of a larger array or not; with_states: whether the
    states are wanted; rows: (k,) rising grid times of which responses are wanted, the only ones in what is returned
    and in ``out`` (default: all).
    """
    if out is None:
        out = np.empty((len(s.good) if rows is None else len(rows), *s.good.shape[1:], columns.width))
    code = _kernel()
    if code:
        return out, code.whitened(s, f, columns, out, with_states, rows)
    forcing, observed = columns.forcing, columns.dense_observed
    if columns.scale is not None:
        forcing, observed = forcing * columns.scale[:, None], observed * columns.scale[:, None]
    every, states = kalman.responses(s, f, forcing, observed, columns.start)
    out[...] = every if rows is None else every[rows]
    return out, states if with_states else np.empty(0)


def observations(s: LinearSystem, f: Filtered, white: np.ndarray) -> np.ndarray:
    """The deviations (K + 1, R, 6, c) of what is logged from the path without random forces whose whitened residuals
    are ``white`` (K + 1, R, 6, c). s, f: system and its filter run."""
    code = _kernel()
    return code.observations(s, f, white) if code else kalman.observations(s, f, white)


def smoothed(
    s: LinearSystem, f: Filtered, white: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smoothed states (K + 1, R, n), and the smoother's r (K, R, n) and u (K + 1, R, 6), from the residual's column.

    s, f: system and its filter run; white: (K + 1, R, 6), states: (K + 1, R, n) of that column by ``whitened``.
    """
    code = _kernel()
    return code.smoothed(s, f, white, states) if code else kalman.smoothed(s, f, white, states)


def adjoint(s: LinearSystem, f: Filtered) -> Adjoint:
    """Derivatives of the filter run ``f`` of the system ``s``."""
    code = _kernel()
    return code.adjoint(s, f) if code else kalman.adjoint(s, f)


def by_rates(s: LinearSystem, found: Adjoint, A: int, h: float, gusts: np.ndarray | None = None) -> np.ndarray:
    """Derivative (K, R, A, A + 3) of 1/2 log det by the Jacobian of the rates of the first A states, times the step h
    [s]. s: the system; found: its adjoint; gusts: as of ``GriddedTrials``."""
    return (_kernel() or kalman).by_rates(s, found, A, h, gusts)


def assembled(parts: SystemParts) -> tuple[np.ndarray, np.ndarray]:
    """T (K, R, n, n) and Z (K + 1, R, 6, n) of the system of these ``parts``."""
    return (_kernel() or kalman).assembled(parts)


_ARRAYS = (
    *("T", "Z", "Q", "white", "first", "good", "inside"),
    *("gain", "P", "inverse", "root", "log_det"),
    *("t", "t_at", "z", "z_at"),
)
"""Arrays of the struct System: of the system, of its filter run, and where numbers are not zero."""


class _System(ctypes.Structure):
    """The struct System of the C code."""

    _fields_ = [(name, ctypes.c_longlong) for name in ("K", "R", "n", "S", "begin", "end")] + [
        (name, ctypes.c_void_p) for name in _ARRAYS
    ]


class _DrivenColumns(ctypes.Structure):
    """The struct Columns of the C code."""

    _fields_ = [(name, ctypes.c_longlong) for name in ("c", "m", "d", "apart")] + [
        (name, ctypes.c_void_p)
        for name in ("forcing", "scale", "observed", "start", "observing", "white", "states", "place")
    ]


def _real(a: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(a, dtype=float)


class Kernel:
    """The compiled functions of a ``library``; each does what the function of its name in this module says."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library

    def _run(self, name: str, s: LinearSystem, f: Filtered, *rest: object, together: int = LANES) -> None:
        """Call a function with the system, its filter run and what else it takes; together: windows that it takes at a
        time, which no two threads share."""
        arrays = [_real(a) for a in (s.T, s.Z, s.Q, s.R, s.first)]
        arrays += [_marks(a) for a in (s.good, s.inside)]
        arrays += [_real(a) for a in (f.gain, f.P, f.inverse, f.root, f.log_det)]
        named = dict(zip(_ARRAYS, (*arrays, *s.places), strict=True))
        self._over_windows(name, (*s.T.shape[:3], s.S), named, *rest, together=together)

    def _over_windows(
        self, name: str, sizes: tuple[int, ...], arrays: Mapping[str, np.ndarray], *rest: object, together: int = 1
    ) -> None:
        """Call a function on shares of the windows; sizes: K, R, n and S of the system; arrays: of it, by name; rest,
        together: as of ``_run``."""
        work, places = getattr(self._library, name), {key: a.ctypes.data for key, a in arrays.items()}

        def part(begin: int, end: int) -> int:
            return int(work(ctypes.byref(_System(*sizes, begin, end, **places)), *rest))

        R = sizes[1]
        shares = even_shares(-(-R // together))
        failed = in_threads(part, [(begin * together, min(end * together, R)) for begin, end in shares])
        if failed == 1:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        if failed == 2:
            raise MemoryError(f"no memory for the filter of {R} windows")

    def filtered(self, s: LinearSystem) -> Filtered:
        """As the function."""
        K, R, n = s.T.shape[:3]
        f = Filtered(
            gain=room(K, R, n, 6),
            P=room(K + 1, R, n, n),
            inverse=room(K + 1, R, 6, 6),
            root=room(K + 1, R, 6, 6),
            log_det=np.empty(R),
        )
        self._run("filter", s, f)
        return f

    def whitened(
        self,
        s: LinearSystem,
        f: Filtered,
        columns: DrivenColumns,
        out: np.ndarray,
        with_states: bool,
        rows: np.ndarray | None = None,
    ) -> np.ndarray:
        """As the function; returns the states."""
        K, R, n = s.T.shape[:3]
        m, c = columns.forcing.shape[2:]
        states = room(K + 1, R, n, c) if with_states else np.empty(0)
        given = (columns.forcing, columns.scale, columns.observed, columns.start)
        arrays = [None if a is None else _real(a) for a in given]
        at = np.ascontiguousarray(columns.observing, dtype=np.int64)
        apart = out.strides[2] // out.itemsize
        made = out if out.strides == _strides(out.shape[:3], apart) else room(*out.shape)
        place = None
        if rows is not None:
            place = np.full(K + 1, -1, dtype=np.int64)
            place[rows] = np.arange(len(rows))
        request = _DrivenColumns(
            c, m, len(at), made.strides[2] // made.itemsize,
            *(None if a is None else a.ctypes.data for a in arrays),
            at.ctypes.data, made.ctypes.data, states.ctypes.data if with_states else None,
            None if place is None else place.ctypes.data,
        )  # fmt: skip
        self._run("responses", s, f, ctypes.byref(request), together=LANES if c == 1 else 1)
        if made is not out:
            out[...] = made
        return states

    def observations(self, s: LinearSystem, f: Filtered, white: np.ndarray) -> np.ndarray:
        """As the function."""
        white = _real(white)
        y = np.empty(white.shape)
        self._run("observations", s, f, ctypes.c_longlong(white.shape[3]), _at(white), _at(y), together=1)
        return y

    def smoothed(
        self, s: LinearSystem, f: Filtered, white: np.ndarray, states: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As the function."""
        K, R, n = s.T.shape[:3]
        white, states = _real(white), _real(states)
        mean, r, u = np.empty((K + 1, R, n)), np.empty((K, R, n)), np.empty((K + 1, R, 6))
        self._run("smoothed", s, f, *(_at(a) for a in (white, states, mean, r, u)))
        return mean, r, u

    def adjoint(self, s: LinearSystem, f: Filtered) -> Adjoint:
        """As the function."""
        K, R, n = s.T.shape[:3]
        found = Adjoint(room(K, R, n, n), room(K + 1, R, 6, n), np.zeros((K, R, n)), np.empty((K + 1, R, 6)))
        self._run("adjoint", s, f, *(_at(a) for a in (found.by_T, found.by_Z, found.N, found.D)))
        return found

    def by_rates(
        self, s: LinearSystem, found: Adjoint, A: int, h: float, gusts: np.ndarray | None = None
    ) -> np.ndarray:
        """As the function."""
        K, R, n = s.T.shape[:3]
        out, by_T, blown = room(K, R, A, A + 3), _real(found.by_T), None if gusts is None else _real(gusts)
        rest = (ctypes.c_longlong(A), ctypes.c_double(h), _at(by_T), None if blown is None else _at(blown), _at(out))
        self._over_windows("by_rates", (K, R, n, s.S), {"T": _real(s.T), "inside": _marks(s.inside)}, *rest)
        return out

    def assembled(self, parts: SystemParts) -> tuple[np.ndarray, np.ndarray]:
        """As the function."""
        linear, K, R, S = parts.linear, *parts.linear.force.shape[:3]
        n = S + len(parts.decay)
        T, Z = room(K, R, n, n), room(K + 1, R, 6, n)
        given = [_real(a) for a in (linear.F, linear.force, linear.H, parts.decay)]
        given.append(np.ascontiguousarray(parts.coloured, dtype=np.int64))
        blown = None if parts.gusts is None else _real(parts.gusts)
        rest = [ctypes.c_longlong(len(parts.coloured)), *(_at(a) for a in given), None if blown is None else _at(blown)]
        marks = {"good": _marks(parts.good), "inside": _marks(parts.inside)}
        self._over_windows("assembled", (K, R, n, S), marks, *rest, _at(T), _at(Z))
        return T, Z


def _marks(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.uint8)


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _strides(shape: tuple[int, ...], apart: int) -> tuple[int, ...]:
    """Strides [bytes] of an array (*shape, c) whose last axis is contiguous, its rows ``apart`` numbers apart."""
    _, R, rows = shape
    return tuple(8 * size for size in (R * rows * apart, rows * apart, apart, 1))


@cache
def _kernel() -> Kernel | None:
    """The compiled functions, or None where they do not compile or do not agree with numpy."""
    library, _ = load_library(source(), FLAGS)
    if library is None:
        return None
    code = Kernel(library)
    if agrees(code):
        return code
    LOGGER.warning("the compiled filter does not agree with numpy, which is used instead")
    return None


def forget_code() -> None:
    """Choose again between code and numpy when the filter is next used."""
    _kernel.cache_clear()

"""Filter, responses, smoother and adjoint of ``diagnosis.estimation.kalman``, by C code where it compiles.

The functions in numpy are the portable path, and what the code must agree with on a small system before it is kept.
Each function of the C code goes through the windows from begin to end, one after the other, and takes eight columns of
a row at a time. Arrays are those of the functions in numpy, row by row; of the transitions and the observations only
those numbers are read that are not zero in any window.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np

from diagnosis.estimation import kalman
from diagnosis.estimation.kalman import Adjoint, DrivenColumns, Filtered, LinearSystem
from mmg.compile.batch import LOOP_FLAGS, differences
from mmg.compile.cache import load_library
from mmg.compile.codegen import c_file, prelude

# Arrays of the struct System: of the system, of its filter run, and where numbers are not zero.
_ARRAYS = (
    *("T", "Z", "Q", "white", "first", "good", "inside"),
    *("gain", "P", "inverse", "root", "log_det"),
    *("t", "t_at", "z", "z_at"),
)


class _System(ctypes.Structure):
    """The struct System of the C code."""

    _fields_ = [(name, ctypes.c_longlong) for name in ("K", "R", "n", "S")] + [
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


def _over_windows(library: ctypes.CDLL, name: str, s: LinearSystem, f: Filtered | None, *rest: object) -> None:
    """Call a function of the ``library`` with the system, its filter run if it takes one, and what else it takes."""
    arrays = [_real(a) for a in (s.T, s.Z, s.Q, s.R, s.first)]
    arrays += [np.ascontiguousarray(a, dtype=np.uint8) for a in (s.good, s.inside)]
    run = [None] * 5 if f is None else [_real(a) for a in (f.gain, f.P, f.inverse, f.root, f.log_det)]
    every = (*arrays, *run, *s.places)
    system = _System(*s.T.shape[:3], s.S, *(None if a is None else a.ctypes.data for a in every))
    failed = getattr(library, name)(ctypes.byref(system), *rest)
    if failed == 1:
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    if failed == 2:
        raise MemoryError(f"no memory for the filter of {s.T.shape[1]} windows")


class CompiledFilter:
    """The functions ``filtered``, ``whitened``, ``smoothed``, ``adjoint`` and ``by_rates`` of ``kalman``, with their
    arguments, by the compiled ``library``."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.library = library

    def filtered(self, s: LinearSystem) -> Filtered:
        """As ``kalman.filtered`` of ``s``."""
        K, R, n = s.T.shape[:3]
        f = Filtered(
            gain=np.empty((K, R, n, 6)),
            P=np.empty((K + 1, R, n, n)),
            inverse=np.empty((K + 1, R, 6, 6)),
            root=np.empty((K + 1, R, 6, 6)),
            log_det=np.empty(R),
        )
        _over_windows(self.library, "filter", s, f)
        return f

    def whitened(
        self,
        s: LinearSystem,
        f: Filtered,
        columns: DrivenColumns,
        out: np.ndarray | None = None,
        with_states: bool = False,
        rows: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """As ``kalman.whitened`` of ``s``, ``f``, ``columns``, ``out``, ``with_states`` and ``rows``."""
        K, R, n = s.T.shape[:3]
        m, c = columns.forcing.shape[2:]
        if out is None:
            out = np.empty((K + 1 if rows is None else len(rows), R, 6, c))
        states = np.empty((K + 1, R, n, c)) if with_states else np.empty(0)
        given = (columns.forcing, columns.scale, columns.observed, columns.start)
        arrays = [None if a is None else _real(a) for a in given]
        at = np.ascontiguousarray(columns.observing, dtype=np.int64)
        made = out if out.strides == _strides(out.shape[:3], out.strides[2] // out.itemsize) else np.empty(out.shape)
        place = None
        if rows is not None:
            place = np.full(K + 1, -1, dtype=np.int64)
            place[rows] = np.arange(len(rows))  # where a grid time is written to, -1: nowhere
        request = _DrivenColumns(
            c, m, len(at), made.strides[2] // made.itemsize,
            *(None if a is None else a.ctypes.data for a in arrays),
            at.ctypes.data, made.ctypes.data, states.ctypes.data if with_states else None,
            None if place is None else place.ctypes.data,
        )  # fmt: skip
        _over_windows(self.library, "responses", s, f, ctypes.byref(request))
        if made is not out:
            out[...] = made
        return out, states

    def smoothed(
        self, s: LinearSystem, f: Filtered, white: np.ndarray, states: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As ``kalman.smoothed`` of ``s``, ``f``, ``white`` (K + 1, R, 6) and ``states`` (K + 1, R, n)."""
        given, made = _real(white), (np.array(states, order="C"), np.zeros(s.T.shape[:3]), np.zeros(s.good.shape))
        _over_windows(self.library, "smooth", s, f, *(ctypes.c_void_p(a.ctypes.data) for a in (given, *made)))
        return made

    def adjoint(self, s: LinearSystem, f: Filtered) -> Adjoint:
        """As ``kalman.adjoint`` of ``s`` and ``f``."""
        (K, R, n), made = s.T.shape[:3], s.good.shape
        found = Adjoint(*(np.zeros(shape) for shape in ((K, R, s.S, n), (*made, n), (K, R, n), made)))
        _over_windows(self.library, "adjoint", s, f, *(ctypes.c_void_p(a.ctypes.data) for a in vars(found).values()))
        return found

    def by_rates(self, s: LinearSystem, by_T: np.ndarray, h: float, gusts: np.ndarray | None = None) -> np.ndarray:
        """As ``kalman.by_rates`` of ``s``, ``by_T`` (K, R, S, n), ``h`` [s] and ``gusts`` (K, R, 3, 2)."""
        given, pushes = _real(by_T), None if gusts is None else _real(gusts)
        out = np.zeros((*s.inside.shape, s.S, s.S + 3))
        addresses = [ctypes.c_void_p(None if a is None else a.ctypes.data) for a in (given, pushes, out)]
        _over_windows(self.library, "by_rates", s, None, ctypes.c_double(h), *addresses)
        return out


def _strides(shape: tuple[int, ...], apart: int) -> tuple[int, ...]:
    """Strides [bytes] of an array (*shape, c) whose last axis is contiguous, its rows ``apart`` numbers apart."""
    _, R, rows = shape
    return tuple(8 * size for size in (R * rows * apart, rows * apart, apart, 1))


@cache
def fastest() -> Any:
    """A ``CompiledFilter``, or the module ``kalman`` where it does not compile or does not agree with numpy."""
    library = load_library(source(), LOOP_FLAGS, _faults, "the Kalman filter")[0]
    return CompiledFilter(library) if library else kalman


def _faults(library: ctypes.CDLL) -> str:
    """What is wrong with a new ``library`` on a small system, with samples missing and a window that ends early; "" for
    nothing."""
    rng, K, R, S, c = np.random.default_rng(0), 6, 2, 3, 19
    n = S + 5  # states of the ship, a force X, Y, N, two gusts
    inside = np.arange(K)[:, None] < np.array([K, K - 2])
    good = (rng.random((K + 1, R, 6)) > 0.3) & (np.arange(K + 1)[:, None] <= np.array([K, K - 2]))[..., None]
    T = np.zeros((K, R, n, n))
    T[..., :S, :] = 0.3 * rng.standard_normal((K, R, S, n))
    T[..., np.arange(n), np.arange(n)] += 0.7
    T[~inside] = np.eye(n)
    Z = np.where(good[..., None], rng.standard_normal((K + 1, R, 6, n)), 0.0)
    Q, white = 0.1 + rng.random(n), 0.1 + rng.random(6)
    s = LinearSystem(T, Z, Q, white, np.repeat(np.eye(n)[None], R, axis=0), good, inside, S)
    observed, start = rng.standard_normal((K + 1, R, 6, 2)), rng.standard_normal((R, n, c))
    columns = DrivenColumns(rng.standard_normal((K, R, S, c)), observed, np.array([1, 17]), None, start)
    gusts, own, made = rng.standard_normal((K, R, 3, 2)), CompiledFilter(library), list[np.ndarray]()
    f = kalman.filtered(s)
    white, states = kalman.whitened(s, f, columns, with_states=True)
    back = kalman.adjoint(s, f)
    for way in (kalman, own):
        made += [*vars(way.filtered(s)).values(), *way.whitened(s, f, columns, with_states=True)]
        made += [*vars(way.adjoint(s, f)).values(), way.by_rates(s, back.by_T, 0.5, gusts)]
        made += way.smoothed(s, f, white[..., 0], states[..., 0])
    known, found = made[: len(made) // 2], made[len(made) // 2 :]
    wrong = differences(found, known, 1e-9)
    return f"the filter differs from that in numpy {wrong}" if wrong else ""


def source() -> str:
    """The C file: ``filter``, ``responses``, ``smooth``, ``adjoint`` and ``by_rates``."""
    return prelude() + c_file(__file__, "filter.c")

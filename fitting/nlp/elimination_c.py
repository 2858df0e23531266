"""The elimination of the nodes of all windows, and the way back, in C: one window after the other, its rows in cache.

The same as ``fitting.nlp.fisher_information.Eliminated``, and as ``carried`` of the condensing method, which are in
numpy for what has no compiler.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache

import numpy as np

from mmg.compile.batch import LOOP_FLAGS
from mmg.compile.cache import load_library
from mmg.compile.codegen import EXPORT, c_file


@dataclass(frozen=True)
class Chains:
    """The intervals of each of W windows, from its last one on: numbers (M,), those of window w from first (W + 1,) [w]
    on; start, end: (M,) nodes of each interval."""

    first: np.ndarray
    number: np.ndarray
    start: np.ndarray
    end: np.ndarray

    @classmethod
    def of(cls, window: np.ndarray, start: np.ndarray, end: np.ndarray) -> Chains:
        """window, start, end: (M,) of each interval; nodes follow each other in time."""
        order = np.lexsort((-start, window))
        first = np.concatenate([[0], np.cumsum(np.bincount(window))])
        return cls(*(np.ascontiguousarray(a, dtype=np.int64) for a in (first, order, start, end)))

    def arguments(self) -> list[object]:
        """For the C functions."""
        return [ctypes.c_void_p(a.ctypes.data) for a in (self.first, self.number, self.start, self.end)]


@dataclass(frozen=True)
class Elimination:
    """The compiled functions."""

    library: ctypes.CDLL

    def eliminated(
        self, chains: Chains, nodes: np.ndarray, node_slope: np.ndarray, maps: np.ndarray, off: np.ndarray,
        inside: tuple[np.ndarray, np.ndarray] | None,
    ) -> tuple[np.ndarray, ...]:  # fmt: skip
        """Rows (W, S, n), slope (W, n), second factor (M, S, n - S), rows (M, S, n) and slope (M, S) ahead: what
        ``Eliminated`` has, from rows (B, S, n) and slopes (B, n) of the nodes, maps (M, S, n) and off (M, S or more) of
        the intervals, and rows (M, S, n) and slopes (M, n) of the samples inside them, or None."""
        (M, S, n), W = maps.shape, len(chains.first) - 1
        given = [np.ascontiguousarray(a, dtype=float) for a in (nodes, node_slope, *(inside or ()), maps, off)]
        shapes = ((W, S, n), (W, n), (M, S, n - S), (M, S, n), (M, S))
        found = tuple(np.empty(shape) for shape in shapes)
        at = [ctypes.c_void_p(a.ctypes.data) for a in given]
        at[2:2] = [] if inside else [ctypes.c_void_p(None)] * 2
        out = [ctypes.c_void_p(a.ctypes.data) for a in found]
        sizes, row = [ctypes.c_longlong(k) for k in (W, S, n)], ctypes.c_longlong(off.shape[1])
        if self.library.eliminate(*sizes, *chains.arguments(), *at, row, *out):
            raise MemoryError("no memory for the elimination of nodes")
        return found

    def carried(
        self, chains: Chains, maps: np.ndarray, off: np.ndarray, first: np.ndarray, p: np.ndarray | None, nodes: int
    ) -> np.ndarray:
        """Steps (nodes, S) of all nodes from those of the first ones (W, S) and of the coefficients p (W or 1, n - S),
        None for none; maps: (M, S, n), off: (M, S)."""
        (_, S, n), W = maps.shape, len(chains.first) - 1
        given = [np.ascontiguousarray(a, dtype=float) for a in (maps, off, first)]
        own = np.ascontiguousarray(p) if p is not None else None
        steps, sizes = np.zeros((nodes, S)), [ctypes.c_longlong(k) for k in (W, S, n)]
        row = ctypes.c_longlong(n - S if own is not None and len(own) > 1 else 0)
        at = [ctypes.c_void_p(a.ctypes.data) for a in given]
        at += [ctypes.c_void_p(own.ctypes.data if own is not None else None)]
        self.library.carry(*sizes, *chains.arguments(), *at, row, ctypes.c_void_p(steps.ctypes.data))
        return steps


@cache
def elimination(compiled: bool) -> Elimination | None:
    """The functions, compiled or from the cache; None where that is not possible or not wanted."""
    library = load_library(EXPORT + c_file(__file__, "elimination.c"), LOOP_FLAGS)[0] if compiled else None
    return Elimination(library) if library else None

"""The elimination of the nodes of all windows, and the way back, in C: one window after the other, its rows in cache.

The same as ``fitting.nlp.fisher_information.Eliminated``, and as ``carried`` of the condensing method, which are in
numpy for what has no compiler.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache

import numpy as np

from mmg.compile.cache import load_library
from mmg.compile.codegen import EXPORT
from mmg.compile.paths import FLAGS

SOURCE = (
    f"{EXPORT}#include <stdlib.h>\n#include <string.h>"
    + """
#if defined(_MSC_VER) || !defined(__GNUC__)
#define restrict
#endif
typedef long long I;
typedef const double* restrict From;
typedef double* restrict To;
/* to_a += sum over b of left(a, b) right_b, rows of n numbers; left(a, b) at left[a * down + b * along] */
static void add(I S, I n, From left, I down, I along, From right, To to) {
  for (I a = 0; a < S; a++)
    for (I b = 0; b < S; b++) {
      const double f = left[a * down + b * along];
      for (I j = 0; j < n; j++) to[a * n + j] += f * right[b * n + j];
    }
}
/* intervals of window w, from its last one on: order[first[w]] .. order[first[w + 1] - 1] */
EXPORT int eliminate(I W, I S, I n, const I* first, const I* order, const I* start, const I* end, From nodes,
                     From node_slope, From inside, From inside_slope, From maps, From off, I off_row, double* rows,
                     double* slope, double* B, double* ahead, double* pull) {
  const I L = n - S, size = S * n;
  double* through = malloc(sizeof(double) * (size + n));
  if (!through) return 1;
  double* v = through + size;
  for (I w = 0; w < W; w++) {
    double *H = rows + w * size, *s = slope + w * n;
    for (I at = first[w]; at < first[w + 1]; at++) {
      const I i = order[at];
      const double* T = maps + i * size;
      if (at == first[w]) {
        memcpy(H, nodes + end[i] * size, sizeof(double) * size);
        memcpy(s, node_slope + end[i] * n, sizeof(double) * n);
      }
      memcpy(ahead + i * size, H, sizeof(double) * size);
      memcpy(pull + i * S, s, sizeof(double) * S);
      memcpy(v, s, sizeof(double) * n);
      for (I a = 0; a < S; a++)
        for (I j = 0; j < n; j++) v[j] += off[i * off_row + a] * H[a * n + j];
      memset(through, 0, sizeof(double) * size);
      add(S, n, H, n, 1, T, through);
      for (I a = 0; a < S; a++)
        for (I j = S; j < n; j++) {
          B[(i * S + a) * L + j - S] = 0.5 * through[a * n + j] + H[a * n + j];
          through[a * n + j] += H[a * n + j];
        }
      memcpy(H, nodes + start[i] * size, sizeof(double) * size);
      memcpy(s, node_slope + start[i] * n, sizeof(double) * n);
      for (I j = S; j < n; j++) s[j] += v[j];
      if (inside) {
        for (I j = 0; j < size; j++) H[j] += inside[i * size + j];
        for (I j = 0; j < n; j++) s[j] += inside_slope[i * n + j];
      }
      add(S, n, T, 1, n, through, H);
      for (I b = 0; b < S; b++)
        for (I j = 0; j < n; j++) s[j] += v[b] * T[b * n + j];
    }
  }
  free(through);
  return 0;
}
EXPORT void carry(I W, I S, I n, const I* first, const I* order, const I* start, const I* end, From maps, From off,
                  From begin, const double* p, I p_row, double* nodes) {
  for (I w = 0; w < W; w++)
    for (I at = first[w + 1] - 1; at >= first[w]; at--) {
      const I i = order[at];
      double* z = nodes + start[i] * S;
      if (at == first[w + 1] - 1) memcpy(z, begin + w * S, sizeof(double) * S);
      for (I a = 0; a < S; a++) {
        From T = maps + (i * S + a) * n;
        double sum = off[i * S + a];
        for (I b = 0; b < S; b++) sum += T[b] * z[b];
        if (p) for (I j = S; j < n; j++) sum += T[j] * p[w * p_row + j - S];
        nodes[end[i] * S + a] = sum;
      }
    }
}
"""
)


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
    library = load_library(SOURCE, FLAGS)[0] if compiled else None
    return Elimination(library) if library else None

"""Filter and responses of ``diagnosis.estimation.kalman``, by C code where it compiles: most of a diagnosis' time.

The functions in numpy are the portable path, and what the code must agree with on a small system before it is kept.
Each function of the C code goes through the windows from begin to end, one after the other, and takes eight columns of
a row at a time. Arrays are those of the functions in numpy, row by row; of the transitions and the observations only
those numbers are read that are not zero in any window. The rest of the filter's functions take little time beside them.
"""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from diagnosis.estimation import kalman
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.kalman import Filtered, LinearSystem
from mmg.compile.batch import differences
from mmg.compile.cache import load_library
from mmg.compile.codegen import prelude
from mmg.compile.paths import FLAGS


def filtered(s: LinearSystem) -> Filtered:
    """Covariances and gains of the system ``s``. Raises LinAlgError where a covariance is singular."""
    library = _library()
    return filtered_by(library, s) if library else kalman.filtered(s)


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
    library = _library()
    if library:
        return out, whitened_by(library, s, f, columns, out, with_states, rows)
    forcing, observed = columns.forcing, columns.dense_observed
    if columns.scale is not None:
        forcing, observed = forcing * columns.scale[:, None], observed * columns.scale[:, None]
    every, states = kalman.responses(s, f, forcing, observed, columns.start)
    out[...] = every if rows is None else every[rows]
    return out, states if with_states else np.empty(0)


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


def _over_windows(library: ctypes.CDLL, name: str, s: LinearSystem, f: Filtered, *rest: object) -> None:
    """Call a function of the ``library`` with the system, its filter run and what else it takes."""
    arrays = [_real(a) for a in (s.T, s.Z, s.Q, s.R, s.first)]
    arrays += [np.ascontiguousarray(a, dtype=np.uint8) for a in (s.good, s.inside)]
    arrays += [_real(a) for a in (f.gain, f.P, f.inverse, f.root, f.log_det)]
    system = _System(*s.T.shape[:3], s.S, 0, s.T.shape[1], *(a.ctypes.data for a in (*arrays, *s.places)))
    failed = getattr(library, name)(ctypes.byref(system), *rest)
    if failed == 1:
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    if failed == 2:
        raise MemoryError(f"no memory for the filter of {s.T.shape[1]} windows")


def filtered_by(library: ctypes.CDLL, s: LinearSystem) -> Filtered:
    """``filtered`` of the system ``s`` by the compiled ``library``."""
    K, R, n = s.T.shape[:3]
    f = Filtered(
        gain=np.empty((K, R, n, 6)),
        P=np.empty((K + 1, R, n, n)),
        inverse=np.empty((K + 1, R, 6, 6)),
        root=np.empty((K + 1, R, 6, 6)),
        log_det=np.empty(R),
    )
    _over_windows(library, "filter", s, f)
    return f


def whitened_by(
    library: ctypes.CDLL,
    s: LinearSystem,
    f: Filtered,
    columns: DrivenColumns,
    out: np.ndarray,
    with_states: bool,
    rows: np.ndarray | None = None,
) -> np.ndarray:
    """As ``whitened``, by the compiled ``library``; returns the states (K + 1, R, n, c), or an empty array.

    s, f, columns: as of ``whitened``; out: (K + 1 or k, R, 6, c) for the responses; with_states: whether the states are
    wanted; rows: (k,) rising grid times of which responses are wanted (default: all).
    """
    K, R, n = s.T.shape[:3]
    m, c = columns.forcing.shape[2:]
    states = np.empty((K + 1, R, n, c)) if with_states else np.empty(0)
    given = (columns.forcing, columns.scale, columns.observed, columns.start)
    arrays = [None if a is None else _real(a) for a in given]
    at = np.ascontiguousarray(columns.observing, dtype=np.int64)
    made = out if out.strides == _strides(out.shape[:3], out.strides[2] // out.itemsize) else np.empty(out.shape)
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
    _over_windows(library, "responses", s, f, ctypes.byref(request))
    if made is not out:
        out[...] = made
    return states


def _strides(shape: tuple[int, ...], apart: int) -> tuple[int, ...]:
    """Strides [bytes] of an array (*shape, c) whose last axis is contiguous, its rows ``apart`` numbers apart."""
    _, R, rows = shape
    return tuple(8 * size for size in (R * rows * apart, rows * apart, apart, 1))


@cache
def _library() -> ctypes.CDLL | None:
    """The compiled functions, or None where they do not compile or do not agree with numpy."""
    return load_library(source(), FLAGS, _faults, "the Kalman filter")[0]


def _faults(library: ctypes.CDLL) -> str:
    """What is wrong with a new ``library`` on a small system, with samples missing and a window that ends early; "" for
    nothing."""
    rng, K, R, S, c = np.random.default_rng(0), 6, 2, 3, 19
    inside = np.arange(K)[:, None] < np.array([K, K - 2])
    good = (rng.random((K + 1, R, 6)) > 0.3) & (np.arange(K + 1)[:, None] <= np.array([K, K - 2]))[..., None]
    T = np.zeros((K, R, S + 6, S + 6))
    T[..., :S, :] = 0.3 * rng.standard_normal((K, R, S, S + 6))
    T[..., np.arange(S + 6), np.arange(S + 6)] += 0.7
    T[~inside] = np.eye(S + 6)
    Z = np.where(good[..., None], rng.standard_normal((K + 1, R, 6, S + 6)), 0.0)
    Q, white = 0.1 + rng.random(S + 6), 0.1 + rng.random(6)
    s = LinearSystem(T, Z, Q, white, np.repeat(np.eye(S + 6)[None], R, axis=0), good, inside, S)
    observed, start = rng.standard_normal((K + 1, R, 6, 2)), rng.standard_normal((R, S + 6, c))
    columns = DrivenColumns(rng.standard_normal((K, R, S, c)), observed, np.array([1, 17]), None, start)
    f, own = kalman.filtered(s), filtered_by(library, s)
    expected = kalman.responses(s, f, columns.forcing, columns.dense_observed, start)
    out = np.empty(expected[0].shape)
    states = whitened_by(library, s, own, columns, out, True)
    wrong = differences([*vars(own).values(), out, states], [*vars(f).values(), *expected], 1e-9)
    return f"the filter differs from that in numpy {wrong}" if wrong else ""


def forget_code() -> None:
    """Choose again between code and numpy when the filter is next used."""
    _library.cache_clear()


_PRODUCTS = """
#include <stdlib.h>
/* m rows of w vectors of a product: sums that wait for each other in none of the others */
#define EACH(e, count) _Pragma("GCC unroll 4") for (int e = 0; e < count; e++)
#define BLOCK(m, w) { V sum[m][w]; \\
  EACH(e, m) EACH(v, w) sum[e][v] = plus ? out[(i + e) * nv + at + v] : fill(0.0); \\
  const double* x = a + i * si; const V* row = b + at; \\
  for (long long j = 0; j < inner; j++, x += sj, row += nv) EACH(e, m) { \\
    const V one = fill(x[e * si]); EACH(v, w) sum[e][v] += one * row[v]; } \\
  EACH(e, m) EACH(v, w) out[(i + e) * nv + at + v] = sum[e][v]; }
#define ROWS(m, w) { long long i = 0; for (; i + m <= rows; i += m) BLOCK(m, w) for (; i < rows; i++) BLOCK(1, w) }
/* kept from being copied to where it is called, which takes the compiler most of its time */
#define ONCE __attribute__((noinline))
static ONCE void product(long long rows, long long inner, long long nv, const double* a, long long si, long long sj,
                         const V* b, V* out, int plus) {
  long long at = 0;
  for (; nv - at >= 4; at += 4) ROWS(2, 4)
  for (; nv - at >= 2; at += 2) ROWS(3, 2)
  for (; at < nv; at++) ROWS(3, 1)
}
static V* room(void** whole, long long vectors) {
  char* p = *whole = calloc(vectors + 1, sizeof(V));
  return p ? (V*)(p + (sizeof(V) - (unsigned long long)p % sizeof(V))) : 0;
}
typedef struct {
  long long K, R, n, S, begin, end;
  const double *T, *Z, *Q, *white, *first;
  const unsigned char *good, *inside;
  double *gain, *P, *inverse, *root, *log_det;
  const long long *t, *t_at, *z, *z_at; /* numbers of row a that are not zero: t[a] to t[a + 1], in columns t_at */
} System;
/* out = a times X, row by row: at has the columns of the numbers that are not zero, those of row i from first[i] on */
static ONCE void few(long long rows, long long n, const double* a, const long long* first, const long long* at,
                     long long nv, const V* X, V* out) {
  for (long long i = 0; i < rows; i++, out += nv) {
    const long long end = first[i + 1];
    long long v = 0;
    for (; v + 4 <= nv; v += 4) {
      V s0 = fill(0.0), s1 = s0, s2 = s0, s3 = s0;
      for (long long e = first[i]; e < end; e++) {
        const V x = fill(a[i * n + at[e]]);
        const V* b = X + at[e] * nv + v;
        s0 += x * b[0]; s1 += x * b[1]; s2 += x * b[2]; s3 += x * b[3];
      }
      out[v] = s0; out[v + 1] = s1; out[v + 2] = s2; out[v + 3] = s3;
    }
    for (; v < nv; v++) {
      V sum = fill(0.0);
      for (long long e = first[i]; e < end; e++) sum += fill(a[i * n + at[e]]) * X[at[e] * nv + v];
      out[v] = sum;
    }
  }
}
/* T times X: the first S rows have the same columns, which come first */
static void stepped(const System* s, const double* T, long long nv, const V* X, V* next) {
  const long long n = s->n, S = s->S;
  product(S, s->t[S > 0] ? s->t_at[s->t[1] - 1] + 1 : 0, nv, T, n, 1, X, next, 0);
  few(n - S, n, T + S * n, s->t + S, s->t_at, nv, X, next + S * nv);
}
/* Steps of window r: after them nothing is measured and its state stays. */
static long long steps_of(const System* s, long long r) {
  long long k = s->K;
  while (k > 0 && !s->inside[(k - 1) * s->R + r]) k--;
  return k;
}
"""
_FILTER = """
/* Cholesky factor of F, of which the lower half is there; root is its inverse, a lower triangle */
static int whitened(double* F, double* root, double* log_det) {
  memset(root, 0, 36 * sizeof(double));
  for (int j = 0; j < 6; j++) for (int i = j; i < 6; i++) {
    double x = F[6 * i + j];
    for (int l = 0; l < j; l++) x -= F[6 * i + l] * F[6 * j + l];
    if (i == j && !(x > 0.0)) return 1;
    F[6 * i + j] = i == j ? sqrt(x) : x / F[7 * j];
  }
  for (int j = 0; j < 6; j++) {
    *log_det += 2.0 * log(F[7 * j]);
    for (int i = j; i < 6; i++) {
      double x = i == j;
      for (int l = j; l < i; l++) x -= F[6 * i + l] * root[6 * l + j];
      root[6 * i + j] = x / F[7 * i];
    }
  }
  return 0;
}
EXPORT int filter(const System* s) {
  const long long K = s->K, R = s->R, n = s->n, nv = (n + LANES - 1) / LANES, np = nv * LANES;
  void* whole;
  V* P = room(&whole, 3 * n * nv + 12 * nv + 2 * n);
  if (!P) return 2;
  V *C = P + n * nv, *M = C + n * nv, *ZP = M + n * nv, *H = ZP + 6 * nv, *X = H + 6 * nv, *G = X + n;
  double *p = (double*)P, *c = (double*)C, *m = (double*)M, *zp = (double*)ZP, *h = (double*)H;
  double *x = (double*)X, *g = (double*)G, F[36];
  for (long long r = s->begin; r < s->end; r++) {
    const long long last = steps_of(s, r);
    s->log_det[r] = 0.0;
    for (long long a = 0; a < n; a++) memcpy(p + a * np, s->first + (r * n + a) * n, n * sizeof(double));
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r;
      const double *T = s->T + i * n * n, *Z = s->Z + i * 6 * n;
      double *root = s->root + 36 * i, *inverse = s->inverse + 36 * i, *gain = s->gain + i * n * 6;
      for (long long a = 0; a < n; a++) memcpy(s->P + (i * n + a) * n, p + a * np, n * sizeof(double));
      if (k > last) {
        for (int j = 0; j < 36; j++) inverse[j] = root[j] = j % 7 == 0;
        if (k < K) memset(gain, 0, n * 6 * sizeof(double));
        continue;
      }
      few(6, n, Z, s->z, s->z_at, nv, P, ZP);
      for (int l = 0; l < 6; l++) for (int j = 0; j <= l; j++) {
        double sum = j < l ? 0.0 : s->good[6 * i + l] ? s->white[l] : 1.0;
        for (long long e = s->z[j]; e < s->z[j + 1]; e++) sum += Z[j * n + s->z_at[e]] * zp[l * np + s->z_at[e]];
        F[6 * l + j] = sum;
      }
      if (whitened(F, root, s->log_det + r)) { free(whole); return 1; }
      for (int a = 0; a < 6; a++) for (int b = 0; b <= a; b++) {
        double sum = 0.0;
        for (int l = a; l < 6; l++) sum += root[6 * l + a] * root[6 * l + b];
        inverse[6 * a + b] = inverse[6 * b + a] = sum;
      }
      if (k == K) break;
      product(6, 6, nv, inverse, 6, 1, ZP, H, 0); /* H = F^-1 Z P, gain = T H' */
      for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) x[a * LANES + l] = h[l * np + a];
      stepped(s, T, 1, X, G);
      for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) gain[a * 6 + l] = g[a * LANES + l];
      for (long long j = 0; j < 6 * nv; j++) H[j] = -H[j];
      memcpy(C, P, n * nv * sizeof(V));
      product(n, 6, nv, zp, 1, np, H, C, 1); /* C = P - P Z' F^-1 Z P */
      stepped(s, T, nv, C, M);
      for (long long a = 0; a < n; a++) for (long long b = 0; b < n; b++) c[b * np + a] = m[a * np + b];
      stepped(s, T, nv, C, P); /* T (T C)' */
      for (long long a = 0; a < n; a++) {
        for (long long b = 0; b < a; b++) p[a * np + b] = p[b * np + a] = 0.5 * (p[a * np + b] + p[b * np + a]);
        if (s->inside[i]) p[a * np + a] += s->Q[a];
      }
    }
  }
  free(whole);
  return 0;
}
"""
_RESPONSES = """
#define CHUNK 16
typedef struct {
  long long c, m, d, apart;
  const double *forcing, *scale, *observed, *start;
  const long long* observing;
  double *white, *states;
  const long long* place;
} Columns;
static const long long triangle[7] = {0, 1, 3, 6, 10, 15, 21};
static const long long below[21] = {0, 0, 1, 0, 1, 2, 0, 1, 2, 3, 0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 5};
EXPORT int responses(const System* s, const Columns* f) {
  const long long K = s->K, R = s->R, n = s->n, c = f->c;
  void* whole;
  V* X = room(&whole, (2 * n + 13) * CHUNK);
  if (!X) return 2;
  V *next = X + n * CHUNK, *W = next + n * CHUNK, *U = W + 6 * CHUNK, *size = U + 6 * CHUNK;
  for (long long r = s->begin; r < s->end; r++) for (long long from = 0; from < c; from += CHUNK * LANES) {
    const long long own = c - from < CHUNK * LANES ? c - from : CHUNK * LANES, nv = (own + LANES - 1) / LANES;
    const long long np = nv * LANES, last = steps_of(s, r);
    double *x = (double*)X, *w = (double*)W, *u = (double*)U, *scale = (double*)size;
    memset(X, 0, n * nv * sizeof(V));
    if (f->start) for (long long a = 0; a < n; a++) for (long long j = 0; j < own; j++)
      x[a * np + j] = f->start[(r * n + a) * c + from + j];
    for (long long j = 0; j < np; j++) scale[j] = j < own && f->scale ? f->scale[r * c + from + j] : 1.0;
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r, at = f->place ? f->place[k] : k;
      const unsigned char* good = s->good + 6 * i;
      const int blind = !(good[0] | good[1] | good[2] | good[3] | good[4] | good[5]);
      double* white = f->white + (at * R + r) * 6 * f->apart + from;
      if (f->states) for (long long a = 0; a < n; a++)
        memcpy(f->states + (i * n + a) * c + from, x + a * np, own * sizeof(double));
      if (blind) for (int l = 0; l < 6 && at >= 0; l++) memset(white + l * f->apart, 0, own * sizeof(double));
      else {
        few(6, n, s->Z + i * 6 * n, s->z, s->z_at, nv, X, W);
        for (long long e = 0; e < f->d; e++) {
          const long long j = f->observing[e] - from;
          if (j >= 0 && j < own) for (int l = 0; l < 6; l++)
            if (good[l]) w[l * np + j] += scale[j] * f->observed[(i * 6 + l) * f->d + e];
        }
        few(6, 6, s->root + 36 * i, triangle, below, nv, W, U);
        for (int l = 0; l < 6 && at >= 0; l++) memcpy(white + l * f->apart, u + l * np, own * sizeof(double));
      }
      if (k == K) break;
      if (k > last) continue;
      stepped(s, s->T + i * n * n, nv, X, next);
      if (!blind) {
        for (long long j = 0; j < 6 * nv; j++) W[j] = -W[j];
        product(n, 6, nv, s->gain + i * n * 6, 6, 1, W, next, 1);
      }
      V* spare = X; X = next; next = spare;
      x = (double*)X;
      if (s->inside[i]) for (long long a = 0; a < f->m; a++) {
        const double* push = f->forcing + (i * f->m + a) * c + from;
        long long j = 0;
        for (; j + LANES <= own; j += LANES)
          store(x + a * np + j, load(x + a * np + j) + size[j / LANES] * load(push + j));
        for (; j < own; j++) x[a * np + j] += scale[j] * push[j];
      }
    }
  }
  free(whole);
  return 0;
}
"""


def source() -> str:
    """The C file with ``filter`` and ``responses``."""
    return prelude() + _PRODUCTS + _FILTER + _RESPONSES

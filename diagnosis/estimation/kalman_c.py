"""C source of the functions of ``diagnosis.estimation.kalman``, for any sizes; those of many columns.

The filter and what goes backwards take eight windows at a time, one in each lane of a vector; responses of many columns
take a window at a time and eight columns. Each function goes through the windows from begin to end, and which are
together does not change a bit. Arrays are those of the functions in numpy, row by row; of the transitions and the
observations only those numbers are read that are not zero in any window.
"""

from __future__ import annotations

from diagnosis.estimation.kalman_backward_c import BACKWARD
from diagnosis.estimation.kalman_lanes_c import FILTER
from mmg.compile.codegen import prelude
from mmg.compile.transposed_c import TRANSPOSED

_PRODUCTS = """
#include <stdlib.h>
/* m rows of w vectors of a product: sums that wait for each other in none of the others */
#define BLOCK(m, w) { V sum[m][w]; \\
  for (int e = 0; e < m; e++) for (int v = 0; v < w; v++) sum[e][v] = plus ? out[(i + e) * nv + at + v] : fill(0.0); \\
  const double* x = a + i * si; const V* row = b + at; \\
  for (long long j = 0; j < inner; j++, x += sj, row += nv) for (int e = 0; e < m; e++) { \\
    const V one = fill(x[e * si]); for (int v = 0; v < w; v++) sum[e][v] += one * row[v]; } \\
  for (int e = 0; e < m; e++) for (int v = 0; v < w; v++) out[(i + e) * nv + at + v] = sum[e][v]; }
#define ROWS(m, w) { long long i = 0; for (; i + m <= rows; i += m) BLOCK(m, w) for (; i < rows; i++) BLOCK(1, w) }
static void product(long long rows, long long inner, long long nv, const double* a, long long si, long long sj,
                    const V* b, V* out, int plus) {
  long long at = 0;
  for (; nv - at >= 4; at += 4) ROWS(2, 4)
  for (; nv - at >= 2; at += 2) ROWS(3, 2)
  for (; at < nv; at++) ROWS(3, 1)
}
static V* room(void** whole, long long vectors) {
  char* p = *whole = malloc((vectors + 1) * sizeof(V));
  return p ? (V*)(p + (sizeof(V) - (unsigned long long)p % sizeof(V))) : 0;
}
static void spread(long long rows, long long n, long long np, const double* from, double* to) {
  for (long long i = 0; i < rows; i++) for (long long j = 0; j < n; j++) to[i * np + j] = from[i * n + j];
}
static void narrow(long long rows, long long n, long long np, const double* from, double* to) {
  for (long long i = 0; i < rows; i++) for (long long j = 0; j < n; j++) to[i * n + j] = from[i * np + j];
}
static int nothing(const unsigned char* good) {
  return !(good[0] | good[1] | good[2] | good[3] | good[4] | good[5]);
}
typedef struct {
  long long K, R, n, S, begin, end;
  const double *T, *Z, *Q, *white, *first;
  const unsigned char *good, *inside;
  double *gain, *P, *inverse, *root, *log_det;
  const long long *t, *t_at, *z, *z_at; /* numbers of row a that are not zero: t[a] to t[a + 1], in columns t_at */
} System;
/* out = a times X, row by row: at has the columns of the numbers that are not zero, those of row i from first[i] on */
static void few(long long rows, long long n, const double* a, const long long* first, const long long* at, long long nv,
                const V* X, V* out) {
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
/* asks for numbers that are read a step later */
static void soon(const double* p, long long count) {
  for (long long j = 0; j < count; j += 8) __builtin_prefetch(p + j);
}
/* Steps of window r: after them nothing is measured and its state stays. */
static long long steps_of(const System* s, long long r) {
  long long k = s->K;
  while (k > 0 && !s->inside[(k - 1) * s->R + r]) k--;
  return k;
}
"""
_RESPONSES = """
#define CHUNK 16
static const long long triangle[7] = {0, 1, 3, 6, 10, 15, 21};
static const long long below[21] = {0, 0, 1, 0, 1, 2, 0, 1, 2, 3, 0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 5};
EXPORT int responses(const System* s, const Columns* f) {
  const long long K = s->K, R = s->R, n = s->n, c = f->c;
  if (c == 1) return response(s, f);
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
      const long long i = k * R + r;
      const unsigned char* good = s->good + 6 * i;
      const int blind = nothing(good);
      const long long at = f->place ? f->place[k] : k;
      double* white = f->white + (at * R + r) * 6 * f->apart + from;
      if (k + 1 < K) {
        const long long j = i + R;
        soon(s->T + j * n * n, s->S * n); soon(s->Z + j * 6 * n, 6 * n); soon(s->gain + j * 6 * n, 6 * n);
        soon(s->root + j * 36, 36);
        for (long long a = 0; a < f->m; a++) soon(f->forcing + (j * f->m + a) * c + from, own);
      }
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
EXPORT int observations(const System* s, long long c, const double* white, double* y) {
  const long long K = s->K, R = s->R, n = s->n, nv = (c + LANES - 1) / LANES, np = nv * LANES;
  void* whole;
  V* X = room(&whole, (2 * n + 12) * nv);
  if (!X) return 2;
  V *next = X + n * nv, *W = next + n * nv, *Y = W + 6 * nv;
  memset(W, 0, 6 * nv * sizeof(V));
  for (long long r = s->begin; r < s->end; r++) {
    const long long last = steps_of(s, r);
    memset(X, 0, n * nv * sizeof(V));
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r;
      const double* root = s->root + 36 * i;
      spread(6, c, np, white + i * 6 * c, (double*)W);
      for (int l = 0; l < 6; l++) {
        V* own = W + l * nv;
        for (int j = 0; j < l; j++) for (long long v = 0; v < nv; v++) own[v] -= root[6 * l + j] * W[j * nv + v];
        for (long long v = 0; v < nv; v++) own[v] = own[v] / root[7 * l];
      }
      memcpy(Y, W, 6 * nv * sizeof(V));
      product(6, n, nv, s->Z + i * 6 * n, n, 1, X, Y, 1);
      narrow(6, c, np, (double*)Y, y + i * 6 * c);
      if (k == K) break;
      if (k > last) continue;
      stepped(s, s->T + i * n * n, nv, X, next);
      product(n, 6, nv, s->gain + i * n * 6, 6, 1, W, next, 1);
      V* spare = X; X = next; next = spare;
    }
  }
  free(whole);
  return 0;
}
"""


def source() -> str:
    """The C file with ``filter``, ``responses``, ``observations``, ``smoothed``, ``adjoint``, ``by_rates`` and
    ``assembled``."""
    return prelude() + TRANSPOSED + _PRODUCTS + FILTER + _RESPONSES + BACKWARD

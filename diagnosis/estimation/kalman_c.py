"""C source of the functions of ``diagnosis.estimation.kalman``, for any sizes; those that go forwards in time.

A window is gone through alone, rows of its matrices in vectors of eight numbers; each function goes through those from
begin to end, and which are together does not change a bit. Arrays are those of the functions in numpy, row by row.
"""

from __future__ import annotations

from diagnosis.estimation.kalman_backward_c import BACKWARD
from mmg.compile.codegen import prelude

FLAGS = ("-O3", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-w")

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
  double *L, *gain, *P, *inverse, *root, *log_det;
} System;
/* T times X or more: the states behind the first S follow themselves alone. */
static void stepped(const System* s, const double* T, long long nv, const V* X, V* next) {
  const long long n = s->n, S = s->S;
  product(S, n, nv, T, n, 1, X, next, 0);
  product(n - S, n - S, nv, T + S * n + S, n, 1, X + S * nv, next + S * nv, 0);
}
/* Steps of window r: after them nothing is measured and its state stays. */
static long long steps_of(const System* s, long long r) {
  long long k = s->K;
  while (k > 0 && !s->inside[(k - 1) * s->R + r]) k--;
  return k;
}
"""
_FILTER = """
static int whitened(V* F, double* inverse, double* root, double* log_det) {
  double low[36] = {0}, inv[36] = {0};
  for (int j = 0; j < 6; j++) {
    for (int i = j; i < 6; i++) {
      double x = F[i][j];
      for (int l = 0; l < j; l++) x -= low[6 * i + l] * low[6 * j + l];
      if (i == j) {
        if (!(x > 0.0)) return 1;
        low[7 * j] = sqrt(x);
      } else low[6 * i + j] = x / low[7 * j];
    }
    *log_det += 2 * log(low[7 * j]);
  }
  for (int j = 0; j < 6; j++) {
    inv[7 * j] = 1 / low[7 * j];
    for (int i = j + 1; i < 6; i++) {
      double x = 0;
      for (int l = j; l < i; l++) x -= low[6 * i + l] * inv[6 * l + j];
      inv[6 * i + j] = x / low[7 * i];
    }
  }
  for (int i = 0; i < 6; i++) for (int j = 0; j < 6; j++) {
    double x = 0;
    for (int l = i > j ? i : j; l < 6; l++) x += inv[6 * l + i] * inv[6 * l + j];
    inverse[6 * i + j] = x;
  }
  memcpy(root, inv, sizeof inv);
  return 0;
}
EXPORT int filter(const System* s) {
  const long long K = s->K, R = s->R, n = s->n, nv = (n + LANES - 1) / LANES, np = nv * LANES;
  void* whole;
  V* at = room(&whole, 5 * n * nv + 24 * nv + n + 8);
  if (!at) return 2;
  V *now = at, *T = now + n * nv, *Tt = T + n * nv, *L = Tt + n * nv, *M = L + n * nv, *Z = M + n * nv;
  V *ZP = Z + 6 * nv, *B = ZP + 6 * nv, *G = B + 6 * nv, *Zt = G + 6 * nv, *F = Zt + n;
  memset(at, 0, (5 * n * nv + 24 * nv + n + 8) * sizeof(V));
  double *g = (double*)G, *p = (double*)now, *zt = (double*)Zt;
  for (long long r = s->begin; r < s->end; r++) {
    const long long own = steps_of(s, r);
    double log_det = 0;
    spread(n, n, np, s->first + r * n * n, p);
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r;
      const unsigned char* good = s->good + 6 * i;
      const int blind = nothing(good);
      narrow(n, n, np, p, s->P + i * n * n);
      if (blind) {
        for (int j = 0; j < 36; j++) s->inverse[36 * i + j] = s->root[36 * i + j] = j % 7 == 0;
      } else {
        const double* z = s->Z + i * 6 * n;
        spread(6, n, np, z, (double*)Z);
        for (int l = 0; l < 6; l++) for (long long j = 0; j < n; j++) zt[j * LANES + l] = z[l * n + j];
        product(6, n, nv, (double*)Z, np, 1, now, ZP, 0);
        product(6, n, 1, (double*)ZP, np, 1, Zt, F, 0);
        for (int l = 0; l < 6; l++) F[l][l] += good[l] ? s->white[l] : 1.0;
        if (whitened(F, s->inverse + 36 * i, s->root + 36 * i, &log_det)) { free(whole); return 1; }
      }
      if (k == K) break;
      const double* t = s->T + i * n * n;
      if (k > own) {
        memcpy(s->L + i * n * n, t, n * n * sizeof(double));
        memset(s->gain + i * n * 6, 0, n * 6 * sizeof(double));
        continue;
      }
      spread(n, n, np, t, (double*)T);
      for (long long a = 0; a < n; a++) for (long long b = 0; b < n; b++) ((double*)Tt)[b * np + a] = t[a * n + b];
      memcpy(L, T, n * nv * sizeof(V));
      if (blind) memset(s->gain + i * n * 6, 0, n * 6 * sizeof(double));
      else {
        product(6, n, nv, (double*)ZP, np, 1, Tt, B, 0);
        product(6, 6, nv, s->inverse + 36 * i, 6, 1, B, G, 0);
        for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) s->gain[(i * n + a) * 6 + l] = g[l * np + a];
        for (long long j = 0; j < 6 * nv; j++) G[j] = -G[j];
        product(n, 6, nv, g, 1, np, Z, L, 1);
      }
      narrow(n, n, np, (double*)L, s->L + i * n * n);
      product(n, n, nv, (double*)L, np, 1, now, M, 0);
      product(n, n, nv, (double*)M, np, 1, Tt, now, 0);
      for (long long a = 0; a < n; a++) {
        for (long long b = 0; b < a; b++) p[a * np + b] = p[b * np + a] = 0.5 * (p[a * np + b] + p[b * np + a]);
        if (s->inside[i]) p[a * np + a] += s->Q[a];
      }
    }
    s->log_det[r] = log_det;
  }
  free(whole);
  return 0;
}
"""
_RESPONSES = """
typedef struct {
  long long c, m, d, apart;
  const double *forcing, *scale, *observed, *start;
  const long long* observing;
  double *white, *states;
  const long long* place;
} Columns;
#define CHUNK 16
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
      const long long i = k * R + r;
      const unsigned char* good = s->good + 6 * i;
      const int blind = nothing(good);
      const long long at = f->place ? f->place[k] : k;
      double* white = f->white + (at * R + r) * 6 * f->apart + from;
      if (f->states) for (long long a = 0; a < n; a++)
        memcpy(f->states + (i * n + a) * c + from, x + a * np, own * sizeof(double));
      if (blind) for (int l = 0; l < 6 && at >= 0; l++) memset(white + l * f->apart, 0, own * sizeof(double));
      else {
        product(6, n, nv, s->Z + i * 6 * n, n, 1, X, W, 0);
        for (long long e = 0; e < f->d; e++) {
          const long long j = f->observing[e] - from;
          if (j >= 0 && j < own) for (int l = 0; l < 6; l++)
            if (good[l]) w[l * np + j] += scale[j] * f->observed[(i * 6 + l) * f->d + e];
        }
        product(6, 6, nv, s->root + 36 * i, 6, 1, W, U, 0);
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
    """The C file with ``filter``, ``responses``, ``observations``, ``smoothed``, ``adjoint`` and ``by_rates``."""
    return prelude() + _PRODUCTS + _FILTER + _RESPONSES + BACKWARD

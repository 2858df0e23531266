#include <stdlib.h>
/* m rows of w vectors of a product: sums that wait for each other in none of the others */
#define EACH(e, count) _Pragma("GCC unroll 4") for (int e = 0; e < count; e++)
#define BLOCK(m, w) { V sum[m][w]; \
  EACH(e, m) EACH(v, w) sum[e][v] = plus ? out[(i + e) * nv + at + v] : fill(0.0); \
  const double* x = a + i * si; const V* row = b + at; \
  for (long long j = 0; j < inner; j++, x += sj, row += nv) EACH(e, m) { \
    const V one = fill(x[e * si]); EACH(v, w) sum[e][v] += one * row[v]; } \
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
  long long K, R, n, S;
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
/* Whether nothing is compared at row i of all windows. */
static int blind(const System* s, long long i) {
  const unsigned char* good = s->good + 6 * i;
  return !(good[0] | good[1] | good[2] | good[3] | good[4] | good[5]);
}
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
  for (long long r = 0; r < R; r++) {
    const long long last = steps_of(s, r);
    s->log_det[r] = 0.0;
    for (long long a = 0; a < n; a++) memcpy(p + a * np, s->first + (r * n + a) * n, n * sizeof(double));
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r;
      const double *T = s->T + i * n * n, *Z = s->Z + i * 6 * n;
      double *root = s->root + 36 * i, *inverse = s->inverse + 36 * i, *gain = s->gain + i * n * 6;
      for (long long a = 0; a < n; a++) memcpy(s->P + (i * n + a) * n, p + a * np, n * sizeof(double));
      const int unseen = blind(s, i);
      if (k > last || unseen) {
        for (int j = 0; j < 36; j++) inverse[j] = root[j] = j % 7 == 0;
        if (k < K) memset(gain, 0, n * 6 * sizeof(double));
      }
      if (k > last) continue;
      if (!unseen) {
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
        if (k < K) {
          product(6, 6, nv, inverse, 6, 1, ZP, H, 0); /* H = F^-1 Z P, gain = T H' */
          for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) x[a * LANES + l] = h[l * np + a];
          stepped(s, T, 1, X, G);
          for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) gain[a * 6 + l] = g[a * LANES + l];
          for (long long j = 0; j < 6 * nv; j++) H[j] = -H[j];
        }
      }
      if (k == K) break;
      memcpy(C, P, n * nv * sizeof(V));
      if (!unseen) product(n, 6, nv, zp, 1, np, H, C, 1); /* C = P - P Z' F^-1 Z P */
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
  for (long long r = 0; r < R; r++) for (long long from = 0; from < c; from += CHUNK * LANES) {
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
      const int unseen = blind(s, i);
      double* white = f->white + (at * R + r) * 6 * f->apart + from;
      if (f->states) for (long long a = 0; a < n; a++)
        memcpy(f->states + (i * n + a) * c + from, x + a * np, own * sizeof(double));
      if (unseen) for (int l = 0; l < 6 && at >= 0; l++) memset(white + l * f->apart, 0, own * sizeof(double));
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
      if (!unseen) {
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
/* T' X into next: the rows of T behind those of the ship have few numbers; T is padded to np columns */
static void transposed(const System* s, const double* T, long long nv, const V* X, V* next) {
  const long long n = s->n, S = s->S, np = nv * LANES;
  product(n, S, nv, T, 1, np, X, next, 0);
  for (long long j = S; j < n; j++) for (long long e = s->t[j]; e < s->t[j + 1]; e++) {
    const V one = fill(T[j * np + s->t_at[e]]);
    for (long long v = 0; v < nv; v++) next[s->t_at[e] * nv + v] += one * X[j * nv + v];
  }
}
/* Backwards from the end of each window: N = T' N L + Z' B with L = T - gain Z and B = F^-1 Z - gain' N L */
EXPORT int adjoint(const System* s, double* by_T, double* by_Z, double* N, double* D) {
  const long long R = s->R, n = s->n, S = s->S, nv = (n + LANES - 1) / LANES, np = nv * LANES;
  const unsigned long long row = n * sizeof(double);
  void* whole;
  V* now = room(&whole, 6 * n * nv + 18 * nv + 6 * n);
  if (!now) return 2;
  V *NL = now + n * nv, *T = NL + n * nv, *P = T + n * nv, *next = P + n * nv, *made = next + n * nv;
  V *Z = made + n * nv, *B = Z + 6 * nv, *BP = B + 6 * nv;
  double *t = (double*)T, *nl = (double*)NL, *NG = (double*)(BP + 6 * nv), less[6 * n];
  for (long long r = 0; r < R; r++) {
    const long long last = steps_of(s, r);
    memset(now, 0, n * nv * sizeof(V));
    for (long long k = last; k >= 0; k--) {
      const long long i = k * R + r;
      const double *own = (double*)now, *gain = s->gain + i * n * 6, *inverse = s->inverse + 36 * i;
      const int unseen = blind(s, i);
      for (long long a = 0; a < n; a++) memcpy((double*)P + a * np, s->P + (i * n + a) * n, row);
      for (int l = 0; l < 6; l++) {
        memcpy((double*)Z + l * np, s->Z + (i * 6 + l) * n, row);
        D[6 * i + l] = s->good[6 * i + l] ? inverse[7 * l] : 0.0;
      }
      if (k < last) {
        for (long long a = 0; a < n; a++) N[i * n + a] = own[a * np + a];
        for (long long a = 0; a < n; a++) memcpy(t + a * np, s->T + (i * n + a) * n, row);
        transposed(s, t, nv, now, next);
        for (long long a = 0; a < n; a++) for (long long b = 0; b < n; b++) nl[b * np + a] = ((double*)next)[a * np + b];
        if (!unseen) {
          for (long long j = 0; j < 6 * n; j++) less[j] = -gain[j];
          for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) {
            double sum = 0.0;
            for (long long b = 0; b < n; b++) sum += own[a * np + b] * less[b * 6 + l];
            NG[a * 6 + l] = sum;
            D[6 * i + l] += less[a * 6 + l] * sum;
          }
          product(n, 6, nv, NG, 6, 1, Z, NL, 1);
        }
        product(S, n, nv, nl, np, 1, P, made, 0);
        for (long long a = 0; a < S; a++) memcpy(by_T + (i * S + a) * n, (double*)made + a * np, row);
        transposed(s, t, nv, NL, next);
      } else memset(next, 0, n * nv * sizeof(V));
      if (!unseen) {
        product(6, 6, nv, inverse, 6, 1, Z, B, 0);
        if (k < last) product(6, n, nv, less, 1, 6, NL, B, 1);
        product(6, n, nv, (double*)B, np, 1, P, BP, 0);
        for (int l = 0; l < 6; l++) memcpy(by_Z + (i * 6 + l) * n, (double*)BP + l * np, row);
        product(n, 6, nv, (double*)Z, 1, np, B, next, 1);
      }
      V* spare = now; now = next; next = spare;
    }
  }
  free(whole);
  return 0;
}
/* Backwards: u = -root' white - gain' r, r = Z' u + T' r; mean has the predicted states, and becomes the smoothed ones */
EXPORT int smooth(const System* s, const double* white, double* mean, double* all_r, double* all_u) {
  const long long R = s->R, n = s->n;
  double now[n], next[n];
  for (long long w = 0; w < R; w++) {
    const long long last = steps_of(s, w);
    memset(now, 0, sizeof(now));
    for (long long k = last; k >= 0; k--) {
      const long long i = k * R + w;
      memset(next, 0, sizeof(next));
      if (k < last) for (long long j = 0; j < n; j++) for (long long e = s->t[j]; e < s->t[j + 1]; e++)
        next[s->t_at[e]] += s->T[(i * n + j) * n + s->t_at[e]] * now[j];
      if (!blind(s, i)) for (int l = 0; l < 6; l++) {
        double u = 0.0;
        for (int j = l; j < 6; j++) u -= s->root[36 * i + 6 * j + l] * white[6 * i + j];
        if (k < last) for (long long a = 0; a < n; a++) u -= s->gain[(i * n + a) * 6 + l] * now[a];
        all_u[6 * i + l] = u;
        for (long long e = s->z[l]; e < s->z[l + 1]; e++) next[s->z_at[e]] += s->Z[(i * 6 + l) * n + s->z_at[e]] * u;
      }
      memcpy(now, next, sizeof(now));
      if (k) memcpy(all_r + (i - R) * n, now, sizeof(now));
      for (long long a = 0; a < n; a++) {
        double sum = 0.0;
        for (long long b = 0; b < n; b++) sum += s->P[(i * n + a) * n + b] * now[b];
        mean[i * n + a] += sum;
      }
    }
  }
  return 0;
}
/* See kalman.by_rates: h / 2 (T' W + W T'), W = by_T with what gusts push by, which have two columns of their own */
EXPORT int by_rates(const System* s, double h, const double* by_T, const double* gusts, double* out) {
  const long long n = s->n, S = s->S, F = S + 3, nv = (F + LANES - 1) / LANES, np = nv * LANES;
  void* whole;
  V* W = room(&whole, (2 * S + F) * nv);
  if (!W) return 2;
  V *made = W + S * nv, *turned = made + S * nv;
  double *w = (double*)W, *m = (double*)made, *t = (double*)turned;
  for (long long i = 0; i < s->K * s->R; i++) if (s->inside[i]) {
    const double *T = s->T + i * n * n, *own = by_T + i * S * n;
    for (long long a = 0; a < S; a++) for (long long j = 0; j < F; j++) {
      double sum = own[a * n + j];
      if (gusts && j >= S) for (int g = 0; g < 2; g++) sum += own[a * n + F + g] * gusts[(i * 3 + j - S) * 2 + g];
      w[a * np + j] = 0.5 * h * sum;
      m[a * np + j] = j < S ? 0.0 : w[a * np + j];
      t[j * np + a] = T[a * n + j];
    }
    product(S, S, nv, T, 1, n, W, made, 1);
    product(S, F, nv, w, np, 1, turned, made, 1);
    for (long long a = 0; a < S; a++) memcpy(out + (i * S + a) * F, m + a * np, F * sizeof(double));
  }
  free(whole);
  return 0;
}

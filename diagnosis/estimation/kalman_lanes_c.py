"""C source of filter and response of one column, eight windows at a time: part of ``diagnosis.estimation.kalman_c``.

Lane l of a vector belongs to window r + l; behind the last window its numbers are taken again and not given back.
"""

from __future__ import annotations

_LANES = """
/* of rows of n numbers those that are not zero in any window, one after the other; windows are apart */
static void taken_few(long long rows, long long n, const long long* first, const long long* at, long long apart,
                      int own, const double* from, V* to) {
  for (int l = 0; l < LANES; l++) {
    const double* p = from + (l < own ? l : own - 1) * apart;
    for (long long i = 0; i < rows; i++) for (long long e = first[i]; e < first[i + 1]; e++)
      ((double*)(to + e))[l] = p[i * n + at[e]];
  }
}
static void seen(const System* s, int own, const double* from, V* to) {
  taken_few(6, s->n, s->z, s->z_at, 6 * s->n, own, from, to);
}
/* of the transitions; room for S rows behind them */
static void moving(const System* s, int own, const double* from, V* to) {
  const long long n = s->n, S = s->S;
  V* all = to + s->t[n];
  taken(S * n, n * n, own, from, all);
  for (long long a = 0; a < S; a++) for (long long e = s->t[a]; e < s->t[a + 1]; e++) to[e] = all[a * n + s->t_at[e]];
  taken_few(n - S, n, s->t + S, s->t_at, n * n, own, from + S * n, to);
}
/* out[i][c] = sum over e of a[i * ai + e * ae] b[at ? at[e] : e][c] (plus what is there), of n columns c, those from i
   on if upper */
#define PART(m, w) { V sum[m][w]; \\
  for (int p = 0; p < m; p++) for (int q = 0; q < w; q++) sum[p][q] = plus ? out[(i + p) * n + c + q] : fill(0.0); \\
  for (long long e = 0; e < count; e++) { \\
    const V* row = b + (at ? at[e] : e) * n + c; const V* x = a + i * ai + e * ae; \\
    V r[w]; for (int q = 0; q < w; q++) r[q] = row[q]; \\
    for (int p = 0; p < m; p++) { const V one = x[p * ai]; for (int q = 0; q < w; q++) sum[p][q] += one * r[q]; } } \\
  for (int p = 0; p < m; p++) for (int q = 0; q < w; q++) out[(i + p) * n + c + q] = sum[p][q]; }
#define PARTS(m) { long long c = upper ? i : 0; \\
  for (; c + 4 <= n; c += 4) PART(m, 4) for (; c + 2 <= n; c += 2) PART(m, 2) for (; c < n; c++) PART(m, 1) }
static void times(long long rows, long long count, long long n, const V* a, long long ai, long long ae, const V* b,
                  const long long* at, V* out, int plus, int upper) {
  long long i = 0;
  for (; i + 3 <= rows; i += 3) PARTS(3)
  for (; i < rows; i++) PARTS(1)
}
static void transposed(long long rows, long long n, const V* a, V* b) {
  for (long long i = 0; i < rows; i++) for (long long j = 0; j < n; j++) b[j * rows + i] = a[i * n + j];
}
static void mirrored(long long n, V* a) {
  for (long long i = 0; i < n; i++) for (long long j = 0; j < i; j++) a[i * n + j] = a[j * n + i];
}
/* out = a X, of a those numbers that are not zero, X of rows of n */
static void times_few(long long rows, const long long* first, const long long* at, const V* a, long long n, const V* X,
                      V* out) {
  for (long long i = 0; i < rows; i++, out += n) for (long long b = 0; b < n; b++) {
    V sum = fill(0.0);
    for (long long e = first[i]; e < first[i + 1]; e++) sum += a[e] * X[at[e] * n + b];
    out[b] = sum;
  }
}
static void observed(const System* s, const V* Z, long long n, const V* X, V* out) {
  times_few(6, s->z, s->z_at, Z, n, X, out);
}
/* out (n, w) = T X of rows of w, those of the first S rows from the diagonal on if upper */
static void through(const System* s, const V* T, long long w, const V* X, V* out, int upper) {
  const long long S = s->S, top = s->t[S > 0];
  times(S, top, w, T, top, 1, X, s->t_at, out, 0, upper);
  times_few(s->n - S, s->t + S, s->t_at, T, w, X, out + S * w);
}
static long long last_of(const System* s, long long r, int own) {
  long long last = 0;
  for (int l = 0; l < own; l++) { const long long k = steps_of(s, r + l); if (k > last) last = k; }
  return last;
}
"""
_FILTER = """
/* Cholesky factor of F, of which the lower half is there; root is its inverse, a lower triangle */
static int whitened(V* F, V* root, V* log_det) {
  V det = fill(1.0), over[6];
  for (int j = 0; j < 6; j++) for (int i = j; i < 6; i++) {
    V x = F[6 * i + j];
    for (int l = 0; l < j; l++) x -= F[6 * i + l] * F[6 * j + l];
    if (i == j) {
      if (any(~(x > fill(0.0)))) return 1;
      F[7 * j] = v_sqrt(x);
      over[j] = 1.0 / F[7 * j];
      det *= F[7 * j];
    } else F[6 * i + j] = x * over[j];
  }
  *log_det += 2.0 * v_log(det);
  for (int j = 0; j < 6; j++) for (int i = j; i < 6; i++) {
    V x = fill(0.0);
    for (int l = j; l < i; l++) x -= F[6 * i + l] * root[6 * l + j];
    root[6 * i + j] = i == j ? over[j] : x * over[i];
  }
  return 0;
}
EXPORT int filter(const System* s) {
  const long long K = s->K, R = s->R, n = s->n, size = n * n, NT = s->t[n], NZ = s->z[6];
  void* whole;
  V* P = room(&whole, 4 * size + NT + NZ + 24 * n + 108);
  if (!P) return 2;
  V *C = P + size, *M = C + size, *T = M + size, *Z = T + NT + size, *ZP = Z + NZ, *Y = ZP + 6 * n, *H = Y + 6 * n;
  V *gain = H + 6 * n, *F = gain + 6 * n, *root = F + 36, *inverse = root + 36;
  memset(P, 0, (char*)(inverse + 36) - (char*)P);
  for (long long r = s->begin; r < s->end; r += LANES) {
    const int own = s->end - r < LANES ? s->end - r : LANES;
    const long long last = last_of(s, r, own);
    V log_det = fill(0.0);
    taken(size, size, own, s->first + r * size, P);
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r;
      given(size, size, own, P, s->P + i * size);
      if (k > last) {
        for (int j = 0; j < 36 * own; j++) s->inverse[36 * i + j] = s->root[36 * i + j] = j % 36 % 7 == 0;
        if (k < K) memset(s->gain + i * n * 6, 0, own * n * 6 * sizeof(double));
        continue;
      }
      seen(s, own, s->Z + i * 6 * n, Z);
      observed(s, Z, n, P, ZP);
      for (int l = 0; l < 6; l++) {
        for (int m = 0; m <= l; m++) {
          V sum = fill(0.0);
          for (long long e = s->z[m]; e < s->z[m + 1]; e++) sum += Z[e] * ZP[l * n + s->z_at[e]];
          F[6 * l + m] = sum;
        }
        for (int j = 0; j < LANES; j++) {
          const unsigned char* good = s->good + 6 * (i + (j < own ? j : own - 1));
          ((double*)(F + 7 * l))[j] += good[l] ? s->white[l] : 1.0;
        }
      }
      if (whitened(F, root, &log_det)) { free(whole); return 1; }
      for (int a = 0; a < 6; a++) for (int b = 0; b <= a; b++) {
        V sum = fill(0.0);
        for (int l = a; l < 6; l++) sum += root[6 * l + a] * root[6 * l + b];
        inverse[6 * a + b] = inverse[6 * b + a] = sum;
      }
      given(36, 36, own, inverse, s->inverse + 36 * i);
      given(36, 36, own, root, s->root + 36 * i);
      if (k == K) break;
      for (int l = 0; l < 6; l++) times(1, l + 1, n, root + 6 * l, 0, 1, ZP, 0, Y + l * n, 0, 0);
      times(6, 6, n, root, 1, 6, Y, 0, H, 0, 0);
      moving(s, own, s->T + i * size, T);
      transposed(6, n, H, Y);
      through(s, T, 6, Y, gain, 0);
      given(6 * n, 6 * n, own, gain, s->gain + i * n * 6);
      memcpy(C, P, size * sizeof(V));
      for (long long j = 0; j < 6 * n; j++) H[j] = -H[j];
      times(n, 6, n, ZP, 1, n, H, 0, C, 1, 1);
      mirrored(n, C);
      through(s, T, n, C, M, 0);
      transposed(n, n, M, C);
      through(s, T, n, C, P, 1);
      for (int j = 0; j < LANES; j++) if (s->inside[i + (j < own ? j : own - 1)])
        for (long long a = 0; a < n; a++) ((double*)(P + a * n + a))[j] += s->Q[a];
      mirrored(n, P);
    }
    for (int l = 0; l < own; l++) s->log_det[r + l] = ((double*)&log_det)[l];
  }
  free(whole);
  return 0;
}
typedef struct {
  long long c, m, d, apart;
  const double *forcing, *scale, *observed, *start;
  const long long* observing;
  double *white, *states;
  const long long* place;
} Columns;
static int response(const System* s, const Columns* f) {
  const long long K = s->K, R = s->R, n = s->n, NT = s->t[n], NZ = s->z[6], m = f->m;
  void* whole;
  V* x = room(&whole, 2 * n + NT + n * n + NZ + 8 * n + 64);
  if (!x) return 2;
  V *next = x + n, *T = next + n, *Z = T + NT + n * n, *gain = Z + NZ, *root = gain + 6 * n, *w = root + 36, *u = w + 6;
  V *push = u + 6, *scale = push + n;
  for (long long r = s->begin; r < s->end; r += LANES) {
    const int own = s->end - r < LANES ? s->end - r : LANES;
    const long long last = last_of(s, r, own);
    memset(x, 0, n * sizeof(V));
    if (f->start) taken(n, n, own, f->start + r * n, x);
    *scale = fill(1.0);
    if (f->scale) taken(1, 1, own, f->scale + r, scale);
    for (long long k = 0; k <= K; k++) {
      const long long i = k * R + r, at = f->place ? f->place[k] : k;
      if (f->states) given(n, n, own, x, f->states + i * n);
      if (k <= last) {
        seen(s, own, s->Z + i * 6 * n, Z);
        taken(36, 36, own, s->root + 36 * i, root);
        observed(s, Z, 1, x, w);
        for (int l = 0; f->d && l < 6; l++) for (int j = 0; j < own; j++) if (s->good[6 * (i + j) + l])
          ((double*)(w + l))[j] += ((double*)scale)[j] * f->observed[(i + j) * 6 + l];
      } else memset(w, 0, 6 * sizeof(V));
      for (int l = 0; l < 6; l++) {
        u[l] = fill(0.0);
        for (int j = 0; j <= l; j++) u[l] += root[6 * l + j] * w[j];
      }
      if (at >= 0) for (int l = 0; l < 6; l++) for (int j = 0; j < own; j++)
        f->white[((at * R + r + j) * 6 + l) * f->apart] = ((double*)(u + l))[j];
      if (k == K || k > last) continue;
      moving(s, own, s->T + i * n * n, T);
      taken(6 * n, 6 * n, own, s->gain + i * n * 6, gain);
      taken(m, m, own, f->forcing + i * m, push);
      for (int j = 0; j < own; j++) if (!s->inside[i + j])
        for (long long a = 0; a < m; a++) ((double*)(push + a))[j] = 0.0;
      for (long long a = 0; a < n; a++) {
        V sum = a < m ? *scale * push[a] : fill(0.0);
        for (long long e = s->t[a]; e < s->t[a + 1]; e++) sum += T[e] * x[s->t_at[e]];
        for (int l = 0; l < 6; l++) sum -= gain[6 * a + l] * w[l];
        next[a] = sum;
      }
      V* spare = x; x = next; next = spare;
    }
  }
  free(whole);
  return 0;
}
"""
FILTER = _LANES + _FILTER

"""C source of smoother and adjoint, which go backwards in time: part of ``diagnosis.estimation.kalman_c``."""

from __future__ import annotations

BACKWARD = """
EXPORT int smoothed(const System* s, const double* white, const double* states, double* mean, double* rs, double* us) {
  const long long K = s->K, R = s->R, n = s->n;
  double *q = malloc(2 * n * sizeof(double)), *next = q + n;
  if (!q) return 2;
  for (long long r = s->begin; r < s->end; r++) {
    memset(q, 0, n * sizeof(double));
    for (long long k = K; k >= 0; k--) {
      const long long i = k * R + r;
      const double *root = s->root + 36 * i, *w = white + 6 * i, *Z = s->Z + i * 6 * n, *P = s->P + i * n * n;
      const int blind = nothing(s->good + 6 * i);
      double v[6] = {0}, *u = us + 6 * i;
      for (int l = 0; l < 6; l++) for (int j = l; j < 6; j++) v[l] -= root[6 * j + l] * w[j];
      memcpy(u, v, sizeof v);
      if (k < K) {
        const double *gain = s->gain + i * n * 6, *L = s->L + i * n * n;
        memcpy(rs + i * n, q, n * sizeof(double));
        for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) u[l] -= gain[a * 6 + l] * q[a];
        memset(next, 0, n * sizeof(double));
        for (long long a = 0; a < n; a++) for (long long b = 0; b < n; b++) next[b] += L[a * n + b] * q[a];
        memcpy(q, next, n * sizeof(double));
      }
      if (!blind) for (int l = 0; l < 6; l++) for (long long b = 0; b < n; b++) q[b] += Z[l * n + b] * v[l];
      for (long long a = 0; a < n; a++) {
        double x = states[i * n + a];
        for (long long b = 0; b < n; b++) x += P[a * n + b] * q[b];
        mean[i * n + a] = x;
      }
    }
  }
  free(q);
  return 0;
}
EXPORT int adjoint(const System* s, double* by_T, double* by_Z, double* Ns, double* Ds) {
  const long long K = s->K, R = s->R, n = s->n, nv = (n + LANES - 1) / LANES, np = nv * LANES;
  void* whole;
  V* N = room(&whole, 5 * n * nv + 24 * nv);
  if (!N) return 2;
  V *L = N + n * nv, *P = L + n * nv, *NL = P + n * nv, *bT = NL + n * nv, *Z = bT + n * nv;
  V *IZ = Z + 6 * nv, *bZ = IZ + 6 * nv, *NG = bZ + 6 * nv;
  memset(N, 0, (5 * n * nv + 24 * nv) * sizeof(V));
  double *nn = (double*)N, *bz = (double*)bZ, *ng = (double*)NG;
  for (long long r = s->begin; r < s->end; r++) {
    const long long own = steps_of(s, r);
    memset(N, 0, n * nv * sizeof(V));
    for (long long k = K; k >= 0; k--) {
      const long long i = k * R + r;
      const int blind = nothing(s->good + 6 * i);
      const double *inverse = s->inverse + 36 * i, *gain = s->gain + i * n * 6;
      double* D = Ds + 6 * i;
      for (int l = 0; l < 6; l++) D[l] = inverse[7 * l];
      if (k >= own && k < K) {
        memset(Ns + i * n, 0, n * sizeof(double));
        memset(by_T + i * n * n, 0, n * n * sizeof(double));
      }
      if (k > own) {
        memset(by_Z + i * 6 * n, 0, 6 * n * sizeof(double));
        continue;
      }
      spread(n, n, np, s->P + i * n * n, (double*)P);
      if (blind) memset(bZ, 0, 6 * nv * sizeof(V));
      else {
        spread(6, n, np, s->Z + i * 6 * n, (double*)Z);
        product(6, 6, nv, inverse, 6, 1, Z, IZ, 0);
        product(6, n, nv, (double*)IZ, np, 1, P, bZ, 0);
      }
      if (k < own) {
        for (long long a = 0; a < n; a++) Ns[i * n + a] = nn[a * np + a];
        spread(n, n, np, s->L + i * n * n, (double*)L);
        product(n, n, nv, nn, np, 1, L, NL, 0);
        product(n, n, nv, (double*)NL, np, 1, P, bT, 0);
        narrow(n, n, np, (double*)bT, by_T + i * n * n);
        if (!blind) {
          product(6, n, nv, gain, 1, 6, N, NG, 0);
          for (int l = 0; l < 6; l++) for (long long a = 0; a < n; a++) D[l] += gain[a * 6 + l] * ng[l * np + a];
          product(6, n, nv, gain, 1, 6, bT, NG, 0);
          for (long long j = 0; j < 6 * nv; j++) bZ[j] -= NG[j];
        }
        product(n, n, nv, (double*)L, 1, np, NL, N, 0);
      }
      narrow(6, n, np, bz, by_Z + i * 6 * n);
      if (!blind) product(n, 6, nv, (double*)Z, 1, np, IZ, N, 1);
    }
  }
  free(whole);
  return 0;
}
EXPORT int by_rates(const System* s, long long A, double h, const double* by_T, double* out) {
  const long long n = s->n, B = A + 3, nv = (B + LANES - 1) / LANES, np = nv * LANES;
  void* whole;
  V* weight = room(&whole, (2 * B + A) * nv);
  if (!weight) return 2;
  V *ahead = weight + A * nv, *sum = ahead + B * nv;
  double *w = (double*)weight, *f = (double*)ahead;
  memset(weight, 0, (2 * B + A) * nv * sizeof(V));
  for (long long a = A; a < B; a++) f[a * np + a] = 1.0;
  for (long long k = 0; k < s->K; k++) for (long long r = s->begin; r < s->end; r++) {
    const long long i = k * s->R + r;
    double* own = out + i * A * B;
    if (!s->inside[i]) { memset(own, 0, A * B * sizeof(double)); continue; }
    const double *T = s->T + i * n * n, *by = by_T + i * n * n;
    for (long long a = 0; a < A; a++) for (long long b = 0; b < B; b++) {
      w[a * np + b] = 0.5 * h * by[a * n + b];
      f[b * np + a] = T[a * n + b];
    }
    product(A, A, nv, T, 1, n, weight, sum, 0);
    product(A, B, nv, w, np, 1, ahead, sum, 1);
    narrow(A, B, np, (double*)sum, own);
  }
  free(whole);
  return 0;
}
"""

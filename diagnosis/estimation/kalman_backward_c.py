"""C source of smoother and adjoint, which go backwards in time: part of ``diagnosis.estimation.kalman_c``."""

from __future__ import annotations

BACKWARD = """
EXPORT int smoothed(const System* s, const double* white, const double* states, double* mean, double* rs, double* us) {
  const long long K = s->K, R = s->R, n = s->n, NT = s->t[n], NZ = s->z[6];
  void* whole;
  V* q = room(&whole, 3 * n + NT + NZ + 6 * n + 48 + 2 * n * n);
  if (!q) return 2;
  V *next = q + n, *state = next + n, *T = state + n, *Z = T + NT + n * n, *gain = Z + NZ, *root = gain + 6 * n;
  V *w = root + 36, *u = w + 6, *P = u + 6;
  for (long long r = s->begin; r < s->end; r += LANES) {
    const int own = s->end - r < LANES ? s->end - r : LANES;
    memset(q, 0, n * sizeof(V));
    for (long long k = K; k >= 0; k--) {
      const long long i = k * R + r;
      taken(36, 36, own, s->root + 36 * i, root);
      taken(6, 6, own, white + 6 * i, w);
      seen(s, own, s->Z + i * 6 * n, Z);
      for (int l = 0; l < 6; l++) {
        u[l] = fill(0.0);
        for (int j = l; j < 6; j++) u[l] -= root[6 * j + l] * w[j];
      }
      if (k < K) {
        given(n, n, own, q, rs + i * n);
        moving(s, own, s->T + i * n * n, T);
        taken(6 * n, 6 * n, own, s->gain + i * n * 6, gain);
        for (long long a = 0; a < n; a++) for (int l = 0; l < 6; l++) u[l] -= gain[a * 6 + l] * q[a];
        memset(next, 0, n * sizeof(V));
        for (long long a = 0; a < n; a++)
          for (long long e = s->t[a]; e < s->t[a + 1]; e++) next[s->t_at[e]] += T[e] * q[a];
        memcpy(q, next, n * sizeof(V));
      }
      given(6, 6, own, u, us + 6 * i);
      for (int l = 0; l < 6; l++) for (long long e = s->z[l]; e < s->z[l + 1]; e++) q[s->z_at[e]] += Z[e] * u[l];
      taken(n, n, own, states + i * n, state);
      taken(n * n, n * n, own, s->P + i * n * n, P);
      for (long long a = 0; a < n; a++) for (long long b = 0; b < n; b++) state[a] += P[a * n + b] * q[b];
      given(n, n, own, state, mean + i * n);
    }
  }
  free(whole);
  return 0;
}
EXPORT int adjoint(const System* s, double* by_T, double* by_Z, double* Ns, double* Ds) {
  const long long K = s->K, R = s->R, n = s->n, S = s->S, size = n * n, NT = s->t[n], NZ = s->z[6], top = s->t[S > 0];
  void* whole;
  V* N = room(&whole, 5 * size + NT + NZ + 36 * n + 48);
  if (!N) return 2;
  V *X = N + size, *P = X + size, *bT = P + size, *T = bT + size, *Z = T + NT + size, *gain = Z + NZ;
  V *KN = gain + 6 * n, *XK = KN + 6 * n, *ZP = XK + 6 * n, *bZ = ZP + 6 * n;
  V *inverse = bZ + 6 * n, *D = inverse + 36;
  for (long long r = s->begin; r < s->end; r += LANES) {
    const int own = s->end - r < LANES ? s->end - r : LANES;
    const long long last = last_of(s, r, own);
    memset(N, 0, size * sizeof(V));
    for (long long k = K; k >= 0; k--) {
      const long long i = k * R + r;
      if (k > last) {
        for (int j = 0; j < 6 * own; j++) Ds[6 * i + j] = 1.0;
        memset(by_Z + i * 6 * n, 0, own * 6 * n * sizeof(double));
        if (k < K) {
          memset(Ns + i * n, 0, own * n * sizeof(double));
          memset(by_T + i * size, 0, own * size * sizeof(double));
        }
        continue;
      }
      taken(36, 36, own, s->inverse + 36 * i, inverse);
      seen(s, own, s->Z + i * 6 * n, Z);
      taken(size, size, own, s->P + i * size, P);
      observed(s, Z, n, P, ZP);
      times(6, 6, n, inverse, 6, 1, ZP, 0, bZ, 0, 0);
      for (int l = 0; l < 6; l++) D[l] = inverse[7 * l];
      if (k < K) {
        for (long long a = 0; a < n; a++) for (int l = 0; l < own; l++)
          Ns[(i + l) * n + a] = ((double*)(N + a * n + a))[l];
        moving(s, own, s->T + i * size, T);
        taken(6 * n, 6 * n, own, s->gain + i * n * 6, gain);
        times(6, n, n, gain, 1, 6, N, 0, KN, 0, 0);
        for (int l = 0; l < 6; l++) for (long long a = 0; a < n; a++) D[l] += gain[a * 6 + l] * KN[l * n + a];
        /* X = L'N = T'N - Z'K'N */
        memset(X, 0, size * sizeof(V));
        times(top, S, n, T, 1, top, N, 0, bT, 0, 0);
        for (long long e = 0; e < top; e++) memcpy(X + s->t_at[e] * n, bT + e * n, n * sizeof(V));
        for (long long a = S; a < n; a++) for (long long e = s->t[a]; e < s->t[a + 1]; e++)
          for (long long b = 0; b < n; b++) X[s->t_at[e] * n + b] += T[e] * N[a * n + b];
        for (int l = 0; l < 6; l++) for (long long e = s->z[l]; e < s->z[l + 1]; e++)
          for (long long b = 0; b < n; b++) X[s->z_at[e] * n + b] -= Z[e] * KN[l * n + b];
        times(n, n, n, X, 1, n, P, 0, bT, 0, 0);
        given(size, size, own, bT, by_T + i * size);
        for (long long j = 0; j < 6 * n; j++) gain[j] = -gain[j];
        times(6, n, n, gain, 1, 6, bT, 0, bZ, 1, 0);
        /* N = X L = X T - X K Z */
        times(n, n, 6, X, n, 1, gain, 0, XK, 0, 0);
        times(n, S, top, X, n, 1, T, 0, P, 0, 0);
        memset(N, 0, size * sizeof(V));
        for (long long b = 0; b < n; b++) for (long long e = 0; e < top; e++) N[b * n + s->t_at[e]] = P[b * top + e];
        for (long long a = S; a < n; a++) for (long long e = s->t[a]; e < s->t[a + 1]; e++)
          for (long long b = 0; b <= s->t_at[e]; b++) N[b * n + s->t_at[e]] += X[b * n + a] * T[e];
        for (int l = 0; l < 6; l++) for (long long e = s->z[l]; e < s->z[l + 1]; e++)
          for (long long b = 0; b <= s->z_at[e]; b++) N[b * n + s->z_at[e]] += XK[b * 6 + l] * Z[e];
      }
      given(6, 6, own, D, Ds + 6 * i);
      given(6 * n, 6 * n, own, bZ, by_Z + i * 6 * n);
      for (int l = 0; l < 6; l++) for (long long e = s->z[l]; e < s->z[l + 1]; e++) for (int m = 0; m < 6; m++)
        for (long long g = s->z[m]; g < s->z[m + 1]; g++) if (s->z_at[g] >= s->z_at[e])
          N[s->z_at[e] * n + s->z_at[g]] += Z[e] * inverse[6 * l + m] * Z[g];
      mirrored(n, N);
    }
  }
  free(whole);
  return 0;
}
EXPORT int by_rates(const System* s, long long A, double h, const double* by_T, const double* gusts, double* out) {
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
    if (gusts) for (long long a = 0; a < A; a++) for (int b = 0; b < 3; b++)
      for (int g = 0; g < 2; g++) w[a * np + A + b] += 0.5 * h * by[a * n + B + g] * gusts[i * 6 + 2 * b + g];
    product(A, A, nv, T, 1, n, weight, sum, 0);
    product(A, B, nv, w, np, 1, ahead, sum, 1);
    narrow(A, B, np, (double*)sum, own);
  }
  free(whole);
  return 0;
}
/* T and Z; gusts, of which there are two, or none */
EXPORT int assembled(const System* s, long long count, const double* F, const double* force, const double* H,
                     const double* decay, const long long* coloured, const double* gusts, double* T, double* Z) {
  const long long K = s->K, R = s->R, n = s->n, S = s->S, seen = n - count;
  for (long long k = 0; k <= K; k++) for (long long r = s->begin; r < s->end; r++) {
    const long long i = k * R + r;
    double *t = T + i * n * n, *z = Z + i * 6 * n;
    if (k < K) {
      memset(t, 0, n * n * sizeof(double));
      if (s->inside[i]) for (long long a = 0; a < S; a++, t += n) {
        const double* f = force + (i * S + a) * 3;
        for (long long b = 0; b < S; b++) t[b] = F[(i * S + a) * S + b];
        for (int b = 0; b < 3; b++) t[S + b] = f[b];
        if (gusts) for (int g = 0; g < 2; g++)
          t[S + 3 + g] = f[0] * gusts[i * 6 + g] + f[1] * gusts[i * 6 + 2 + g] + f[2] * gusts[i * 6 + 4 + g];
      } else for (long long a = 0; a < S; a++, t += n) t[a] = 1.0;
      for (long long a = S; a < n; a++, t += n) t[a] = s->inside[i] ? decay[a - S] : 1.0;
    }
    memset(z, 0, 6 * n * sizeof(double));
    for (int l = 0; l < 6; l++) if (s->good[6 * i + l]) {
      for (long long b = 0; b < S; b++) z[l * n + b] = H[(i * 6 + l) * S + b];
      for (long long e = 0; e < count; e++) if (coloured[e] == l) z[l * n + seen + e] = 1.0;
    }
  }
  return 0;
}
"""

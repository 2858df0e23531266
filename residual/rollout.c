/* Rollouts of a ship with a residual of two layers, and their gradients: compiled by residual/physics.py. */
typedef struct { long long points, steps, euler; double h; @arrays@ } Run;
#define S @S@
#define C @C@
#define F @F@
#define H @H@
#define BLOCK(p, rows, t, x, f) for (int j = 0; j < (rows); j++) f((p) + ((t) * (rows) + j) * r->points + at, x[j])
#define KEEP(p, v) store(p, v)
#define TAKE(p, v) v = load(p)
static const V zero[S + F + H];
__attribute__((optimize("fp-contract=fast"), noinline))
static void affine(const double* W, const double* b, const V* x, V* y, int rows, int columns) {
  int i = 0;
  for (; i + 4 <= rows; i += 4) {
    const double *w0 = W + i * columns, *w1 = w0 + columns, *w2 = w1 + columns, *w3 = w2 + columns;
    V s0 = fill(b ? b[i] : 0), s1 = fill(b ? b[i + 1] : 0), s2 = fill(b ? b[i + 2] : 0), s3 = fill(b ? b[i + 3] : 0);
    for (int j = 0; j < columns; j++) {
      s0 += w0[j] * x[j]; s1 += w1[j] * x[j]; s2 += w2[j] * x[j]; s3 += w3[j] * x[j];
    }
    y[i] = s0; y[i + 1] = s1; y[i + 2] = s2; y[i + 3] = s3;
  }
  for (; i < rows; i++) {
    V s = fill(b ? b[i] : 0);
    for (int j = 0; j < columns; j++) s += W[i * columns + j] * x[j];
    y[i] = s;
  }
}
static void call(void (*f)(), const V* a0, const V* a1, const V* a2, const V* a3, const double* h, const V* a5,
                 V* y0, V* y1, int kind) {
  const double* long_[] = {(const double*)a0, (const double*)a1, (const double*)a2, (const double*)a3, h,
                           (const double*)a5};
  const double* short_[] = {(const double*)a0, (const double*)a3, (const double*)a5};
  const long long full[] = {LANES, LANES, LANES, LANES, 0, LANES}, three[] = {LANES, LANES, LANES};
  double* results[] = {(double*)y0, (double*)y1};
  ((void (*)(long long, const double* const*, const long long*, double* const*))f)(
      LANES, kind ? long_ : short_, kind ? full : three, results);
}
static void stage(const Run* r, long long at, long long t, const V* base, const V* z, const V* c,
                  double h, V* y) {
  V x[F], t1[H], t2[H], a[3];
  call((void (*)())physics_features, z, 0, 0, c, 0, 0, x, 0, 0);
  affine(r->W1, r->b1, x, t1, H, F);
  for (int i = 0; i < H; i++) t1[i] = v_tanh(t1[i]);
  affine(r->W2, r->b2, t1, t2, H, H);
  for (int i = 0; i < H; i++) t2[i] = v_tanh(t2[i]);
  affine(r->W3, r->b3, t2, a, 3, H);
  BLOCK(r->Z, S, t, z, KEEP); BLOCK(r->X, F, t, x, KEEP); BLOCK(r->T1, H, t, t1, KEEP); BLOCK(r->T2, H, t, t2, KEEP);
  call((void (*)())physics_advance, base, z, a, c, &h, 0, y, 0, 1);
}
static void back(const Run* r, long long at, long long t, const V* c, double h, const V* seed, V* g) {
  V z[S], t1[H], t2[H], ga[3], g1[H], g2[H], gx[F], gz[S];
  BLOCK(r->Z, S, t, z, TAKE); BLOCK(r->T1, H, t, t1, TAKE); BLOCK(r->T2, H, t, t2, TAKE);
  call((void (*)())physics_advance_reverse, zero, z, zero, c, &h, seed, g, ga, 1);
  affine(r->W3, 0, ga, g2, H, 3);
  for (int i = 0; i < H; i++) g2[i] *= 1.0 - t2[i] * t2[i];
  affine(r->W2, 0, g2, g1, H, H);
  for (int i = 0; i < H; i++) g1[i] *= 1.0 - t1[i] * t1[i];
  affine(r->W1, 0, g1, gx, F, H);
  BLOCK(r->GA, 3, t, ga, KEEP); BLOCK(r->G1, H, t, g1, KEEP); BLOCK(r->G2, H, t, g2, KEEP);
  call((void (*)())physics_features_reverse, z, 0, 0, c, 0, gx, gz, 0, 0);
  for (int s = 0; s < S; s++) g[s] += gz[s];
}
#define EACH(x) for (int s = 0; s < S; s++) { x; }
EXPORT void forward(const Run* r) {
  const long long M = r->points;
  memcpy(r->out, r->start, S * M * sizeof(double));
  for (long long n = 0; n < r->steps; n++) for (long long at = 0; at < M; at += LANES) {
    V z[S], y1[S], y2[S], y3[S], mean[S], c[C];
    EACH(z[s] = load(r->out + (n * S + s) * M + at))
    for (int j = 0; j < C; j++) c[j] = load(r->controls + (n * C + j) * M + at);
    if (r->euler) {
      stage(r, at, n, z, z, c, r->h, y1);
      EACH(z[s] = y1[s])
    } else {
      stage(r, at, 4 * n, z, z, c, r->h / 2, y1);
      stage(r, at, 4 * n + 1, z, y1, c, r->h / 2, y2);
      stage(r, at, 4 * n + 2, z, y2, c, r->h, y3);
      EACH(mean[s] = (y1[s] + 2.0 * y2[s] + y3[s] - z[s]) / 3.0)
      stage(r, at, 4 * n + 3, mean, y3, c, r->h / 6, z);
    }
    EACH(store(r->out + ((n + 1) * S + s) * M + at, z[s]))
  }
}
EXPORT void backward(const Run* r) {
  const long long M = r->points;
  memcpy(r->first, r->seeds + r->steps * S * M, S * M * sizeof(double));
  for (long long n = r->steps - 1; n >= 0; n--) for (long long at = 0; at < M; at += LANES) {
    V g[S], y1[S], y2[S], y3[S], old[S], c[C];
    for (int j = 0; j < C; j++) c[j] = load(r->controls + (n * C + j) * M + at);
    EACH(old[s] = load(r->first + s * M + at))
    if (r->euler) {
      back(r, at, n, c, r->h, old, y1);
      EACH(g[s] = old[s] + y1[s])
    } else {
      back(r, at, 4 * n + 3, c, r->h / 6, old, y3);
      EACH(y3[s] += old[s] / 3.0)
      back(r, at, 4 * n + 2, c, r->h, y3, y2);
      EACH(y2[s] += old[s] * 2.0 / 3.0)
      back(r, at, 4 * n + 1, c, r->h / 2, y2, y1);
      EACH(y1[s] += old[s] / 3.0)
      back(r, at, 4 * n, c, r->h / 2, y1, g);
      EACH(g[s] += y1[s] + y2[s] + y3[s] - old[s] / 3.0)
    }
    EACH(store(r->first + s * M + at, g[s] + load(r->seeds + (n * S + s) * M + at)))
  }
}

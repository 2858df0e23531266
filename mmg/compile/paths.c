#include <stdlib.h>
typedef void (*Kernel)(long long, const double* const*, const long long*, double* const*);
static const long long LD[8] = {LANES, LANES, LANES, LANES, LANES, LANES, LANES, LANES};
typedef struct {
  long long K, R, S, C, all, changes, by_window;
  const double *z, *inputs, *theta, *force;
  const long long *force_at, *count;
  double h;
} Path;
static V* room(void** whole, long long vectors) {
  char* p = *whole = malloc((vectors + 1) * sizeof(V));
  if (!p) return 0;
  V* at = (V*)(p + (sizeof(V) - (unsigned long long)p % sizeof(V)));
  memset(at, 0, vectors * sizeof(V));
  return at;
}
/* count numbers of each of own rows, apart from those of the next, into lanes, of which the others have the last row */
static void taken(long long count, long long apart, int own, const double* from, V* to) {
  for (int l = 0; l < LANES; l++) {
    const double* p = from + (l < own ? l : own - 1) * apart;
    for (long long j = 0; j < count; j++) to[j][l] = p[j];
  }
}
/* the same back */
static void given(long long count, long long apart, int own, const V* from, double* to) {
  for (int l = 0; l < own; l++) for (long long j = 0; j < count; j++) to[l * apart + j] = from[j][l];
}
static inline long long least(long long a, long long b) { return a < b ? a : b; }
/* Steps of window r that are wanted. */
static inline long long steps_of(const Path* p, long long r) {
  return p->count ? least(p->count[r], p->K) : p->K;
}
static void coefficients(const Path* p, long long r, V* theta) {
  for (long long a = 0; a < p->all; a++) theta[a] = fill(p->by_window ? p->theta[a * p->R + r] : p->theta[a]);
}
/* Numbers of the steps from k on, wide each, into lanes; behind the last one its own. */
static void along(const Path* p, const double* from, long long r, long long k, long long last, long long wide, V* to) {
  if (k > last) k = last;
  taken(wide, p->R * wide, least(LANES, last + 1 - k), from + (k * p->R + r) * wide, to);
}
static void pushed(const Path* p, long long r, long long k, const V* theta, V* own) {
  V force[3];
  along(p, p->force, r, k, p->K - 1, 3, force);
  for (int f = 0; f < 3; f++) own[p->force_at[f]] = theta[p->force_at[f]] + force[f];
}
static void states(const Path* p, long long r, long long k, long long last, V* z) {
  along(p, p->z, r, k, last, p->S, z);
}
static void held(const Path* p, long long r, long long k, V* c) {
  along(p, p->inputs, r, k, p->K - 1, p->changes ? 2 * p->C : p->C, c);
}
static void during(const Path* p, const V* c, double part, V* own) {
  for (long long j = 0; j < p->C; j++) own[j] = p->changes ? c[j] + (part - 0.5) * c[p->C + j] : c[j];
}
static const double NODES[4] = {@nodes@}, WEIGHTS[4] = {@weights@};
typedef struct {
  long long A, W, P, count, nonzeros, direct;
  const long long *entry, *first, *column, *own_entry, *own_place, *of_G, *of_force;
  double *end, *F, *G, *force;
} Steps;
/* slope = J_p + J_z (I + far before), and its weighted sum; x: room for a row of J_z */
static void chained(const Steps* q, const V* J, double far, const V* before, double weight, V* x, V* slope, V* sum) {
  const long long A = q->A, W = q->W;
  memset(slope, 0, A * W * sizeof(V));
  for (long long e = 0; e < q->direct; e++) slope[q->own_place[e]] = J[q->own_entry[e]];
  for (long long a = 0; a < A; a++) {
    V *to = slope + a * W, *all = sum + a * W;
    const long long begin = q->first[a], count = q->first[a + 1] - begin, *column = q->column + begin;
    for (long long e = 0; e < count; e++) to[column[e]] += J[q->entry[begin + e]];
    long long w = 0;
    if (before) {
      for (long long e = 0; e < count; e++) x[e] = far * J[q->entry[begin + e]];
      for (; w + 4 <= W; w += 4) {  /* four columns in registers: a quarter faster than one */
        V s0 = to[w], s1 = to[w + 1], s2 = to[w + 2], s3 = to[w + 3];
        for (long long e = 0; e < count; e++) {
          const V* from = before + column[e] * W + w;
          s0 += x[e] * from[0]; s1 += x[e] * from[1]; s2 += x[e] * from[2]; s3 += x[e] * from[3];
        }
        to[w] = s0; to[w + 1] = s1; to[w + 2] = s2; to[w + 3] = s3;
        all[w] += weight * s0; all[w + 1] += weight * s1; all[w + 2] += weight * s2; all[w + 3] += weight * s3;
      }
      for (long long v = w; v < W; v++) for (long long e = 0; e < count; e++) to[v] += x[e] * before[column[e] * W + v];
    }
    for (; w < W; w++) all[w] += weight * to[w];
  }
}
EXPORT int steps(const Path* p, Kernel jacobian, const Steps* q) {
  const long long S = p->S, A = q->A, W = q->W, R = p->R, P = q->P;
  void* whole;
  V* z = room(&whole, 4 * S + 3 * p->C + 2 * p->all + q->nonzeros + q->count + 3 * A * W + A * (A + P + 3) + 8);
  if (!z) return 2;
  V *at = z + S, *rate = at + S, *total = rate + S, *c = total + S, *now = c + 2 * p->C, *theta = now + p->C;
  V *own = theta + p->all, *J = own + p->all, *slope = J + q->nonzeros, *other = slope + A * W, *sum = other + A * W;
  V *x = sum + A * W, *wanted = x + q->count;
  const double* arg[3] = {(double*)at, (double*)now, (double*)own};
  double* res[2] = {(double*)rate, (double*)J};
  for (long long r = 0; r < R; r++) {
    coefficients(p, r, theta);
    memcpy(own, theta, p->all * sizeof(V));
    const long long K = steps_of(p, r);
    for (long long k = 0; k < K; k += LANES) {
      const int here = least(LANES, K - k);
      states(p, r, k, p->K - 1, z);
      held(p, r, k, c);
      if (p->force) pushed(p, r, k, theta, own);
      for (int i = 0; i < 4; i++) {
        const double far = NODES[i] * p->h;
        for (long long s = 0; s < S; s++) at[s] = i ? z[s] + far * rate[s] : z[s];
        during(p, c, NODES[i], now);
        jacobian(LANES, arg, LD, res);
        if (!i) memset(sum, 0, A * W * sizeof(V));
        chained(q, J, far, i ? other : 0, WEIGHTS[i], x, slope, sum);
        V* spare = other; other = slope; slope = spare;
        for (long long s = 0; s < S; s++) total[s] = i ? total[s] + WEIGHTS[i] * rate[s] : WEIGHTS[i] * rate[s];
      }
      for (long long w = 0; w < A * W; w++) sum[w] = p->h * sum[w];
      for (long long a = 0; a < A; a++) sum[a * W + a] += 1.0;
      const long long i = k * R + r;
      for (long long s = 0; s < S; s++) z[s] += p->h * total[s];
      given(S, R * S, here, z, q->end + i * S);
      for (long long a = 0; a < A; a++) memcpy(wanted + a * A, sum + a * W, A * sizeof(V));
      given(A * A, R * A * A, here, wanted, q->F + i * A * A);
      for (long long a = 0; a < A; a++) for (long long b = 0; b < P; b++) wanted[a * P + b] = sum[a * W + q->of_G[b]];
      given(A * P, R * A * P, here, wanted, q->G + i * A * P);
      for (long long a = 0; a < A; a++) for (int b = 0; b < 3; b++) wanted[a * 3 + b] = sum[a * W + q->of_force[b]];
      given(A * 3, R * A * 3, here, wanted, q->force + i * A * 3);
    }
  }
  free(whole);
  return 0;
}
EXPORT int follow(const Path* p, Kernel rates, const unsigned char* carried, const unsigned char* whole_state,
                  double* path) {
  const long long S = p->S, R = p->R, C = p->C, wide = p->changes ? 2 * C : C;
  void* whole;
  V* z = room(&whole, 6 * S + 3 * C + 2 * p->all + 8);
  if (!z) return 2;
  V *at = z + S, *k1 = at + S, *k2 = k1 + S, *k3 = k2 + S, *k4 = k3 + S, *c = k4 + S, *now = c + 2 * C;
  V *theta = now + C, *own = theta + p->all, *k[4] = {k1, k2, k3, k4};
  const double* arg[3] = {(double*)at, (double*)now, (double*)own};
  for (long long first = 0; first < R; first += LANES) {
    long long window[LANES];
    for (int l = 0; l < LANES; l++) window[l] = least(first + l, R - 1);
    for (long long a = 0; a < p->all; a++) for (int l = 0; l < LANES; l++)
      own[a][l] = theta[a][l] = p->by_window ? p->theta[a * R + window[l]] : p->theta[a];
    for (long long step = 0; step < p->K; step++) {
      for (long long s = 0; s < S; s++) for (int l = 0; l < LANES; l++) z[s][l] = path[(step * R + window[l]) * S + s];
      for (long long j = 0; j < wide; j++) for (int l = 0; l < LANES; l++)
        c[j][l] = p->inputs[(step * R + window[l]) * wide + j];
      if (p->force) for (int f = 0; f < 3; f++) for (int l = 0; l < LANES; l++)
        own[p->force_at[f]][l] = theta[p->force_at[f]][l] + p->force[(step * R + window[l]) * 3 + f];
      for (int i = 0; i < 4; i++) {
        for (long long s = 0; s < S; s++) at[s] = i ? z[s] + NODES[i] * p->h * k[i - 1][s] : z[s];
        during(p, c, NODES[i], now);
        double* res[1] = {(double*)k[i]};
        rates(LANES, arg, LD, res);
      }
      for (long long s = 0; s < S; s++) {
        V sum = WEIGHTS[0] * k1[s] + WEIGHTS[1] * k2[s] + WEIGHTS[2] * k3[s] + WEIGHTS[3] * k4[s];
        const V end = z[s] + p->h * sum;
        for (int l = 0; l < LANES && first + l < R; l++)
          if (carried[s] || whole_state[step * R + first + l]) path[((step + 1) * R + first + l) * S + s] = end[l];
      }
    }
  }
  free(whole);
  return 0;
}

"""C source that goes along paths of a ship by its batch kernels: steps with sensitivities, logged columns, weighted
second derivatives, rollouts.

The kernels of ``mmg.compile.codegen`` are called through pointers, LANES points at a time, so that this file is
compiled once for all ships. A window's points are LANES neighbouring steps; in a rollout they are LANES windows. Each
function goes along the windows from begin to end.
"""

from __future__ import annotations

from mmg.compile.codegen import prelude
from mmg.compile.transposed_c import TRANSPOSED
from mmg.runge_kutta import NODES, WEIGHTS

FLAGS = (
    "-O2",
    "-ftree-vectorize",
    "-fPIC",
    "-shared",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
    "-w",
)

_BEGIN = """
#include <stdlib.h>
typedef void (*Kernel)(long long, const double* const*, const long long*, double* const*);
static const long long LD[8] = {LANES, LANES, LANES, LANES, LANES, LANES, LANES, LANES};
typedef struct {
  long long K, R, S, C, all, changes, by_window, begin, end;
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
"""
_STEPS = """
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
      for (; w + 4 <= W; w += 4) {
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
  for (long long r = p->begin; r < p->end; r++) {
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
"""
_LOGGED = """
typedef struct {
  long long A, d, count, nonzeros;
  const long long *entry, *row, *column;
  double *y, *H, *D;
} Logged;
EXPORT int logged(const Path* p, Kernel jacobian, const Logged* q) {
  const long long S = p->S, R = p->R;
  void* whole;
  V* z = room(&whole, S + p->all + 6 + q->nonzeros + 8);
  if (!z) return 2;
  V *theta = z + S, *y = theta + p->all, *J = y + 6;
  const double* arg[2] = {(double*)z, (double*)theta};
  double* res[2] = {(double*)y, (double*)J};
  for (long long r = p->begin; r < p->end; r++) {
    coefficients(p, r, theta);
    const long long K = steps_of(p, r);
    for (long long k = 0; k <= K; k += LANES) {
      const int here = least(LANES, K + 1 - k);
      states(p, r, k, p->K, z);
      jacobian(LANES, arg, LD, res);
      for (int l = 0; l < here; l++) {
        const long long i = (k + l) * R + r;
        for (int j = 0; j < 6; j++) q->y[6 * i + j] = y[j][l];
        for (long long e = 0; e < q->count; e++) {
          const long long row = 6 * i + q->row[e], column = q->column[e];
          if (column < q->A) q->H[row * q->A + column] = J[q->entry[e]][l];
          else q->D[row * q->d + column - q->A] = J[q->entry[e]][l];
        }
      }
    }
  }
  free(whole);
  return 0;
}
EXPORT int weighted(const Path* p, Kernel hessian, long long rates, long long count, const long long* from,
                    long long wide, const double* weight, long long P, double* out) {
  const long long S = p->S, R = p->R, rows = rates ? p->K : p->K + 1;
  void* whole;
  V* z = room(&whole, 2 * S + 3 * p->C + 2 * p->all + count + 2 * P + 8);
  if (!z) return 2;
  V *after = z + S, *c = after + S, *now = c + 2 * p->C, *theta = now + p->C, *own = theta + p->all;
  V *chosen = own + p->all, *found = chosen + count, *sum = found + P;
  const double* of_rates[4] = {(double*)z, (double*)now, (double*)own, (double*)chosen};
  const double* of_logged[3] = {(double*)z, (double*)own, (double*)chosen};
  double* res[1] = {(double*)found};
  for (long long r = p->begin; r < p->end; r++) {
    coefficients(p, r, theta);
    memcpy(own, theta, p->all * sizeof(V));
    memset(sum, 0, P * sizeof(V));
    for (long long k = 0; k < rows; k += LANES) {
      states(p, r, k, rows - 1, z);
      int some = 0;
      for (long long e = 0; e < count; e++) for (int l = 0; l < LANES; l++) {
        const double x = from[e] < 0 || k + l >= rows ? 0.0 : weight[((k + l) * R + r) * wide + from[e]];
        chosen[e][l] = x;
        some |= x != 0.0;
      }
      if (!some) continue;
      if (rates) {
        states(p, r, k + 1, p->K, after);
        for (long long s = 0; s < S; s++) z[s] = 0.5 * (z[s] + after[s]);
        held(p, r, k, c);
        during(p, c, 0.5, now);
        if (p->force) pushed(p, r, k, theta, own);
      }
      hessian(LANES, rates ? of_rates : of_logged, LD, res);
      for (long long j = 0; j < P; j++) sum[j] += found[j];
    }
    for (long long j = 0; j < P; j++) {
      double x = 0;
      for (int l = 0; l < LANES; l++) x += sum[j][l];
      out[r * P + j] += x;
    }
  }
  free(whole);
  return 0;
}
"""
_FOLLOW = """
EXPORT int follow(const Path* p, Kernel rates, const unsigned char* carried, const unsigned char* whole_state,
                  double* path) {
  const long long S = p->S, R = p->R, C = p->C, wide = p->changes ? 2 * C : C;
  void* whole;
  V* z = room(&whole, 6 * S + 3 * C + 2 * p->all + 8);
  if (!z) return 2;
  V *at = z + S, *k1 = at + S, *k2 = k1 + S, *k3 = k2 + S, *k4 = k3 + S, *c = k4 + S, *now = c + 2 * C;
  V *theta = now + C, *own = theta + p->all, *k[4] = {k1, k2, k3, k4};
  const double* arg[3] = {(double*)at, (double*)now, (double*)own};
  for (long long first = p->begin; first < p->end; first += LANES) {
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
"""


def source() -> str:
    """The C file with ``steps``, ``logged``, ``weighted`` and ``follow``."""
    tables = {"@nodes@": NODES, "@weights@": WEIGHTS}
    steps = _STEPS
    for key, values in tables.items():
        steps = steps.replace(key, ", ".join(repr(float(x)) for x in values))
    return prelude() + TRANSPOSED + _BEGIN + steps + _LOGGED + _FOLLOW

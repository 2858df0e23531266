"""CUDA source of whole rollouts and their adjoint, one thread per trajectory, from the ship's CasADi functions.

The integration is that of ``residual.physics.fused_rollout``: Runge-Kutta 4, inputs held over each step. Arrays have
the layout of the struct Run there. exp, tanh, sin, cos and atan2 are those of ``mmg.compile.vector_math``.
"""

from __future__ import annotations

import casadi as ca

from mmg.compile.codegen import constant, expression, prelude
from residual.physics.fused_rollout import FusedRollout
from residual.physics.operator import Operator

_INCLUDES = "#include <math.h>\n#include <string.h>\n"

_LOOPS = """
#define S @S@
#define C @C@
#define F @F@
#define H @H@
#define WEIGHTS (H * F + H + H * H + H + 3 * H + 3)
#define EACH(x) _Pragma("unroll") for (int s = 0; s < S; s++) { x; }
typedef struct { long long points, steps; double h; @arrays@ } Run;
template <int rows, int columns> DEVICE void affine(const double* W, const double* b, const double* x, double* y) {
  constexpr int part = rows % 8 ? rows : 8;
  _Pragma("unroll 1")
  for (int i = 0; i < rows; i += part) {
    double sum[part];
    _Pragma("unroll")
    for (int k = 0; k < part; k++) sum[k] = b ? b[i + k] : 0.0;
    _Pragma("unroll 4")
    for (int j = 0; j < columns; j++) {
      _Pragma("unroll")
      for (int k = 0; k < part; k++) sum[k] += W[j * rows + i + k] * x[j];
    }
    _Pragma("unroll")
    for (int k = 0; k < part; k++) y[i + k] = sum[k];
  }
}
template <int rows> DEVICE void keep(double* p, const Run& r, long long t, long long at, const double* x) {
  _Pragma("unroll")
  for (int j = 0; j < rows; j++) p[(t * rows + j) * r.points + at] = x[j];
}
template <int rows> DEVICE void take(const double* p, const Run& r, long long t, long long at, double* x) {
  _Pragma("unroll")
  for (int j = 0; j < rows; j++) x[j] = p[(t * rows + j) * r.points + at];
}
DEVICE void stage(const Run& r, const double* w, long long at, long long t, const double* base, const double* z,
                  const double* c, double h, double* y) {
  double x[F], t1[H], t2[H], a[3];
  physics_features(z, c, x);
  affine<H, F>(w, w + H * F, x, t1);
  w += H * F + H;
  _Pragma("unroll 4")
  for (int i = 0; i < H; i++) t1[i] = v_tanh(t1[i]);
  affine<H, H>(w, w + H * H, t1, t2);
  w += H * H + H;
  _Pragma("unroll 4")
  for (int i = 0; i < H; i++) t2[i] = v_tanh(t2[i]);
  affine<3, H>(w, w + 3 * H, t2, a);
  if (r.Z) {
    keep<S>(r.Z, r, t, at, z); keep<F>(r.X, r, t, at, x); keep<H>(r.T1, r, t, at, t1); keep<H>(r.T2, r, t, at, t2);
  }
  physics_advance(base, z, a, c, &h, y);
}
DEVICE void back(const Run& r, const double* w, long long at, long long t, const double* c, double h,
                 const double* seed, double* g) {
  const double zero[S + 3] = {0};
  double z[S], t1[H], t2[H], ga[3], g1[H], g2[H], gx[F], gz[S];
  take<S>(r.Z, r, t, at, z);
  physics_advance_reverse(zero, z, zero, c, &h, seed, g, ga);
  take<H>(r.T2, r, t, at, t2);
  affine<H, 3>(w + F * H + H * H, 0, ga, g2);
  _Pragma("unroll 4")
  for (int i = 0; i < H; i++) g2[i] *= 1.0 - t2[i] * t2[i];
  affine<H, H>(w + F * H, 0, g2, g1);
  take<H>(r.T1, r, t, at, t1);
  _Pragma("unroll 4")
  for (int i = 0; i < H; i++) g1[i] *= 1.0 - t1[i] * t1[i];
  affine<F, H>(w, 0, g1, gx);
  keep<3>(r.GA, r, t, at, ga); keep<H>(r.G1, r, t, at, g1); keep<H>(r.G2, r, t, at, g2);
  physics_features_reverse(z, c, gx, gz);
  EACH(g[s] += gz[s])
}
KERNEL void forward(Run r) {
  SHARED(w, WEIGHTS)
  LOAD(w, r.weights, WEIGHTS)
  const long long at = THREAD, M = r.points;
  if (at >= M) return;
  double z[S], y1[S], y2[S], y3[S], mean[S], c[C];
  EACH(z[s] = r.start[s * M + at])
  EACH(r.out[s * M + at] = z[s])
  for (long long n = 0; n < r.steps; n++) {
    take<C>(r.controls, r, n, at, c);
    _Pragma("unroll 1")
    for (int k = 0; k < 4; k++) {
      const double part = k < 2 ? r.h / 2 : k == 2 ? r.h : r.h / 6;
      double in[S], from[S], y[S];
      EACH(from[s] = k == 3 ? mean[s] : z[s])
      EACH(in[s] = k == 0 ? z[s] : k == 1 ? y1[s] : k == 2 ? y2[s] : y3[s])
      stage(r, w, at, 4 * n + k, from, in, c, part, y);
      if (k == 0) { EACH(y1[s] = y[s]) }
      if (k == 1) { EACH(y2[s] = y[s]) }
      if (k == 2) { EACH(y3[s] = y[s]) EACH(mean[s] = (y1[s] + 2.0 * y2[s] + y3[s] - z[s]) / 3.0) }
      if (k == 3) { EACH(z[s] = y[s]) }
    }
    EACH(r.out[((n + 1) * S + s) * M + at] = z[s])
  }
}
KERNEL void backward(Run r) {
  SHARED(w, WEIGHTS)
  LOAD(w, r.weights, WEIGHTS)
  const long long at = THREAD, M = r.points;
  if (at >= M) return;
  double old[S], c[C];
  EACH(old[s] = r.seeds[(r.steps * S + s) * M + at])
  for (long long n = r.steps - 1; n >= 0; n--) {
    take<C>(r.controls, r, n, at, c);
    double seed[S], sum[S];
    EACH(seed[s] = old[s])
    EACH(sum[s] = -old[s] / 3.0)
    _Pragma("unroll 1")
    for (int k = 3; k >= 0; k--) {
      const double part = k < 2 ? r.h / 2 : k == 2 ? r.h : r.h / 6;
      double g[S];
      back(r, w, at, 4 * n + k, c, part, seed, g);
      EACH(seed[s] = g[s] + (k == 0 ? 0.0 : k == 2 ? old[s] * 2.0 / 3.0 : old[s] / 3.0))
      EACH(sum[s] += k ? seed[s] : g[s])
    }
    EACH(old[s] = sum[s] + r.seeds[(n * S + s) * M + at])
    EACH(r.first[s * M + at] = old[s])
  }
}
"""

_ON_DEVICE = """
#define DEVICE static __device__ __forceinline__
#define KERNEL extern "C" __global__
#define SHARED(w, n) __shared__ double w[n];
#define LOAD(w, from, n) for (int i = threadIdx.x; i < (n); i += blockDim.x) w[i] = (from)[i]; __syncthreads();
#define THREAD (blockIdx.x * (long long)blockDim.x + threadIdx.x)
"""

ARRAYS = (
    "start", "controls", "weights", "seeds",
    "out", "Z", "X", "T1", "T2", "G1", "G2", "GA", "first",
)  # fmt: skip
"""Pointers of the struct Run, behind points, steps and h. weights: for ``forward`` the transposed W1, b1, W2, b2, W3,
b3 one after the other; for ``backward`` W1, W2, W3 as they are and the biases, which it does not use."""


def device_function(function: ca.Function) -> str:
    """A C++ function of pointers, one per input and output that has elements, of an SXFunction with dense outputs."""
    f, lines, name_of = function, [], {}
    for k in range(f.n_instructions()):
        operation, inputs, outputs = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            lines.append(f"y{outputs[0]}[{outputs[1]}] = {name_of[inputs[0]]};")
            continue
        if operation == ca.OP_CONST:
            text = constant(f.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            text = f"x{inputs[0]}[{inputs[1]}]"
        else:
            text = expression(operation, [name_of[i] for i in inputs])
        lines.append(f"const double a{k} = {text};")
        name_of[outputs[0]] = f"a{k}"
    given = [f"const double* x{i}" for i in range(f.n_in()) if f.nnz_in(i)]
    made = [f"double* y{j}" for j in range(f.n_out())]
    return f"DEVICE void {f.name()}({', '.join(given + made)}) {{\n  " + "\n  ".join(lines) + "\n}\n"


def cuda_source(fused: FusedRollout, surroundings: str = _ON_DEVICE) -> str:
    """One CUDA file with the kernels ``forward`` and ``backward`` of a ship with a network of one width.

    surroundings: the macros DEVICE, KERNEL, SHARED, LOAD and THREAD, by default those of CUDA.
    """
    advance, features = (Operator(fused.physics.functions[name]) for name in ("advance", "features"))
    parts = [advance.function, features.function, advance.adjoint((1, 2)), features.adjoint((0,))]
    text = _LOOPS.replace("@arrays@", " ".join(f"double* {name};" for name in ARRAYS))
    for name in "SCFH":
        text = text.replace(f"@{name}@", str(getattr(fused, name)))
    begin = prelude(1).replace(_INCLUDES, "").replace("static inline", "DEVICE").replace("static V", "DEVICE V")
    return surroundings + begin + "".join(device_function(f) for f in parts) + text

"""Whole rollouts of a ship with a two-layer network, and their gradients, as one C function each way.

Forward keeps the inputs of every evaluation of the network; backward runs the adjoint of the integration and writes the
gradients at the inputs of each layer, from which those of the weights are three matrix products over all evaluations.
The equations are those of ``residual.physics.operator``, called for eight trajectories at a time.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from mmg.compile.batch import padded
from mmg.compile.batch_source import source
from mmg.compile.cache import load_library
from residual.bounded_network import TwoLayers
from residual.physics.operator import Operator, Physics

FLAGS = ("-O2", "-ftree-vectorize", "-ffp-contract=off", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math")
_ARRAYS = (
    "start", "controls", "W1", "b1", "W2", "b2", "W3", "b3", "seeds",
    "out", "Z", "X", "T1", "T2", "G1", "G2", "GA", "first",
)  # fmt: skip
"""Arrays of the C struct Run: inputs, then results; T evaluations of the network, points contiguous.

W1 (H, F) ... b3 (3,): the layers, transposed (F, H), (H, H), (H, 3) for backward; seeds (N + 1, S, M) of the states
out; Z (T, S, M): states at which it was evaluated; X (T, F, M), T1, T2 (T, H, M): features, hidden layers; G1, G2
(T, H, M), GA (T, 3, M): gradients at the inputs of the layers and at the accelerations; first (S, M): at the start.
"""

_LOOP = """
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
"""


class _Run(ctypes.Structure):
    """The struct Run of the C code."""

    _fields_ = (
        [(name, ctypes.c_longlong) for name in ("points", "steps", "euler")]
        + [("h", ctypes.c_double)]
        + [(name, ctypes.c_void_p) for name in _ARRAYS]
    )


class FusedRollout:
    """Rollouts of a ship with a residual of one width, compiled when first used."""

    def __init__(self, physics: Physics, width: int) -> None:
        self.physics = physics
        self.S, self.C = len(physics.model.states), len(physics.model.controls)
        self.F, self.H = len(physics.ship.features), width
        self._spare: dict[tuple[str, tuple[int, ...]], Tensor] = {}

    def taken(self, name: str, shape: tuple[int, ...]) -> Tensor:
        """An array of that shape: the one of the last gradient step if it is free, since fresh memory is slow."""
        spare = self._spare.pop((name, shape), None)
        return torch.empty(shape, dtype=torch.float64) if spare is None else spare

    def give_back(self, name: str, a: Tensor) -> None:
        """An array that ``taken`` may hand out again."""
        if name in ("Z", "X", "T1", "T2", "G1", "G2", "GA"):
            self._spare[name, tuple(a.shape)] = a

    @cached_property
    def library(self) -> ctypes.CDLL | None:
        """The compiled code; None where that is not possible."""
        advance, features = (Operator(self.physics.functions[name]) for name in ("advance", "features"))
        parts = [advance.function, features.function, advance.adjoint((1, 2)), features.adjoint((0,))]
        text = _LOOP.replace("@arrays@", " ".join(f"double* {name};" for name in _ARRAYS))
        for name in "SCFH":
            text = text.replace(f"@{name}@", str(getattr(self, name)))
        return load_library(source(parts) + text, FLAGS)[0]

    def __call__(self, start: Tensor, controls: Tensor, h: float, residual: TwoLayers, method: str = "rk4") -> Tensor:
        """States (N + 1, S, M) from start (S, M) under inputs (N, C, M) held over steps of h [s], float64.

        Gradients go to the start and to the weights of the residual. method: "rk4" or "euler". Raises RuntimeError
        without a C compiler.
        """
        M = start.shape[1]
        if start.shape != (self.S, M) or controls.shape[1:] != (self.C, M) or residual.W1.shape != (self.H, self.F):
            raise ValueError(f"start {tuple(start.shape)}, inputs {tuple(controls.shape)} or weights do not fit")
        if self.library is None:
            raise RuntimeError("no C compiler for fused rollouts; use Physics.step")
        extra = padded(M) - M
        if extra:
            start, controls = (torch.cat([a, a[..., -1:].expand(*a.shape[:-1], extra)], -1) for a in (start, controls))
        states = _Rollout.apply(self, controls, h, method == "euler", start, *residual.plain())
        return states[..., :M] if extra else states


class _Rollout(torch.autograd.Function):
    """A rollout in torch's graph."""

    @staticmethod
    def forward(ctx: Any, fused: FusedRollout, controls: Tensor, h: float, euler: bool, *given: Tensor) -> Tensor:
        N, M = len(controls), controls.shape[2]
        T = N if euler else 4 * N
        sizes = {"Z": (T, fused.S), "X": (T, fused.F), "T1": (T, fused.H), "T2": (T, fused.H)}
        names = ("controls", "start", "W1", "b1", "W2", "b2", "W3", "b3")
        arrays = {name: a.detach().contiguous() for name, a in zip(names, (controls, *given), strict=True)}
        arrays["out"] = torch.empty((N + 1, fused.S, M), dtype=torch.float64)
        arrays |= {name: fused.taken(name, (*size, M)) for name, size in sizes.items()}
        ctx.fused, ctx.settings = fused, (M, N, euler, h)
        _run(fused, "forward", ctx.settings, arrays)
        out = arrays.pop("out")
        ctx.arrays = arrays
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, seeds: Tensor) -> tuple[Any, ...]:
        fused, kept, (M, N, euler, _) = ctx.fused, ctx.arrays, ctx.settings
        if not kept:
            raise RuntimeError("a fused rollout goes backward once; simulate again")
        T = N if euler else 4 * N
        arrays = {"seeds": seeds.contiguous(), **{name: kept[name] for name in ("controls", "Z", "T1", "T2")}}
        arrays |= {name: kept[name].T.contiguous() for name in ("W1", "W2", "W3")}
        arrays["first"] = torch.empty((fused.S, M), dtype=torch.float64)
        arrays |= {
            name: fused.taken(name, (T, rows, M)) for name, rows in (("G1", fused.H), ("G2", fused.H), ("GA", 3))
        }
        _run(fused, "backward", ctx.settings, arrays)
        gradients: list[Tensor] = []
        for at, given in (("G1", "X"), ("G2", "T1"), ("GA", "T2")):
            gradients += [(arrays[at] @ kept[given].transpose(1, 2)).sum(0), arrays[at].sum((0, 2))]
        for name, a in (*arrays.items(), *kept.items()):
            fused.give_back(name, a)
        kept.clear()
        return None, None, None, None, arrays["first"], *gradients


def _run(fused: FusedRollout, which: str, settings: Sequence[Any], arrays: dict[str, Tensor]) -> None:
    """Call the C function on tensors by name; those that it does not touch are null."""
    if any(a.dtype != torch.float64 or not a.is_cpu for a in arrays.values()):
        raise ValueError("fused rollouts need float64 tensors on the processor")
    pointers = [arrays[name].data_ptr() if name in arrays else None for name in _ARRAYS]
    getattr(fused.library, which)(ctypes.byref(_Run(*settings[:3], settings[3], *pointers)))

"""Gyro: the logged turn rate is off by a share and late by a lag."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.motion.flow import Flow
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory, lagged


class Gyro(Effect):
    """Gain and lag of the turn rate."""

    name, enters = "gyro", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        k = time_scale(p.L)
        return (
            Parameter("share", 0.0, 0.01, -0.3, 0.3, "", "logged turn rate larger than the true one by this share"),
            Parameter("T", 0.0, 0.3 * k, 0.0, 5.0 * k, "s", "lag of the logged turn rate", held=True),
        )

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        late = lagged(memory, "gyro.r", y[5], e.T, 0.5 * time_scale(p.L), 0.05 / time_scale(p.L))
        return [*y[:5], late * (1 + e.share)]

    def samples(self, t: np.ndarray, y: Columns, flow: Flow, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        return [*y[:5], low_passed_samples(t, y[5], e.T) * (1 + e.share)]

    def corrected(self, t: np.ndarray, y: Columns, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        # the lag undone: T r' + r, with the slope over 1.5 s of a 3 m model so that noise is not differentiated
        return [*y[:5], (y[5] + e.T * slope(t, y[5], 1.5 * time_scale(p.L))) / (1 + e.share)]


def slope(t: np.ndarray, x: np.ndarray, width: float) -> np.ndarray:
    """Rates (N,) of samples x (N,) at t (N,) [s]: slopes of straight lines through what lies within ``width`` [s]."""
    half = max(1, round(0.5 * width / float(np.median(np.diff(t)))))
    kernel = np.ones(min(2 * half + 1, len(t)))

    def summed(values: np.ndarray) -> np.ndarray:
        return np.convolve(values, kernel, mode="same")

    s = t - t[0]  # small numbers: sums of squares of a clock since 1970 would cancel
    count, st, sx = summed(np.ones(len(t))), summed(s), summed(x)
    return (summed(s * x) - st * sx / count) / (summed(s * s) - st**2 / count)


def low_passed_samples(t: np.ndarray, x: np.ndarray, T: float) -> np.ndarray:
    """Samples x (N,) at t (N,) [s] after a first-order lag of T [s]: (N,), exact for x linear between samples, settled
    at the start."""
    if T == 0:  # to the last bit what it was
        return x
    out = x.astype(float).copy()
    for k, h in enumerate(np.diff(t)):
        decay, slope = math.exp(-h / T), (x[k + 1] - x[k]) / h
        out[k + 1] = x[k + 1] - slope * T + (out[k] - x[k] + slope * T) * decay
    return out

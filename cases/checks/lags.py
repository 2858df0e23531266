"""Lag, gain and correlation between a logged and a derived signal, one channel or the velocity vector."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from cases.checks.motion import Motion, delayed, smoothed
from cases.evidence.tails import normal_tail

LONGEST_LAG = 5.0
"""s (or 20 samples, whichever is longer): lags are looked for up to this."""

FRAMES = ("earth", "body")

ARM_PAYS = 0.7
"""A lever arm is allowed for where it brings the mean square misfit below this share."""

LEVEL = 0.01
"""Probability by chance of a lag of a channel."""

Channel = dict[str, float | None]


def compare(logged: np.ndarray, derived: np.ndarray, dt: float) -> Channel:
    """Lag [s] of the logged signal behind the derived one, their correlation there, and the gain.

    logged, derived: (N,), NaN in gaps; dt: [s]. The lag maximises the absolute correlation, between samples by a
    parabola through the three highest points. lag_s is None where the signals hardly correlate, the peak
    lies at the end of the search, or a lag explains nothing beyond chance that lag zero does not.
    """
    nothing: Channel = dict.fromkeys(("lag_s", "gain", "correlation"))
    reach = _reach(len(logged), dt)
    if np.sum(np.isfinite(logged) & np.isfinite(derived)) < 50 or reach < 2:
        return nothing

    def cost(k: int) -> float:
        value = _correlation(*_aligned(logged, derived, k))
        return math.inf if math.isnan(value) else -abs(value)

    best, least, lag = _search(cost, reach, dt)
    if not math.isfinite(least):
        return nothing
    top = _correlation(*_aligned(logged, derived, best))
    unexplained = (1.0 - cost(0) ** 2) / max(1.0 - top**2, 1e-12)
    if abs(top) <= 0.3 or (best != 0 and (unexplained <= 1.05 or _by_chance(unexplained, len(logged), reach, dt))):
        lag = None
    return {"lag_s": lag, "gain": gain(logged, delayed(derived, (lag or 0.0) / dt)), "correlation": top}


def _by_chance(unexplained: float, rows: int, reach: int, dt: float) -> bool:
    """Whether noise gives the best lag such a ratio of squares ``unexplained`` without and with it: a likelihood ratio
    of what is independent after smoothing among ``rows``, for each lag within ``reach`` that is."""
    width = smoothed(dt)
    ratio = rows / width * math.log(max(unexplained, 1.0))
    return (2 * reach + 1) / width * 2 * normal_tail(math.sqrt(ratio)) > LEVEL


def gain(logged: np.ndarray, derived: np.ndarray) -> float | None:
    """sum(logged^2) / sum(logged * derived), both (N,): the noisier derived signal stands in one factor only."""
    good = np.isfinite(logged) & np.isfinite(derived)
    a, b = logged[good], derived[good]
    size = math.sqrt(float(a @ a) * float(b @ b))
    along = float(a @ b)
    return float(a @ a) / along if size > 0 and abs(along) > 0.5 * size else None


def velocity_lag(m: Motion) -> dict[str, Any]:
    """By how much (u, v) of ``m`` lag its track [s], if late in the earth frame and if late in body axes.

    "earth": u + i v = exp(-i psi(t)) V(t - lag), V the velocity of the track: a late satellite velocity turned by the
    present heading. "body": u + i v = exp(-i psi(t - lag)) V(t - lag): finished columns late. misfit: RMS of what is
    left over RMS of V. frame: the hypothesis with the smaller misfit. In a turn at steady speed a lever arm of speed
    times lag looks the same, so an arm is allowed for (with_arm) only where it takes away a good part of the misfit.
    """
    plain = {frame: _vector_lag(m, frame, False) for frame in FRAMES}
    arm = {frame: _vector_lag(m, frame, True) for frame in FRAMES}
    with_arm = min(x[1] for x in arm.values()) ** 2 < ARM_PAYS * min(x[1] for x in plain.values()) ** 2
    out: dict[str, Any] = {"with_arm": with_arm}
    for frame in FRAMES:
        out[f"{frame}_s"], out[f"{frame}_misfit"] = (arm if with_arm else plain)[frame]
    out["frame"] = "earth" if out["earth_misfit"] <= out["body_misfit"] else "body"
    return out


def aligned_track(m: Motion, lag: dict[str, Any]) -> np.ndarray:
    """Body-axes velocity of the track of ``m`` (N,), complex u + i v, late by ``lag`` as ``velocity_lag`` gives it."""
    track, back = m.north + 1j * m.east, np.exp(-1j * m.psi)
    steps = (lag[f"{lag['frame']}_s"] or 0.0) / m.dt
    return delayed(track, steps) * back if lag["frame"] == "earth" else delayed(track * back, steps)


def _vector_lag(m: Motion, frame: str, with_arm: bool) -> tuple[float | None, float]:
    """(lag [s] or None at the end of the search, misfit there) of (u, v) behind the track."""
    reach = _reach(len(m.u), m.dt)
    track, back, logged = m.north + 1j * m.east, np.exp(-1j * m.psi), m.u + 1j * m.v
    size = float(np.nanmean(np.abs(track) ** 2))

    def error_at(k: int) -> float:
        here, there = _overlap(len(m.u), k)
        error = track[there] * back[here if frame == "earth" else there] - logged[here]
        return _mean_square(error, m.turn[here], with_arm)

    _, least, lag = _search(error_at, reach, m.dt)
    return lag, math.sqrt(least / max(size, 1e-24))


def _search(cost: Callable[[int], float], reach: int, dt: float) -> tuple[int, float, float | None]:
    """Steps in [-reach, reach] with the least cost, that cost, and the lag [s] where the parabola through it and its
    neighbours is least; None at the end of the search.

    Coarse steps first: everything compared is smoothed over 1.1 s, so 0.4 s cannot step over a minimum.
    """
    cost, stride = cache(cost), max(1, round(0.4 / dt))
    coarse = range(-reach, reach + 1, stride)
    centre = min(coarse, key=cost)
    best = min([*coarse, *range(max(centre - stride, -reach), min(centre + stride, reach) + 1)], key=cost)
    if abs(best) >= reach:
        return best, cost(best), None
    left, right = cost(best - 1), cost(best + 1)
    curvature = left - 2 * cost(best) + right
    vertex = 0.5 * (left - right) / curvature if 0 < curvature < math.inf else 0.0
    return best, cost(best), float(best + vertex) * dt


def _mean_square(error: np.ndarray, turn: np.ndarray, with_arm: bool) -> float:
    """Mean square of the velocity error, after the best arm times i turn is taken out when asked for."""
    good = np.isfinite(error) & np.isfinite(turn)
    if good.sum() < 30:
        return math.inf
    error, turn = error[good], turn[good]
    total, power = float(np.vdot(error, error).real), float(turn @ turn)
    if with_arm and power > 1e-12:
        total -= abs(complex(turn @ error)) ** 2 / power
    return max(total, 0.0) / len(error)


def _reach(rows: int, dt: float) -> int:
    return min(max(round(LONGEST_LAG / dt), 20), rows // 4)


def _overlap(rows: int, k: int) -> tuple[slice, slice]:
    """Rows i of one signal and i - k of the other, where both exist."""
    return slice(max(k, 0), rows + min(k, 0)), slice(max(-k, 0), rows - max(k, 0))


def _aligned(logged: np.ndarray, derived: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (logged at i, derived at i - k) where both are finite."""
    here, there = _overlap(len(logged), k)
    a, b = logged[here], derived[there]
    good = np.isfinite(a) & np.isfinite(b)
    return a[good], b[good]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if len(a) < 30:
        return math.nan
    x, y = a - a.mean(), b - b.mean()
    size = math.sqrt(float(x @ x) * float(y @ y))
    return float(x @ y) / size if size > 1e-14 else math.nan

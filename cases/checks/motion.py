"""Velocities that follow from track and heading, on a uniform clock, smoothed alike; noise of logged columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.trial import Trial

SMOOTHING = 1.1
"""s; moving average over the measured and the derived velocities (at least 5 samples): below it the
differentiated satellite position is noise."""


@dataclass(frozen=True)
class Motion:
    """One trial on a uniform clock. All arrays (N,), NaN in gaps; missing positions give NaN velocities.

    dt [s], psi unwrapped [rad]; u, v [m/s], r [rad/s] as logged; north, east [m/s] from the
    position; turn [rad/s] from the heading. u ... turn are smoothed by the same moving average.
    """

    dt: float
    psi: np.ndarray
    u: np.ndarray
    v: np.ndarray
    r: np.ndarray
    north: np.ndarray
    east: np.ndarray
    turn: np.ndarray


def motion(trial: Trial) -> Motion:
    """The motion of a ``trial``, interpolated linearly onto its median step, but not across gaps."""
    dt = trial.dt
    t = trial.t[0] + dt * np.arange(min(round(trial.duration / dt) + 1, 20 * len(trial)))
    width = smoothed(dt)
    x, y, psi, u, v, r = (uniform(trial.t, column, t, dt) for column in trial.states.T)
    derived = (np.gradient(column, dt) for column in (x, y, psi))
    return Motion(dt, psi, *(smooth(column, width) for column in (u, v, r, *derived)))


def smoothed(dt: float) -> int:
    """Samples ``dt`` [s] apart over which everything is smoothed, an odd number."""
    return max(round(SMOOTHING / dt), 5) | 1


def smooth(values: np.ndarray, width: int) -> np.ndarray:
    """Centred moving average of ``values`` (N,) over ``width`` samples, (N,), NaN where the window is not complete."""
    out = np.full(len(values), np.nan, dtype=np.result_type(values, float))
    if len(values) < width:
        return out
    kernel, whole = np.full(width, 1.0 / width), slice(width // 2, len(values) - width // 2)
    if np.iscomplexobj(values):  # by parts: for real numbers there is a quicker way
        out.real[whole], out.imag[whole] = (np.convolve(part, kernel, "valid") for part in (values.real, values.imag))
    else:
        out[whole] = np.convolve(values, kernel, "valid")
    return out


def delayed(values: np.ndarray, steps: float) -> np.ndarray:
    """``values`` (N,) late by a number of ``steps`` (linear between samples), (N,), NaN outside."""
    shift, weight = shift_and_weight(steps)
    return (1 - weight) * ahead(values, shift) + weight * ahead(values, shift + 1)


def shift_and_weight(steps: float) -> tuple[int, float]:
    """How many samples ``ahead`` values lie that are late by a number of ``steps``, and the share of those one further
    ahead."""
    whole = round(-steps)
    shift = whole if abs(whole + steps) < 1e-9 else math.floor(-steps)
    return shift, max(-steps - shift, 0.0)


def ahead(values: np.ndarray, shift: int) -> np.ndarray:
    """``values`` (N,) ``shift`` samples later, (N,), NaN outside."""
    out = np.full(len(values), np.nan, dtype=np.result_type(values, float))
    first, last = max(0, -shift), min(len(values), len(values) - shift)
    if last > first:
        out[first:last] = values[first + shift : last + shift]
    return out


def uniform(t: np.ndarray, values: np.ndarray, clock: np.ndarray, dt: float) -> np.ndarray:
    """``values`` (N,) logged at ``t`` (N,) [s] on another ``clock`` (M,) [s] of step ``dt`` [s]: (M,), NaN
    outside, and where more than 3 dt are missing.
    """
    good = np.flatnonzero(np.isfinite(values))
    if len(good) < 2:
        return np.full(len(clock), np.nan)
    out = np.interp(clock, t[good], values[good], left=np.nan, right=np.nan)
    for i in np.flatnonzero(np.diff(t[good]) > 3 * dt):
        out[(clock > t[good[i]]) & (clock < t[good[i + 1]])] = np.nan
    return out


def white_noise(stretches: Sequence[np.ndarray], needed: slice = slice(None)) -> np.ndarray:
    """Standard deviation (6,) of the white noise of logged states, each in its own unit; 0 where it is not known.

    stretches: neighbouring samples (N, 6) each; needed: columns without which a sample does not count. Robust: by the
    median size of third differences, in which the motion leaves little: 0.6745 sqrt(20) for white noise of size 1.
    """
    thirds = [np.diff(stretch, n=3, axis=0) for stretch in stretches if len(stretch) > 3]
    d = np.vstack([*thirds, np.empty((0, 6))])
    d = d[np.isfinite(d[:, needed]).all(axis=1)]
    known = np.isfinite(d).any(axis=0)
    noise = np.zeros(6)
    noise[known] = np.nanmedian(np.abs(d[:, known]), axis=0) / 0.6745 / np.sqrt(20.0)
    return noise

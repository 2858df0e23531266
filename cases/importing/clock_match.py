"""Clocks of the logs of one run against each other: course over ground follows heading, and by how much late.

Between both lies the drift angle. It makes the course late by a few per cent of the period in which the ship swings,
and never early. What lies beyond, or changes along the run, is a matter of clocks.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.log_columns import Log

EARLIEST, LATEST, USUAL = 0.0, 0.10, 0.05
"""Times by which the course of a ship may be late, and usually is, in periods of its swinging."""
CHANGE = 0.10
"""Most that this time changes along a run with the speed of the ship, in periods."""
SIGMAS, SIGMAS_DRIFT = 2.0, 4.0
"""Standard errors beyond which a difference, and a drift, is no chance."""
LEAST_SWING = 0.1
"""rad; heading that swings less tells nothing of clocks."""
STEPS = 4000
"""Most steps of a record that is compared."""


@dataclass(frozen=True)
class Late:
    """By how much one log is late against another: ``offset`` [s] at the begin of the run, ``drift`` [s per s] and its
    standard error, standard error of the mean offset [s], and the ``period`` [s] of the swinging."""

    offset: float
    middle_std: float
    drift: float
    drift_std: float
    period: float


def clock_problems(logs: Sequence[Log], chosen: ImportMap) -> list[str]:
    """A line for each pair of ``logs`` of a run whose clocks differ or drift, with what to add to the map ``chosen``.

    None for files of whose clock it says something.
    """
    found = []
    for gyro, other in itertools.permutations(logs, 2):
        names = gyro.table.path.name, other.table.path.name
        if any(chosen.clock_said(log.table.path) for log in (gyro, other)) or names[0] == names[1]:
            continue
        late = course_late(gyro, other)
        if late is not None:
            words = _problem(late, min(gyro.t[-1], other.t[-1]) - max(gyro.t[0], other.t[0]), *names)
            found += [words] if words else []
    return found


def course_late(gyro: Log, other: Log) -> Late | None:
    """By how much the course in the log ``other`` is late against the heading in the log ``gyro``.

    None where one of them lacks it, its unit is not known, or the ship swings too little.
    """
    if "psi" not in gyro.columns or "psi" in gyro.unitless or "psi" in other.columns:
        return None
    first, last = max(gyro.t[0], other.t[0]), min(gyro.t[-1], other.t[-1])
    h = max(gyro.dt, other.dt, (last - first) / STEPS)
    t = np.arange(first, last, h)
    good = np.isfinite(gyro.columns["psi"])
    if len(t) < 50 or good.sum() < 50:
        return None
    psi = np.interp(t, gyro.t[good], np.unwrap(gyro.columns["psi"][good]))
    rate = np.gradient(psi, h)
    swing = float(np.std(psi - np.polyval(np.polyfit(t - first, psi, 1), t - first)))
    bend = float(np.sqrt(np.mean(np.gradient(_smooth(rate, 5), h) ** 2)))
    if swing < LEAST_SWING or bend == 0.0:
        return None
    period = 2 * np.pi * float(np.std(rate)) / bend
    course = _course(other, t, max(2.0, period / h / 30))
    if course is None or period < 5 * h:
        return None
    return _fitted(t, psi, course, period)


def _fitted(t: np.ndarray, psi: np.ndarray, course: np.ndarray, period: float) -> Late | None:
    """Offset and drift by least squares of course(t) - psi(t - offset - drift (t - t_0)) - constant, from the best of
    a row of offsets. Errors are taken for independent every quarter of a period."""
    offset, duration = _lag(t, psi, course, 0.5 * period), float(t[-1] - t[0])
    if offset is None:
        return None
    drift, since, rate = 0.0, t - t[0], np.gradient(psi, t)
    for _ in range(8):
        late = offset + drift * since
        good = np.isfinite(course) & (t - late >= t[0]) & (t - late <= t[-1])
        slope = -np.interp(t - late, t, rate)
        A = np.column_stack([np.ones(len(t)), slope, slope * since])[good]
        error = (course - np.interp(t - late, t, psi))[good]
        step, *_ = np.linalg.lstsq(A, error, rcond=None)
        offset, drift = offset + float(step[1]), drift + float(step[2])
        if good.sum() < 0.5 * len(t) or abs(offset) > period or abs(drift) > 0.5:
            return None
    left = error - A @ step
    independent = duration / (period / 4)
    scale = float(left @ left) / len(left) * len(left) / max(independent - 3, 1.0)
    covariance = scale * np.linalg.pinv(A.T @ A)
    mean = np.array([0.0, 1.0, 0.5 * duration])
    middle_std = float(np.sqrt(max(mean @ covariance @ mean, 0.0)))
    return Late(offset, max(middle_std, 0.005 * period), drift, float(np.sqrt(max(covariance[2, 2], 0.0))), period)


def _lag(t: np.ndarray, psi: np.ndarray, course: np.ndarray, most: float) -> float | None:
    """The best of a row of times [s], up to ``most``, by which the course is late; None where it lies at an end."""
    lags = np.linspace(-most, most, 81)
    cost = np.full(len(lags), np.nan)
    for k, lag in enumerate(lags):
        inside = (t - lag >= t[0]) & (t - lag <= t[-1]) & np.isfinite(course)
        if inside.sum() > 0.5 * len(t):
            cost[k] = np.var(course[inside] - np.interp(t[inside] - lag, t, psi))
    if not np.isfinite(cost).any():
        return None
    k = int(np.nanargmin(cost))
    return None if k in (0, len(lags) - 1) else float(lags[k])


def _course(log: Log, t: np.ndarray, width: float) -> np.ndarray | None:
    """The course over ground in ``log`` at the times ``t`` (N,), unwrapped; None where there is none.

    width: of the smoothing of positions, in steps.
    """
    known = {name: values for name, values in log.columns.items() if name not in log.unitless}
    if "cog" in known:
        good = np.isfinite(known["cog"])
        return np.interp(t, log.t[good], np.unwrap(known["cog"][good])) if good.sum() > 20 else None
    for x, y in (("latitude", "longitude"), ("x", "y")):
        if {x, y} <= set(known):
            good = np.isfinite(known[x]) & np.isfinite(known[y])
            if good.sum() < 20:
                return None
            east = np.cos(np.radians(np.median(known[x][good]))) if x == "latitude" else 1.0
            north, east = (
                np.interp(t, log.t[good], known[name][good] * scale) for name, scale in ((x, 1.0), (y, east))
            )
            velocity = (np.gradient(_smooth(part, width)) for part in (north, east))
            return np.unwrap(np.arctan2(*reversed(tuple(velocity))))
    return None


def _smooth(values: np.ndarray, width: float) -> np.ndarray:
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(values, width, mode="nearest"))


def _problem(late: Late, duration: float, gyro: str, other: str) -> str:
    """The line on clocks that differ or drift, "" where they do not."""
    grown = late.drift * duration
    over = abs(grown) > max(CHANGE * late.period, SIGMAS_DRIFT * late.drift_std * duration)
    middle = late.offset + 0.5 * grown
    early = EARLIEST * late.period - SIGMAS * late.middle_std
    shift = 0.0
    begin = late.offset if over else middle
    if begin < early or begin > LATEST * late.period + SIGMAS * late.middle_std:
        shift = begin - USUAL * late.period
    if over:
        way = "slow" if grown > 0 else "fast"
        more = f", clock_offset = {shift:.2g}" if shift else ""
        return (
            f"{gyro} and {other}: their clocks drift apart by {abs(grown):.2g} s in {duration:.0f} s, as heading and "
            f'course show: that of {gyro} is {way}; add to the map: [files."{gyro}"] clock_drift = {late.drift:.2g}'
            f"{more} (or clock_offset = 0.0 to keep them)"
        )
    if shift:
        how = f"{-middle:.2g} s before" if middle < 0 else f"{middle:.2g} s after"
        return (
            f"{gyro} and {other}: their clocks differ: the course changes {how} the heading, which no ship does; "
            f'add to the map: [files."{gyro}"] clock_offset = {shift:.2g} (or 0.0 to keep them)'
        )
    return ""

"""The rudder of a run as steps: where it is held, when it began to move there, and what was ordered.

Nothing is assumed of the angles: noise, a rudder that is slow to move and one that is logged with an offset are steps
all the same. The rudder begins to move when the heading has passed the one that was ordered, by what passes in a sample
and in the reaction of helmsman and steering gear. Orders are usual angles; another one is believed where the record
shows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

TOLERANCE = math.radians(1.0)
"""An angle is held while the rudder stays within 1 deg, 4 % of it or 3.5 times its noise, what is more [rad]."""

MEMORY = 0.25
"""Ship times L/U over which the angle that is held may creep: a rudder that moves on faster is not held."""

SHORTEST_HOLD = 0.1
"""Share of the longest hold of a manoeuvre below which a gap between two holds at one angle is a spike."""

CORRECTION, CORRECTED, LEAST_CORRECTED = 0.2, (0.67, 2.0), math.radians(3.5)
"""A hold beside a longer one of this angle [rad] at least is a helm that corrects where it lasts at most this share of
it, and its angle lies between these shares of the other one's."""

SLOWEST = 0.3
"""Share of its largest rate below which the rudder's movement to an angle has not begun: a helm that wanders before is
slower than the order's movement."""

FIRST, LATER = 0.1, 0.5
"""Shares of the way between two holds through which the line goes that tells when the rudder began to move."""


@dataclass(frozen=True)
class RudderStep:
    """A stretch in which the rudder is held. begin: when it began to move there; reached, end: of the stretch, all in
    s after the first sample; angle [rad]; began: False where the record begins with it."""

    begin: float
    reached: float
    end: float
    angle: float
    began: bool = True

    @property
    def seconds(self) -> float:
        """How long the rudder is held [s]."""
        return self.end - self.reached


def without_spikes(delta: np.ndarray, dt: float, ship_time: float) -> np.ndarray:
    """``delta`` (N,) without single samples that are off: a running median over a fortieth of the ship_time L/U [s], of
    three samples at least and nine at most; dt: sampling interval [s]."""
    size = 2 * min(max(round(0.0125 * ship_time / dt), 1), 4) + 1
    return np.median(sliding_window_view(np.pad(delta, size // 2, mode="edge"), size), axis=1)


def held_stretches(
    t: np.ndarray, delta: np.ndarray, ship_time: float = 0.0, tolerance: float = TOLERANCE
) -> list[RudderStep]:
    """Stretches of the times ``t`` (N,) [s] in which the rudder ``delta`` (N,) [rad] is held, at any angle.

    ship_time: L/U [s], the scale of what is short; tolerance: least one of an angle that is held [rad]. Rows without a
    value are left out.
    """
    good = np.isfinite(delta)
    t, delta = t[good], delta[good]
    if len(t) < 4:
        return []
    dt = float(np.median(np.diff(t)))
    delta = without_spikes(delta, dt, ship_time)
    steps = np.diff(delta)
    noise = 1.4826 * float(np.median(np.abs(steps - np.median(steps))))
    keep = math.exp(-dt / max(MEMORY * ship_time, 2 * dt))
    runs, first, level, count = [], 0, float(delta[0]), 1
    for k in range(1, len(t) + 1):
        width = max(tolerance, 0.04 * abs(level), 3.5 * noise)
        if k == len(t) or abs(delta[k] - level) > width:
            runs.append((first, k))
            if k == len(t):
                break
            first, level, count = k, float(delta[k]), 1
            continue
        count += 1
        level += max(1.0 / count, 1 - keep) * (float(delta[k]) - level)
    shortest = max(2.5 * dt, 0.15 * ship_time)
    found = [(a, b, float(np.median(delta[a + (b - a) // 4 : b]))) for a, b in runs if t[b - 1] - t[a] + dt >= shortest]
    begins = {
        a: _movement(t, delta, found[k - 1][1] - 1 if k else 0, a, angle) for k, (a, _, angle) in enumerate(found)
    }
    return [
        RudderStep(begins[a], float(t[a]), float(t[b - 1]), angle, k > 0 or abs(delta[0] - angle) > 2 * tolerance)
        for k, (a, b, angle) in enumerate(_joined(found, t, tolerance, ship_time))
    ]


def _joined(
    runs: list[tuple[int, int, float]], t: np.ndarray, tolerance: float, ship_time: float
) -> list[tuple[int, int, float]]:
    """The ``runs`` (first row, row after the last, angle) in which neighbours are one, with the angle of the longer: at
    one angle with a spike between them, or to one side where the helm corrects its angle."""
    joined: list[tuple[int, int, float]] = []
    for run in runs:
        joined.append(run)
        while len(joined) > 1:
            (a, b, before), (c, d, after) = joined[-2:]
            gap, (first, second) = t[c] - t[b - 1], (t[b - 1] - t[a], t[d - 1] - t[c])
            short, long = (before, after) if first < second else (after, before)
            spike = abs(after - before) <= max(1.5 * tolerance, 0.1 * abs(before))
            spike &= bool(gap <= max(SHORTEST_HOLD * max(first, second), 3 * (t[1] - t[0])))
            brief = min(first, second) <= CORRECTION * max(first, second) and gap <= MEMORY * ship_time
            share = short / long if abs(long) >= LEAST_CORRECTED else 0.0
            if not spike and not (brief and CORRECTED[0] <= share <= CORRECTED[1]):
                break
            joined[-2:] = [(a, d, long)]
    return joined


def _movement(t: np.ndarray, delta: np.ndarray, floor: int, held: int, angle: float) -> float:
    """When the rudder began to move to the ``angle`` that it has from row ``held`` on [s], not before row ``floor``.

    The line through a tenth and a half of the order's movement meets the angle it came from at that time.
    """
    side = math.copysign(1.0, angle - delta[max(floor, held - 1)])
    t, path = t[floor : held + 1], side * delta[floor : held + 1]
    if held == 0 or len(path) < 2:
        return float(t[0])
    start, largest = len(path) - 1, 0.0
    span = max(0.5, 3 * float(np.median(np.diff(t))))
    while start > 0:
        rate = float(path[start] - np.interp(t[start] - span, t, path)) / span
        largest = max(largest, rate)
        if rate < SLOWEST * largest or rate <= 0:
            break
        start -= 1
    while start > 0 and path[start] - path[start - 1] >= SLOWEST * largest * (t[start] - t[start - 1]) > 0:
        start -= 1
    low, way = float(path[start]), side * angle - float(path[start])
    if way <= 0:
        return float(t[-1])
    first, later = (_crossing(t[start:], path[start:], low + share * way) for share in (FIRST, LATER))
    if later <= first:
        return first
    return max(float(t[0]), first - (later - first) * FIRST / (LATER - FIRST))


def _crossing(t: np.ndarray, values: np.ndarray, level: float) -> float:
    """When ``values`` first reach ``level``, by linear interpolation [s]."""
    k = int(np.argmax(values >= level))
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (t[k] - t[k - 1]))


STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
"""Angles that are ordered as a rule [deg] (ITTC 7.5-02-06-01, IMO MSC.137(76))."""

NAMED, SHARE = 0.6, 0.07
"""A measured rudder is called one of STEPS within this [deg], or this share of it."""

RESOLUTION, HELM = math.radians(0.05), math.radians(0.25)
"""Least standard error of a heading, gyros are read to 0.1 deg, and by which a helm orders too early or late [rad]."""

LIKELY = 2.5
"""Standard errors by which what the reversals show may be off a usual heading."""


def nominal(angle: float) -> float:
    """The usual angle [deg] that an ``angle`` >= 0 [rad] stands for, or its whole degrees where it is none."""
    degrees = math.degrees(angle)
    near = min(STEPS, key=lambda step: abs(step - degrees))
    return near if abs(near - degrees) <= max(NAMED, SHARE * degrees) else float(round(degrees))


def ordered_heading(
    headings: np.ndarray, delays: np.ndarray, signs: np.ndarray, errors: np.ndarray, rudder: float
) -> float:
    """The change of heading [deg] at which the rudder of a zigzag was ordered over, to either side of one base course.

    headings: (D, K) at the time of each of K reversals of the rudder less each of D ``delays`` (D,) [s], those that are
    negative too early by the sampling [rad]; signs: signs of the turn (K,); errors: standard errors of the headings
    (K,) [rad]; rudder: as named [deg]. At one delay, whichever it is, the headings were as ordered, to within their own
    scatter. A usual heading is believed where it fits as well as any: first that of the rudder, as in the zigzags of
    the standard, then one of 5 deg and more, then that of the least squares, the delay among them (half of the largest
    is its standard error).
    """
    weights = 1 / errors**2

    def fit(degrees: float) -> tuple[float, float]:
        """Sum of squares in standard errors with the best delay, and that delay as a share of the largest."""
        base = headings - signs * math.radians(degrees)
        off = base - (base @ weights / weights.sum())[:, None] if len(signs) > 1 else base
        squares = off**2 @ weights
        best = int(np.argmin(squares))
        return float(squares[best]), float(max(delays[best] / delays.max(), delays[best] / delays.min()))

    fits = {float(degrees): fit(degrees) for degrees in range(1, 90)}
    least = min(squares for squares, _ in fits.values())
    scatter = max(1.0, least / max(len(signs) - 2, 1))
    usual = [step for step in STEPS if fits[step][0] <= least + LIKELY**2 * scatter]
    if usual:
        return min(
            usual, key=lambda step: (step != rudder, step < 5, fits[step][0] / scatter + (2 * fits[step][1]) ** 2)
        )
    return min(fits, key=lambda degrees: (fits[degrees][0] > least + scatter, fits[degrees][1]))

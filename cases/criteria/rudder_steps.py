"""The rudder of a measured run as steps: where it is held, when it began to move there, and what was ordered.

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

SLOWEST, FASTER = 0.3, 3.0
"""Share of its largest rate below which the rudder's movement to an angle has not begun; by how much it is faster than
a helm that wanders before."""

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


def held_stretches(t: np.ndarray, delta: np.ndarray, ship_time: float) -> list[RudderStep]:
    """Stretches of the times ``t`` (N,) [s] in which the rudder ``delta`` (N,) [rad] is held, at any angle.

    ship_time: L/U [s], the scale of what is short. Rows without a value are left out.
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
        width = max(TOLERANCE, 0.04 * abs(level), 3.5 * noise)
        if k == len(t) or abs(delta[k] - level) > width:
            runs.append((first, k))
            if k == len(t):
                break
            first, level, count = k, float(delta[k]), 1
            continue
        count += 1
        share = max(1.0 / count, 1 - keep)
        level += share * (float(delta[k]) - level)
    shortest = max(2.5 * dt, 0.15 * ship_time)
    found = [(a, b, float(np.median(delta[a + (b - a) // 4 : b]))) for a, b in runs if t[b - 1] - t[a] + dt >= shortest]
    return _with_begin(t, delta, _joined(found, t, delta))


def _joined(runs: list[tuple[int, int, float]], t: np.ndarray, delta: np.ndarray) -> list[tuple[int, int, float]]:
    """Neighbouring stretches at one angle with a short gap between them are one: a spike or a rudder that creeps."""
    joined: list[tuple[int, int, float]] = []
    for a, b, angle in runs:
        if joined:
            c, d, before = joined[-1]
            longer = max(t[b - 1] - t[a], t[d - 1] - t[c])
            close = abs(angle - before) <= max(1.5 * TOLERANCE, 0.1 * abs(before))
            if close and t[a] - t[d - 1] <= max(SHORTEST_HOLD * longer, 3 * (t[1] - t[0])):
                joined[-1] = (c, b, float(np.median(delta[c + (b - c) // 4 : b])))
                continue
        joined.append((a, b, angle))
    return joined


def _with_begin(t: np.ndarray, delta: np.ndarray, runs: list[tuple[int, int, float]]) -> list[RudderStep]:
    holds: list[RudderStep] = []
    for k, (a, b, angle) in enumerate(runs):
        floor = runs[k - 1][1] - 1 if k else 0
        begin = _movement(t, delta, floor, a, angle)
        began = k > 0 or abs(delta[0] - angle) > 2 * TOLERANCE
        holds.append(RudderStep(begin, float(t[a]), float(t[b - 1]), angle, began))
    return holds


def _movement(t: np.ndarray, delta: np.ndarray, floor: int, held: int, angle: float) -> float:
    """When the rudder began to move to the ``angle`` that it has from row ``held`` on [s], not before row ``floor``.

    It came the whole way from where the movement turned towards that angle; the line through a tenth and a half of
    the way meets the angle it came from at that time.
    """
    if held == 0:
        return float(t[0])
    side = math.copysign(1.0, angle - delta[max(floor, held - 1)])
    path = side * delta[floor : held + 1]
    top = side * angle
    if len(path) < 2:
        return float(t[max(held - 1, 0)])
    start = _start_of_way(path, top)
    low = float(np.median(path[max(start - 4, 0) : start + 1]))
    order = _first_fast(t[floor : held + 1], path, start)
    if _is_wander(t[floor : held + 1], path, start, order):
        start, low = order, float(path[order])
    way = top - low
    if way <= 0:
        return float(t[held])
    times, values = t[floor + start : held + 1], path[start:]
    first, later = (_crossing(times, values, low + share * way) for share in (FIRST, LATER))
    if later <= first:
        return first
    return max(float(t[floor]), first - (later - first) * FIRST / (LATER - FIRST))


def _is_wander(t: np.ndarray, path: np.ndarray, start: int, order: int) -> bool:
    """Whether the movement of ``path`` (M,) at ``t`` (M,) from row ``start`` to row ``order`` is not yet the order's: a
    tenth of the way and more, and FASTER times slower than the rest."""
    before, after = float(path[order] - path[start]), float(path[-1] - path[order])
    if start >= order or order >= len(path) - 1 or before <= FIRST * (before + after):
        return False
    return after / (t[-1] - t[order]) > FASTER * before / (t[order] - t[start])


def _first_fast(t: np.ndarray, path: np.ndarray, start: int) -> int:
    """Row of ``path`` (M,) at ``t`` (M,), not before ``start``, from which it moves on without falling below SLOWEST of
    its largest rate: a helm that wanders before the order is slower than the order's movement."""
    span = max(0.5, 3 * float(np.median(np.diff(t)))) if len(t) > 1 else 0.5
    k, largest = len(path) - 1, 0.0
    while k > start:
        rate = float(path[k] - np.interp(t[k] - span, t, path)) / span
        largest = max(largest, rate)
        if rate < SLOWEST * largest or rate <= 0:
            break
        k -= 1
    while k > start and path[k] - path[k - 1] >= SLOWEST * largest * (t[k] - t[k - 1]) > 0:
        k -= 1
    return k


def _start_of_way(path: np.ndarray, top: float) -> int:
    """Row from which ``path`` (M,) rises to ``top`` at its end: the last that lies within a tenth of the way of its
    least value since."""
    row, low = len(path) - 1, float(path[-1])
    for k in range(len(path) - 1, -1, -1):
        if path[k] <= low:
            low, row = float(path[k]), k
        elif path[k] > low + max(0.04 * (top - low), 1.5 * TOLERANCE):
            break
    near = np.flatnonzero(path[row:] <= low + max(0.02 * (top - low), 0.25 * TOLERANCE))
    return row + (int(near[-1]) if len(near) else 0)


def _crossing(t: np.ndarray, values: np.ndarray, level: float) -> float:
    """When ``values`` first reach ``level``, by linear interpolation [s]."""
    k = int(np.argmax(values >= level))
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (t[k] - t[k - 1]))


STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
"""Angles that are ordered as a rule [deg]."""

NAMED, SHARE = 0.6, 0.07
"""A measured angle is called one of STEPS within this [deg], or this share of it."""

SMALL, NAMED_SMALL = 5.0, 0.4
"""Below this [deg] the usual steps are close together, and a measured angle must be within the second."""

RESOLUTION = math.radians(0.1)
"""To which a heading is read [rad]."""

FARTHER = 3.0
"""Headings at reversals that are so many times nearer to one heading than to a reaction after a usual one were ordered
there."""


def nominal(angle: float, late: float = 0.0, early: float = 0.0, rudder: float = 0.0) -> float:
    """The usual angle [deg] that an ``angle`` >= 0 [rad] stands for, or its whole degrees where it is none.

    late, early: what the order may have come too late or too early [rad]; a small step stands back behind one of 5 deg
    and more, and each behind that of the ``rudder`` [deg], as in the zigzags of the standard.
    """
    degrees, more, less = (math.degrees(x) for x in (angle, late, early))
    large = max(NAMED, SHARE * degrees)

    def off(step: float) -> float:
        """How far the angle is from ``step``, by how far it may be."""
        near, beyond = min(large, NAMED_SMALL) if step < SMALL else large, degrees - step
        return beyond / (near + more) if beyond > 0 else -beyond / (near + less)

    fits = [step for step in STEPS if off(step) <= 1]
    return min(fits, key=lambda step: (step != rudder, step < SMALL, off(step))) if fits else float(round(degrees))


def ordered_at_once(psi: np.ndarray, signs: np.ndarray, rates: np.ndarray, named: float, near: float) -> bool:
    """Whether the rudder was reversed at one heading, and not a time after the heading ``named`` [deg].

    psi, signs, rates: headings [rad] at the reversals, signs of the turn, yaw rates [rad/s] (N,). After a
    reaction she has turned farther where she turns faster; near: to which either explains the headings, beside their
    RESOLUTION [rad].
    """
    if len(psi) < 3:
        return False

    def off(shape: np.ndarray, given: np.ndarray) -> float:
        """What is left of ``given`` by a base course and a multiple of ``shape``."""
        columns = np.column_stack([np.ones(len(psi)), shape])
        return float(np.abs(given - columns @ np.linalg.lstsq(columns, given, rcond=None)[0]).max())

    near += RESOLUTION
    at_one, after = off(signs, psi), off(signs * rates, psi - signs * math.radians(named))
    return at_one <= near < after and FARTHER * at_one < after

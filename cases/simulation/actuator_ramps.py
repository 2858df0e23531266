"""Actuator positions of manoeuvres whose orders do not depend on the motion: ramps between orders, known in advance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cases.maneuvers.definitions import Maneuver
from cases.maneuvers.orders import FromLead, Orders

TINY = 1e-9
"""Slack in comparisons of times [s]."""


@dataclass(frozen=True)
class Ramps:
    """Revolutions and rudder angle, straight between kinks.

    times: (K,) [s], first and last that of the manoeuvre; positions: (K, 2): n [1/s], delta [rad].
    """

    times: np.ndarray
    positions: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """Positions (N, 2) at times (N,)."""
        return np.column_stack([np.interp(t, self.times, column) for column in self.positions.T])

    def means(self, t: np.ndarray) -> np.ndarray:
        """Means (N, 2) of the positions over the steps between t (N + 1,)."""
        fine = np.union1d(self.times, t)
        values, first = self.at(fine), np.searchsorted(fine, t)
        base = np.repeat(values[first[:-1]], np.diff(first), axis=0)
        share = np.diff(fine) / np.repeat(np.diff(t), np.diff(first))
        away = (0.5 * (values[1:] + values[:-1]) - base) * share[:, None]
        return values[first[:-1]] + np.add.reduceat(away, first[:-1], axis=0)

    def grid(self, t: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
        """Times of integration (K + 1,): t, the kinks, and so many between that no step is longer than ``longest`` [s].

        Returns them with (K,) bool, which steps end at one of t.
        """
        nearest = t[np.clip(np.searchsorted(t, self.times - TINY), 0, len(t) - 1)]
        knots = np.union1d(t, self.times[np.abs(self.times - nearest) > TINY])
        gaps = np.diff(knots)
        parts = np.maximum(np.ceil(gaps / longest - TINY), 1).astype(int)
        number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        fine = np.append(np.repeat(knots[:-1], parts) + number * np.repeat(gaps / parts, parts), knots[-1])
        keep = np.zeros(len(fine), dtype=bool)
        keep[np.searchsorted(fine, t)] = True
        return fine, keep[1:]


def ramps(maneuver: Maneuver, orders: Orders, t: np.ndarray) -> Ramps:
    """What a manoeuvre's controller makes of orders that depend on the time alone, sampled at t (N + 1,). maneuver:
    gives the limits."""
    if isinstance(orders, FromLead):
        changes = [(orders.lead, orders(orders.lead, maneuver.start))]
    else:
        asked = [orders(float(when), maneuver.start) for when in t[:-1]]
        changes = [(float(t[k]), asked[k]) for k in range(len(asked)) if k == 0 or asked[k] != asked[k - 1]]
    actuators = ((maneuver.n, maneuver.limits.propeller_rate), (0.0, maneuver.limits.rudder_rate))
    end = float(t[-1])
    moves = [
        _ramp([(when, order[i]) for when, order in changes if order and when < end], position, rate, end)
        for i, (position, rate) in enumerate(actuators)
    ]
    times = np.unique(np.concatenate([t[[0, -1]], *(kinks for kinks, _ in moves)]))
    return Ramps(times, np.column_stack([np.interp(times, kinks, values) for kinks, values in moves]))


def _ramp(
    changes: list[tuple[float, float]], position: float, rate: float, end: float
) -> tuple[np.ndarray, np.ndarray]:
    """Kinks and positions of one actuator that follows orders (time, value) at a limited rate until ``end``."""
    times, values = [0.0], [position]
    for (when, order), (until, _) in zip(changes, [*changes[1:], (end, 0.0)], strict=True):
        way, longest = order - position, rate * (until - when)
        if way == 0:
            continue
        if when > times[-1]:
            times.append(when)
            values.append(position)
        arrives = abs(way) <= longest
        position = order if arrives else position + math.copysign(longest, way)
        times.append(when + abs(way) / rate if arrives else until)
        values.append(position)
    return np.array(times), np.array(values)

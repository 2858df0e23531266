"""Actuators of many runs at once: ramps known in advance where orders do not depend on the motion, and the rudders of
a zigzag, each reversed at its own time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cases.maneuvers.definitions import TINY, FromLead, Maneuver, Orders, StopOrders, Zigzag


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
    """What the controller of a ``maneuver`` makes of orders that depend on the time alone, sampled at t (N + 1,)."""
    if isinstance(orders, FromLead):
        changes = [(orders.lead, orders(orders.lead, maneuver.start))]
    else:
        ordered = [orders(float(when), maneuver.start) for when in t[:-1]]
        changes = [(float(t[k]), ordered[k]) for k in range(len(ordered)) if k == 0 or ordered[k] != ordered[k - 1]]
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


class EngineRevolutions:
    """Revolutions of M ships whose engines are stopped or reversed (``Engine``), as ``Controller`` of cases.maneuvers
    makes them for one. n: revolutions reached (M,) [1/s]."""

    def __init__(self, maneuver: Maneuver, orders: StopOrders, ships: int) -> None:
        assert maneuver.engine is not None
        self.orders, self.shaft = orders, maneuver.engine.shaft(ships)

    @property
    def n(self) -> np.ndarray:
        return self.shaft.n

    def means(self, t: float, dt: float, state: np.ndarray) -> np.ndarray:
        """Mean revolutions (M,) over the step from t to t + dt at states (S, M); the order acts from its own moment."""
        before = min(max(self.orders.lead - t, 0.0), dt)
        if before <= TINY:
            self.shaft, mean = self.shaft.moved(self.orders.after, state[3], dt)
            return mean
        self.shaft, first = self.shaft.moved(self.orders.n, state[3], before)
        if dt - before <= TINY:
            return first
        self.shaft, second = self.shaft.moved(self.orders.after, state[3], dt - before)
        return (before * first + (dt - before) * second) / dt


class ZigzagRudders:
    """Rudders of M ships that do what ``Zigzag`` and ``Controller`` of cases.maneuvers do for one.

    delta: angles reached [rad]; side: to which they are ordered; count: rudder executes so far; origin: headings at the
    first one [rad], None before; over: whose last execute has come; their orders stand from then on.
    """

    def __init__(self, orders: Zigzag, rate: float, ships: int) -> None:
        self.orders, self.rate = orders, rate
        self.delta, self.side = np.zeros(ships), np.full(ships, orders.side)
        self.count, self.over = np.ones(ships, dtype=int), np.zeros(ships, dtype=bool)
        self.origin: np.ndarray | None = None

    def observe(self, t: float, state: np.ndarray) -> None:
        """Orders at a sample with states (S, M): who is beyond the switch heading reverses."""
        if t >= self.orders.lead - TINY:
            if self.origin is None:
                self.origin = state[2].copy()
            self._reverse(self._beyond(state) >= -TINY)

    def means(
        self, t: float, dt: float, state: np.ndarray, advance: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean angles (M,) over the step from t to t + dt, and the states (S, M) that follow.

        advance: states (S, K) at the end of the step of the K ships that a mask (M,) names, from angles (M,). The first
        execute and reversals within the step act from their own moment, located by interpolation.
        """
        lead, before = self.orders.lead, self.delta
        waiting = t < lead - TINY
        order = np.zeros_like(before) if waiting else self.side * self.orders.rudder
        mean = self._travel(order, dt)
        everyone = np.ones(len(mean), dtype=bool)
        after = advance(mean, everyone)
        if waiting and lead >= t + dt - TINY:
            return mean, after
        if waiting:
            crosses, fraction = everyone, np.full_like(mean, (lead - t) / dt)
            self.origin = state[2] + fraction * (after[2] - state[2])
        else:
            a, b = self._beyond(state), self._beyond(after)
            crosses = (a < 0) & (b >= 0) & ~self.over
            if not crosses.any():
                return mean, after
            fraction = np.where(crosses, -a / np.where(crosses, b - a, 1.0), 1.0)
            self._reverse(crosses)
        self.delta = before
        first = self._travel(order, fraction * dt)
        second = self._travel(self.side * self.orders.rudder, (1 - fraction) * dt)
        mean, after = fraction * first + (1 - fraction) * second, after.copy()
        after[:, crosses] = advance(mean, crosses)
        return mean, after

    def _beyond(self, state: np.ndarray) -> np.ndarray:
        """Heading past the switch heading, to the side of the rudder [rad]."""
        assert self.origin is not None
        return self.side * (state[2] - self.origin) - self.orders.heading

    def _reverse(self, which: np.ndarray) -> None:
        """Counts an execute of some ships (M,) and reverses their rudders, unless it was the last."""
        which = which & ~self.over
        self.count = self.count + which
        if self.orders.last_execute is not None:
            self.over = self.over | (self.count >= self.orders.last_execute)
        self.side = np.where(which & ~self.over, -self.side, self.side)

    def _travel(self, order: np.ndarray, dt: np.ndarray | float) -> np.ndarray:
        """Moves towards the orders (M,) for dt [s], one or (M,); the mean angles on the way."""
        way, longest = order - self.delta, self.rate * (dt + np.zeros_like(self.delta))
        arrives = np.abs(way) <= longest
        share = np.divide(np.abs(way), longest, out=np.zeros_like(way), where=longest > 0)
        end = np.where(arrives, order, self.delta + np.copysign(longest, way))
        mean = np.where(arrives, order - 0.5 * way * share, 0.5 * (self.delta + end))
        self.delta = end
        return mean

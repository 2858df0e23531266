"""Rudders of many ships in zigzag, each reversed at its own time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cases.maneuvers.orders import Zigzag
from cases.simulation.actuator_ramps import TINY


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
        self, t: float, dt: float, state: np.ndarray, advance: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean angles (M,) over the step from t to t + dt, and the states that ``advance`` gives under them.

        The first execute and reversals within the step act from their own moment, located by interpolation.
        """
        lead, before = self.orders.lead, self.delta
        waiting = t < lead - TINY
        order = np.zeros_like(before) if waiting else self.side * self.orders.rudder
        mean = self._travel(order, dt)
        after = advance(mean)
        if waiting and lead >= t + dt - TINY:
            return mean, after
        if waiting:
            fraction = np.full_like(mean, (lead - t) / dt)
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
        mean = fraction * first + (1 - fraction) * second
        return mean, advance(mean)

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

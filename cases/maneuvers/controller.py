"""The actuators that follow the orders of a manoeuvre, at limited rates, and the moment at which orders change."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cases.maneuvers.engine import Shaft
from cases.maneuvers.orders import FromLead, Orders
from mmg.motion.froude import length_scale, time_scale
from mmg.ship import Ship


@dataclass(frozen=True)
class Limits:
    """Rates of the actuators: rudder [rad/s], propeller [1/s^2].

    20 deg/s and 20 rps/s for a 3 m model (public simulator of Osaka University), Froude scaled:
    1.9 deg/s for a ship of 320 m.
    """

    rudder_rate: float
    propeller_rate: float

    @classmethod
    def for_length(cls, length: float) -> Limits:
        """Limits for a ship of this length [m]."""
        return cls(math.radians(20.0) / time_scale(length), 20.0 / length_scale(length))

    @classmethod
    def for_ship(cls, ship: Ship) -> Limits:
        """Limits for a ship: its own rudder_rate if the file gives one; none where its model has actuators."""
        if "actuators" in ship.components:
            return cls(math.inf, math.inf)
        usual = cls.for_length(ship.particulars["L"])
        return cls(ship.particulars.get("rudder_rate", usual.rudder_rate), usual.propeller_rate)


@dataclass
class Controller:
    """Follows the orders of one run within the limits; ``over`` tells that the manoeuvre has ended.

    n [1/s] and delta [rad] are the positions reached. ``located``: orders change at the very moment of their event;
    otherwise at the next sample, as those of a digital autopilot. shaft: what turns the propeller, where the ship has
    an engine; else the revolutions follow their order at a limited rate.
    """

    orders: Orders
    limits: Limits
    n: float
    delta: float = 0.0
    over: bool = False
    located: bool = True
    shaft: Shaft | None = None

    def held(
        self, t: float, dt: float, state: np.ndarray, advance: Callable[[tuple[float, float]], np.ndarray]
    ) -> tuple[float, float]:
        """Mean revolutions [1/s] and rudder angle [rad] over the step from t to t + dt: what to hold and to record.

        state (S,) at t, the six of the motion first, psi continuous; ``advance`` gives the state at t + dt when these
        inputs are held. Where the orders change within the step (execute, rudder reversal), the moment is located by
        interpolation and the actuators move from then on, not from the next sample. Positions follow the orders within
        the limits, and the means are those of their ramps, so that held inputs give the right impulse. Orders that end
        within a step end with the next call (``over``), which returns the positions reached. One event per step.
        """
        order = self.orders(t, state)
        if order is None:
            self.over = True
            return self.n, self.delta
        if self.located and isinstance(self.orders, FromLead) and self.orders.watches(t, t + dt):
            before = self.n, self.delta, self.shaft
            after = advance(self._travel(order, dt, state))
            fraction = self.orders.event(t, state, t + dt, after)
            self.n, self.delta, self.shaft = before
            if fraction is not None:
                first = self._travel(order, fraction * dt, state)
                order = self.orders(t + fraction * dt, state + fraction * (after - state)) or order
                second = self._travel(order, (1 - fraction) * dt, state)
                n, delta = (fraction * a + (1 - fraction) * b for a, b in zip(first, second, strict=True))
                return n, delta
        return self._travel(order, dt, state)

    def _travel(self, order: tuple[float, float], dt: float, state: np.ndarray) -> tuple[float, float]:
        """Moves the actuators towards ``order`` for dt [s] at a ``state``; their mean positions on the way."""
        if self.shaft is not None:
            self.shaft, mean = self.shaft.moved(order[0], np.array([state[3]]), dt)
            self.n, n = float(self.shaft.n[0]), float(mean[0])
        else:
            self.n, n = _ramp(self.n, order[0], self.limits.propeller_rate, dt)
        self.delta, delta = _ramp(self.delta, order[1], self.limits.rudder_rate, dt)
        return n, delta


def _ramp(position: float, order: float, rate: float, dt: float) -> tuple[float, float]:
    """Position after dt [s] at a limited rate towards the order, and the mean position on the way."""
    way, longest = order - position, rate * dt
    if abs(way) > longest:
        end = position + math.copysign(longest, way)
        return end, 0.5 * (position + end)
    share = abs(way) / longest if longest > 0 else 0.0
    return order, order - 0.5 * way * share

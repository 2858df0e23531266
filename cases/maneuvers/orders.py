"""The orders of each manoeuvre, what is asked of propeller and rudder, and the actuators that follow them.

Orders are called with (t [s], state (6,)) and give (n [1/s], delta [rad]), or None once the manoeuvre is over. The
state is (x, y, psi continuous, u, v, r). Orders are steps; the rate limits are those of the controller."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cases.maneuvers.self_propulsion import Shaft
from mmg.motion.froude import length_scale, time_scale
from mmg.ship import Ship

Orders = Callable[[float, np.ndarray], "tuple[float, float] | None"]
FULL_TURN = 3 * math.pi
"""Change of heading after which a turning test ends [rad]: 540 degrees (IMO MSC/Circ.1053)."""
_TINY = 1e-9
"""Slack in comparisons of times [s] and angles [rad], so that 0.1 + 0.2 is not later than 0.3."""


def constant(n: float) -> Orders:
    """Orders that stay: revolutions n [1/s], rudder midships."""
    return lambda t, state: (n, 0.0)


@dataclass
class FromLead(ABC):
    """Straight running at n [1/s] for ``lead`` seconds, then ``ordered``; ``origin``: heading at that moment [rad]."""

    n: float
    lead: float
    origin: float | None = field(default=None, init=False)

    def __call__(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        if t < self.lead - _TINY:
            return self.n, 0.0
        if self.origin is None:
            self.origin = float(state[2])
        return self.ordered(t, state)

    @abstractmethod
    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        """Orders from the execute on."""

    def watches(self, t0: float, t1: float) -> bool:
        """Whether an event may fall into the step from t0 to t1 [s]."""
        return t0 < self.lead < t1

    def event(self, t0: float, before: np.ndarray, t1: float, after: np.ndarray) -> float | None:
        """Fraction of the step from t0 to t1 [s], states ``before`` and ``after``, at which the execute or a switch
        falls, so that the orders must be asked again; None if they stand until t1.
        """
        if t0 < self.lead - _TINY:
            return (self.lead - t0) / (t1 - t0) if self.lead < t1 - _TINY else None
        return self.switch(before, after)

    def switch(self, before: np.ndarray, after: np.ndarray) -> float | None:
        """Fraction of the step at which orders change because of the motion; here never."""
        return None


@dataclass
class Turning(FromLead):
    """The ``rudder`` [rad] over until the heading has changed by 540 degrees."""

    rudder: float

    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        assert self.origin is not None
        return None if abs(state[2] - self.origin) >= FULL_TURN else (self.n, self.rudder)


@dataclass
class Zigzag(FromLead):
    """Rudder over; reversed each time the heading has changed by ``heading`` to the side of the rudder.

    The change counts from the heading at the first execute. ``last_execute``: number of the one that ends it.
    """

    rudder: float
    heading: float
    last_execute: int | None = None
    count: int = field(default=1, init=False)

    def __post_init__(self) -> None:
        self.rudder, self.side = abs(self.rudder), math.copysign(1.0, self.rudder)

    def _beyond(self, state: np.ndarray) -> float:
        """Heading past the switch heading, to the side of the rudder [rad]."""
        assert self.origin is not None
        return float(self.side * (state[2] - self.origin) - self.heading)

    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        if self._beyond(state) >= -_TINY:
            self.side, self.count = -self.side, self.count + 1
        over = self.last_execute is not None and self.count >= self.last_execute
        return None if over else (self.n, self.side * self.rudder)

    def watches(self, t0: float, t1: float) -> bool:
        return t1 > self.lead

    def switch(self, before: np.ndarray, after: np.ndarray) -> float | None:
        a, b = self._beyond(before), self._beyond(after)
        return -a / (b - a) if a < 0 <= b else None


@dataclass
class StopOrders(FromLead):
    """Other revolutions from the order on, ``after`` [1/s], rudder midships, until the speed ahead has fallen to
    ``least`` of that at the order."""

    after: float
    least: float = 0.0
    speed: float | None = field(default=None, init=False)

    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        if self.speed is None:
            self.speed = float(state[3])
        return None if state[3] <= self.least * self.speed else (self.after, 0.0)


@dataclass
class StepOrders(FromLead):
    """Rudder angles [rad] in turn, each held until the turn rate is steady; over when the last one is.

    Steady: all turn rates of the last ``window`` [s] lie within ``tolerance`` [rad/s] of each other.
    """

    angles: tuple[float, ...]
    window: float
    tolerance: float
    step: int = field(default=0, init=False)
    rates: deque[tuple[float, float]] = field(default_factory=deque, init=False)

    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        if self._steady(t, float(state[5])):
            self.step += 1
            self.rates.clear()
        return None if self.step >= len(self.angles) else (self.n, self.angles[self.step])

    def _steady(self, t: float, r: float) -> bool:
        self.rates.append((t, r))
        if t - self.rates[0][0] < self.window - _TINY:
            return False
        while len(self.rates) > 1 and self.rates[1][0] <= t - self.window + _TINY:
            self.rates.popleft()
        values = [rate for _, rate in self.rates]
        return max(values) - min(values) <= self.tolerance


def spiral_angles(largest: float, step: float) -> tuple[float, ...]:
    """Rudder angles of a direct spiral [rad]: from ``largest`` (signed) to the other side and back by ``step`` > 0."""
    side, count = math.copysign(1.0, largest), round(2 * abs(largest) / step)
    there = [side * (abs(largest) - k * step) for k in range(count + 1)]
    return tuple(round(angle, 12) + 0.0 for angle in there + there[-2::-1])


def schedule(n_times: np.ndarray, n: np.ndarray, delta_times: np.ndarray, delta: np.ndarray) -> Orders:
    """Orders held from n_times (A,), delta_times (B,) [s], the first 0, to the next: n (A,) [1/s], delta (B,) [rad]."""

    def orders(t: float, state: np.ndarray) -> tuple[float, float]:
        i = np.searchsorted(n_times, t + _TINY, side="right") - 1
        j = np.searchsorted(delta_times, t + _TINY, side="right") - 1
        return float(n[i]), float(delta[j])

    return orders


def random_telegraph(n: float, duration: float, scale: float, seed: int) -> Orders:
    """Random revolutions and rudder angles, each held for a random time; reproducible by ``seed``.

    Rudder: -35..35 deg, held 4..20 s. Revolutions: 0.3..1.2 n ahead, or 0.3..1 n astern (about every third
    order, and at least every fourth), held 10..30 s. ``scale`` stretches the times, which are those of a 3 m
    model. n [1/s]; duration [s].
    """
    rng = np.random.default_rng([3, seed])
    delta_times = _switches(rng, 4.0 * scale, 20.0 * scale, duration)
    n_times = _switches(rng, 10.0 * scale, 30.0 * scale, duration)
    delta = np.radians(rng.uniform(-35.0, 35.0, len(delta_times)))
    astern = rng.random(len(n_times)) < 0.35
    astern[0], astern[2::4] = False, True
    levels = np.where(astern, -rng.uniform(0.3, 1.0, len(n_times)), rng.uniform(0.3, 1.2, len(n_times)))
    return schedule(n_times, n * levels, delta_times, delta)


def _switches(rng: np.random.Generator, shortest: float, longest: float, duration: float) -> np.ndarray:
    """Times of orders, 0 first, until ``duration`` [s]."""
    gaps = rng.uniform(shortest, longest, math.ceil(duration / shortest) + 1)
    times = np.concatenate([[0.0], np.cumsum(gaps)])
    return times[times < max(duration, _TINY)]


BERTHING_SPEED = 0.6
"""Share of the approach speed and revolutions with which berthing begins."""
_BERTHING_PERIOD = 150.0
_BERTHING_N = ((0, BERTHING_SPEED), (30, 0.0), (36, -1.0), (88, 0.6), (105, -0.8), (130, 0.5))
_BERTHING_DELTA = ((0, 0), (8, 15), (20, -20), (34, 10), (50, -35), (70, 0), (88, 35), (97, -35), (112, 20), (130, -25))
"""(time [s of the 3 m model], share of n) and (time, rudder [deg]): slow ahead, reversals, kicks ahead."""


def berthing(n: float, scale: float) -> Orders:
    """Slow approach, stops, reversals, kicks ahead on large rudder; repeats after ``scale`` times 150 s. n [1/s]."""
    n_times, shares = np.array(_BERTHING_N, dtype=float).T
    delta_times, degrees = np.array(_BERTHING_DELTA, dtype=float).T
    orders = schedule(n_times, n * shares, delta_times, np.radians(degrees))
    return lambda t, state: orders(math.fmod(t / scale + _TINY, _BERTHING_PERIOD), state)


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

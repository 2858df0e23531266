"""Standard and identification manoeuvres, from text such as "zigzag:20/20", and the actuators that obey.

Angles are degrees in the text and radians inside. Times, rates and revolutions are those of a 3 m model,
taken to other lengths by Froude's law (time with sqrt(L / 3 m)). Turning, zigzag and crash stop are executed
as in IMO MSC.137(76), spiral and pull-out as in its explanatory notes (MSC/Circ.1053); the rudder moves at a
limited rate from the moment of the order.

Orders are called with (t [s], state (6,)) and give (n [1/s], delta [rad]), or None once the manoeuvre is over. The
state is (x, y, psi continuous, u, v, r). Orders are steps; the rate limits are those of the controller.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from cases.maneuvers.self_propulsion import (
    TEST_FROUDE,
    Engine,
    Shaft,
    approach,
    engine_of,
    engine_words,
    own_speed,
    stopping_factors,
)
from cases.quantities import as_number
from mmg.errors import BadValue, Missing, OutOfRange, UnknownName, UserError
from mmg.messages import Message
from mmg.motion.froude import length_scale, reference_speed, time_scale
from mmg.ship import Ship

Orders = Callable[[float, np.ndarray], "tuple[float, float] | None"]
FULL_TURN = 3 * math.pi  # Change of heading after which a turning test ends [rad]: 540 degrees (IMO MSC/Circ.1053)
# Slack in comparisons of times [s] and angles [rad], so that 0.1 + 0.2 is not later than 0.3.
TINY = 1e-9  # set by hand: above rounding, below any order
MOST_RUDDER = math.radians(35)  # That a heading controller orders [rad]: that of a turning test (IMO MSC.137(76))


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
        if t < self.lead - TINY:
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
        falls, so that the orders must be asked again; None if they stand until t1."""
        if t0 < self.lead - TINY:
            return (self.lead - t0) / (t1 - t0) if self.lead < t1 - TINY else None
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
    """Rudder over; reversed each time the heading has changed by ``heading`` to the side of the rudder. The change
    counts from the heading at the first execute. ``last_execute``: number of the one that ends it."""

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
        if self._beyond(state) >= -TINY:
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
    """Rudder angles [rad] in turn, each held until the turn rate is steady; over when the last one is. Steady: all turn
    rates of the last ``window`` [s] lie within ``tolerance`` [rad/s] of each other."""

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
        if t - self.rates[0][0] < self.window - TINY:
            return False
        while len(self.rates) > 1 and self.rates[1][0] <= t - self.window + TINY:  # one that lies a window back stays
            self.rates.popleft()
        values = [rate for _, rate in self.rates]
        return max(values) - min(values) <= self.tolerance


@dataclass
class HeadingControl(FromLead):
    """The heading held ``change`` [rad] to starboard of that at the order, by the rudder K_P (psi_d - psi) - K_D r
    within MOST_RUDDER (Wakita et al. 2025, Eq. 32). proportional: K_P; derivative: K_D [s]."""

    change: float
    proportional: float
    derivative: float

    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        assert self.origin is not None
        error = self.origin + self.change - float(state[2])
        rudder = self.proportional * error - self.derivative * float(state[5])
        return self.n, min(max(rudder, -MOST_RUDDER), MOST_RUDDER)


def spiral_angles(largest: float, step: float) -> tuple[float, ...]:
    """Rudder angles of a direct spiral [rad]: from ``largest`` (signed) to the other side and back by ``step`` > 0."""
    side, count = math.copysign(1.0, largest), round(2 * abs(largest) / step)
    there = [side * (abs(largest) - k * step) for k in range(count + 1)]
    return tuple(round(angle, 12) + 0.0 for angle in there + there[-2::-1])


def schedule(n_times: np.ndarray, n: np.ndarray, delta_times: np.ndarray, delta: np.ndarray) -> Orders:
    """Orders held from n_times (A,), delta_times (B,) [s], the first 0, to the next: n (A,) [1/s], delta (B,) [rad]."""

    def orders(t: float, state: np.ndarray) -> tuple[float, float]:
        i = np.searchsorted(n_times, t + TINY, side="right") - 1
        j = np.searchsorted(delta_times, t + TINY, side="right") - 1
        return float(n[i]), float(delta[j])

    return orders


def random_telegraph(n: float, duration: float, scale: float, seed: int) -> Orders:
    """Random revolutions and rudder angles, each held for a random time; reproducible by ``seed``.

    Rudder: -35..35 deg, held 4..20 s. Revolutions: 0.3..1.2 n ahead, or 0.3..1 n astern (about every third
    order, and at least every fourth), held 10..30 s. ``scale`` stretches the times, which are those of a 3 m
    model. n [1/s]; duration [s].
    """
    rng = np.random.default_rng([3, seed])  # 3: each use of a seed has draws of its own
    delta_times = _switches(rng, 4.0 * scale, 20.0 * scale, duration)
    n_times = _switches(rng, 10.0 * scale, 30.0 * scale, duration)
    delta = np.radians(rng.uniform(-35.0, 35.0, len(delta_times)))
    astern = rng.random(len(n_times)) < 0.35
    astern[0], astern[2::4] = False, True  # she gathers way first
    levels = np.where(astern, -rng.uniform(0.3, 1.0, len(n_times)), rng.uniform(0.3, 1.2, len(n_times)))
    return schedule(n_times, n * levels, delta_times, delta)


def _switches(rng: np.random.Generator, shortest: float, longest: float, duration: float) -> np.ndarray:
    """Times of orders, 0 first, until ``duration`` [s]."""
    gaps = rng.uniform(shortest, longest, math.ceil(duration / shortest) + 1)  # as many as the shortest would take
    times = np.concatenate([[0.0], np.cumsum(gaps)])
    return times[times < max(duration, TINY)]


BERTHING_SPEED = 0.6  # Share of the approach speed and revolutions with which berthing begins. Set by hand.
_BERTHING_PERIOD = 150.0  # After which the orders of berthing begin again [s of the 3 m model]. Set by hand.
_BERTHING_N = ((0, BERTHING_SPEED), (30, 0.0), (36, -1.0), (88, 0.6), (105, -0.8), (130, 0.5))
# (time [s of the 3 m model], share of n) and (time, rudder [deg]): slow ahead, reversals, kicks ahead. Set by hand.
_BERTHING_DELTA = ((0, 0), (8, 15), (20, -20), (34, 10), (50, -35), (70, 0), (88, 35), (97, -35), (112, 20), (130, -25))


def berthing(n: float, scale: float) -> Orders:
    """Slow approach, stops, reversals, kicks ahead on large rudder; repeats after ``scale`` times 150 s. n [1/s]."""
    n_times, shares = np.array(_BERTHING_N, dtype=float).T
    delta_times, degrees = np.array(_BERTHING_DELTA, dtype=float).T
    orders = schedule(n_times, n * shares, delta_times, np.radians(degrees))
    return lambda t, state: orders(math.fmod(t / scale + TINY, _BERTHING_PERIOD), state)


@dataclass(frozen=True)
class Limits:
    """Rates of the actuators: rudder [rad/s], propeller [1/s^2]; rudder_delay: from an order until it moves [s].

    20 deg/s and 20 rps/s for a 3 m model (public simulator of Osaka University), Froude scaled:
    1.9 deg/s for a ship of 320 m.
    """

    rudder_rate: float
    propeller_rate: float
    rudder_delay: float = 0.0

    @classmethod
    def for_length(cls, length: float) -> Limits:
        """Limits for a ship of this length [m]."""
        return cls(math.radians(20.0) / time_scale(length), 20.0 / length_scale(length))

    @classmethod
    def for_ship(cls, ship: Ship) -> Limits:
        """Limits for a ship: its own where the file gives them; none where its model has actuators."""
        if "actuators" in ship.components:
            return cls(math.inf, math.inf)
        usual = cls.for_length(ship.particulars["L"])
        p = ship.particulars
        rates = p.get("rudder_rate", usual.rudder_rate), p.get("propeller_rate", usual.propeller_rate)
        return cls(*rates, p.get("rudder_delay", 0.0))


@dataclass
class Controller:
    """Follows the orders of one run within the limits; ``over`` tells that the manoeuvre has ended.

    n [1/s] and delta [rad] are the positions reached. ``located``: orders change at the very moment of their event;
    otherwise at the next sample, as those of a digital autopilot. shaft: what turns the propeller, where the ship has
    an engine; else the revolutions follow their order at a limited rate. helm: orders of the rudder: when each begins
    to act [s], and the angle.
    """

    orders: Orders
    limits: Limits
    n: float
    delta: float = 0.0
    over: bool = False
    located: bool = True
    shaft: Shaft | None = None
    helm: list[tuple[float, float]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.helm = [(-math.inf, self.delta)]

    def held(
        self, t: float, dt: float, state: np.ndarray, advance: Callable[[tuple[float, float]], np.ndarray]
    ) -> tuple[float, float]:
        """Mean revolutions [1/s] and rudder angle [rad] over the step from t to t + dt: what to hold and to record.

        state (S,) at t, the six of the motion first, psi continuous; ``advance`` gives the state at t + dt when these
        inputs are held. Where the orders change within the step (execute, rudder reversal), the moment is located by
        interpolation and the actuators move from then on, not from the next sample. Positions follow the orders within
        the limits, the rudder after its delay, and the means are those of their ramps, so that held inputs give the
        right impulse. Orders that end within a step end with the next call (``over``), which returns the positions
        reached. One event per step.
        """
        order = self.orders(t, state)
        if order is None:
            self.over = True
            return self.n, self.delta
        if self.located and isinstance(self.orders, FromLead) and self.orders.watches(t, t + dt):
            # a step on trial, which is taken back: an event shows only in the state at its end
            before = self.n, self.delta, self.shaft, [*self.helm]
            after = advance(self._travel(order, t, dt, state))
            fraction = self.orders.event(t, state, t + dt, after)
            self.n, self.delta, self.shaft, self.helm = before
            if fraction is not None:
                first = self._travel(order, t, fraction * dt, state)
                order = self.orders(t + fraction * dt, state + fraction * (after - state)) or order
                second = self._travel(order, t + fraction * dt, (1 - fraction) * dt, state)
                n, delta = (fraction * a + (1 - fraction) * b for a, b in zip(first, second, strict=True))
                return n, delta
        return self._travel(order, t, dt, state)

    def _travel(self, order: tuple[float, float], t: float, dt: float, state: np.ndarray) -> tuple[float, float]:
        """Moves the actuators under an ``order`` from t [s] on for dt [s] at a ``state``; their mean positions on the
        way."""
        if self.shaft is not None:
            self.shaft, mean = self.shaft.moved(order[0], np.array([state[3]]), dt)
            self.n, n = float(self.shaft.n[0]), float(mean[0])
        else:
            self.n, n = _ramp(self.n, order[0], self.limits.propeller_rate, dt)
        if order[1] != self.helm[-1][1]:
            self.helm.append((t + self.limits.rudder_delay, order[1]))
        while len(self.helm) > 1 and self.helm[1][0] <= t + TINY:  # helm[0] acts, the others wait for the delay
            del self.helm[0]
        changes = [when - t for when, _ in self.helm[1:] if when < t + dt - TINY]
        delta = 0.0
        for (begin, end), (_, angle) in zip(pairwise([0.0, *changes, dt]), self.helm, strict=False):
            self.delta, angle = _ramp(self.delta, angle, self.limits.rudder_rate, end - begin)
            delta += angle * ((end - begin) / dt if changes else 1.0)
        return n, delta


def _ramp(position: float, order: float, rate: float, dt: float) -> tuple[float, float]:
    """Position after dt [s] at a limited rate towards the order, and the mean position on the way."""
    way, longest = order - position, rate * dt
    if abs(way) > longest:
        end = position + math.copysign(longest, way)
        return end, 0.5 * (position + end)
    share = abs(way) / longest if longest > 0 else 0.0  # of dt, in which the way is made
    return order, order - 0.5 * way * share


# What ``parse_maneuver`` understands; a negative angle begins to port.
FORMS = (
    "turning:35, zigzag:20/20, zigzag:-10/10, crash-stop, crash-stop:0.6, coasting, spiral:15/5, pull-out:20, "
    "heading:20/1.5/4, random, random:SEED, straight, berthing, acceleration"
)
STOPS = ("crash-stop", "coasting")  # Manoeuvres in which the engine is stopped or reversed
# Of the messages on the engine and the resistance that are assumed of a ship that is stopped.
STOPPING_CODES = ("assumed_engine", "stopping_resistance")


@dataclass(frozen=True)
class Maneuver:
    """What is ordered, from which steady motion, for how long at most.

    Attributes
    ----------
    name: the text it came from; kind: its first word.
    duration: longest time [s]; turning, zigzag and crash stop may end earlier.
    speed, n: surge speed [m/s] and revolutions [1/s] at the start.
    limits: rates of the actuators.
    orders: makes the orders of a fresh run, a function of (t, state).
    parameters: angles [rad] and times [s] that evaluations need, such as "rudder", "heading", "order_time".
    partial: a duration was asked for, so the manoeuvre may end before its events. sampled: orders change at samples
    only. engine: that obeys orders of revolutions in a crash stop or coasting; None: an electric motor at a limited
    rate. factors: symbol -> factor on that coefficient in this manoeuvre.
    """

    name: str
    kind: str
    duration: float
    speed: float
    n: float
    limits: Limits
    orders: Callable[[], Orders] = field(repr=False)
    parameters: Mapping[str, float] = field(default_factory=dict)
    partial: bool = False
    sampled: bool = False
    engine: Engine | None = None
    factors: Mapping[str, float] = field(default_factory=dict)

    def ship_of(self, ship: Ship) -> Ship:
        """The ``ship`` with the coefficients that she has in this manoeuvre."""
        return _with_factors(ship, self.factors)

    def controller(self) -> Controller:
        """A controller for one run; each run needs its own, it remembers rudder executes and actuator positions."""
        shaft = self.engine.shaft() if self.engine else None
        return Controller(self.orders(), self.limits, self.n, located=not self.sampled, shaft=shaft)

    @property
    def start(self) -> np.ndarray:
        """Initial state (6,): at the origin heading north with the approach speed."""
        return np.array([0.0, 0.0, 0.0, self.speed, 0.0, 0.0])


def stopping_notices(plan: Maneuver) -> list[Message]:
    """What the manoeuvre ``plan`` assumes of engine and resistance; empty for one that stops no ship."""
    words = engine_words(plan.engine) if plan.engine else ""
    notices = [Message(f"{plan.kind}: {words}", STOPPING_CODES[0])] if words else []
    for symbol, share in plan.factors.items():
        said = f"{symbol} is {share:g} of that of the ship file (stopping_resistance)"
        notices.append(Message(f"{plan.kind}: {said}, so the approach is at {plan.n:.4g} rps", STOPPING_CODES[1]))
    return notices


def _with_factors(ship: Ship, factors: Mapping[str, float]) -> Ship:
    """The ``ship`` with some coefficients times their ``factors``."""
    return ship.with_values({s: f * ship.coefficients[s].value for s, f in factors.items()}) if factors else ship


def parse_maneuver(
    text: str,
    ship: Ship,
    *,
    n: float | None = None,
    speed: float | None = None,
    duration: float | None = None,
    rudder_rate: float | None = None,
    seed: int = 0,
    sampled: bool = False,
) -> Maneuver:
    """The manoeuvre that a text such as "turning:35" names, for a ship.

    n [1/s], speed [m/s]: approach; one follows from the other by the ship's surge balance, both may be given, by
    default the speed is the ship's U_0 or that of Froude number 0.07 (7.7 kn for 320 m), in a crash stop or coasting
    0.142. duration [s] replaces the default time limit; a zigzag of given duration goes on until then, otherwise it
    ends with the sixth execute. rudder_rate [rad/s] replaces the Froude-scaled 20 deg/s. seed serves "random" when the
    text has none. Raises UserError for an unknown or ill-formed text and for an approach that the ship cannot hold.
    sampled: orders change at samples only.
    """
    kind, _, argument = text.strip().partition(":")
    if kind not in _BUILDERS:
        raise UnknownName(f"unknown manoeuvre '{text}'; known: {FORMS}")
    if kind in (*STOPS, "acceleration") and not {"n", "n_azimuth"} & set(ship.actuators):
        raise Missing(f"manoeuvre '{text}': {ship.name} has no propeller in its model that could be ordered")
    given = (("duration", duration, "s"), ("rudder rate", rudder_rate and math.degrees(rudder_rate), "deg/s"))
    for name, value, unit in given:
        if value is not None and not (math.isfinite(value) and value > 0):
            raise OutOfRange(f"{name} = {value:g} {unit} must be positive")
    if kind in ("straight", "acceleration", "berthing") and argument:
        raise BadValue(f"manoeuvre '{text}': {kind} takes no argument; known: {FORMS}")
    limits, length = Limits.for_ship(ship), ship.particulars["L"]
    if rudder_rate is not None:
        limits = replace(limits, rudder_rate=rudder_rate)
    factors = stopping_factors(ship) if kind in STOPS else {}
    ship = _with_factors(ship, factors)
    # the factors come first: a ship of another resistance needs other revolutions in her approach
    if kind in STOPS and n is None and speed is None:
        speed = own_speed(ship, TEST_FROUDE)  # that of the standard's test
    steady, revolutions = approach(ship, n, speed, at_rest=kind == "acceleration")
    midships = partial(constant, revolutions)
    base = Maneuver(text.strip(), kind, duration or 0.0, steady, revolutions, limits, midships)
    engine = engine_of(ship, steady, revolutions) if kind in STOPS else None
    base = replace(base, partial=duration is not None, sampled=sampled, engine=engine, factors=factors)
    return _BUILDERS[kind](_Setup(base, argument, time_scale(length), length, seed))


LEAST_ANGLE = 1e-3  # No order is smaller [deg]. Set by hand: bounds what is taken for a typing error.


@dataclass(frozen=True)
class _Setup:
    """What the builders share: the manoeuvre without its orders, argument of the text, time scale, length, seed."""

    base: Maneuver
    argument: str
    scale: float
    length: float
    seed: int

    @property
    def lead(self) -> float:
        """Straight approach before the first order [s]."""
        return _LEAD * self.scale

    @property
    def crossing(self) -> float:
        """L / U [s]: time in which the ship runs her length at the approach speed (at least Froude number 0.01)."""
        return self.length / max(abs(self.base.speed), 0.01 * reference_speed(self.length))

    def maneuver(
        self, default: float, orders: Callable[[], Orders] | None = None, share: float = 1.0, **parameters: float
    ) -> Maneuver:
        """The manoeuvre with ``default`` as its time limit [s of the 3 m model]; no ``orders``: rudder midships. It
        starts with ``share`` times the approach speed and revolutions."""
        return replace(
            self.base,
            duration=self.base.duration or default * self.scale,
            speed=share * self.base.speed,
            n=share * self.base.n,
            orders=orders or self.base.orders,
            parameters=parameters,
        )

    def refused(self, words: str) -> UserError:
        return BadValue(f"manoeuvre '{self.base.name}': {words}")

    def angle(self, words: str, what: str = "rudder angle") -> float:
        """An angle [rad] from degrees in the text. UserError unless LEAST_ANGLE <= |angle| <= 90 deg."""
        degrees = as_number(words)
        if not LEAST_ANGLE <= abs(degrees) <= 90:
            example = FORMS.split(", crash")[0]
            raise self.refused(
                f"{what} '{words}' must be an angle in degrees, not 0 and at most 90; for example {example}"
            )
        return math.radians(degrees)

    def angles(self, form: str, second: str, example: str) -> tuple[float, float]:
        """Rudder angle and ``second`` angle [rad] of an argument of this ``form``, such as 20/20."""
        first, slash, other = self.argument.partition("/")
        if not slash:
            raise self.refused(f"write {form}/{second} in degrees, such as {example}")
        return self.angle(first), self.angle(other, second)


_LEAD = 5.0  # Straight approach before the first order [s of the 3 m model]. Set by hand.


def _turning(s: _Setup) -> Maneuver:
    rudder = s.angle(s.argument)
    return s.maneuver(600.0, partial(Turning, s.base.n, s.lead, rudder), rudder=rudder, order_time=s.lead)


def _zigzag(s: _Setup) -> Maneuver:
    rudder, heading = s.angles("rudder", "heading", "zigzag:20/20")
    if heading < 0:
        raise s.refused("give the side by the sign of the rudder: zigzag:-10/10")
    zigzag = partial(Zigzag, s.base.n, s.lead, rudder, heading, None if s.base.partial else 6)  # ends with the sixth
    return s.maneuver(600.0, zigzag, rudder=rudder, heading=heading, order_time=s.lead)


def _crash_stop(s: _Setup) -> Maneuver:
    share = as_number(s.argument or "1")
    if not 0 < share <= 2:
        raise s.refused(
            f"'{s.argument}' must be the revolutions astern by those of the approach, more than 0 and at most 2, "
            "such as crash-stop:0.6"
        )
    return s.maneuver(600.0, partial(StopOrders, s.base.n, s.lead, -share * s.base.n), order_time=s.lead)


def _coasting(s: _Setup) -> Maneuver:
    least = as_number(s.argument or "0.3")
    if not 0.05 <= least < 1:
        raise s.refused(
            f"'{s.argument}' must be the share of the speed where it ends, from 0.05 to below 1, such as coasting:0.3"
        )
    stop = partial(StopOrders, s.base.n, s.lead, 0.0, least)
    return s.maneuver(2000.0, stop, order_time=s.lead, least=least)


# The turn rate is steady when r L / U changes by no more than 0.0002 over three ship lengths (U of the approach).
STEADY_WINDOW, STEADY_CHANGE = 3.0, 0.0002  # set by hand
# Ship lengths that one rudder angle of a spiral or pull-out may take to become steady.
_LONGEST_HOLD = 100.0  # set by hand: it bounds a run that never becomes steady


def _steps(s: _Setup, angles: tuple[float, ...], **parameters: float) -> Maneuver:
    window, tolerance = STEADY_WINDOW * s.crossing, STEADY_CHANGE / s.crossing
    longest = (s.lead + len(angles) * _LONGEST_HOLD * s.crossing) / s.scale
    orders = partial(StepOrders, s.base.n, s.lead, angles, window, tolerance)
    parameters |= {"order_time": s.lead, "window": window, "tolerance": tolerance, "steps": float(len(angles))}
    return s.maneuver(longest, orders, **parameters)


def _spiral(s: _Setup) -> Maneuver:
    largest, step = s.angles("largest rudder", "step", "spiral:15/5")
    count = abs(largest) / step
    if step < 0 or not 1 <= round(count) <= 40 or abs(count - round(count)) > 1e-6:
        raise s.refused(
            "the step must divide the largest rudder angle into 1 to 40 equal steps; such as spiral:15/5, spiral:-20/5"
        )
    return _steps(s, spiral_angles(largest, step), rudder=largest, step=step)


def _pull_out(s: _Setup) -> Maneuver:
    rudder = s.angle(s.argument)
    return _steps(s, (rudder, 0.0), rudder=rudder)


MOST_DIGITS = 15  # Of a seed: more would be lost where it is kept as a number. A double has 15.95 (IEEE 754, 2019).


def _heading(s: _Setup) -> Maneuver:
    words = s.argument.split("/")
    change, *gains = [as_number(word) for word in words] if len(words) == 3 else [math.nan] * 3
    if not (abs(change) <= 180 and all(0 <= gain < math.inf for gain in gains)):
        raise s.refused("write change of heading [deg] / K_P / K_D [s], such as heading:20/1.5/4 or heading:0/1/2")
    control = partial(HeadingControl, s.base.n, s.lead, math.radians(change), *gains)
    return s.maneuver(200.0, control, order_time=s.lead, heading=math.radians(change))


def _random(s: _Setup) -> Maneuver:
    if s.argument and not (s.argument.isdecimal() and len(s.argument) <= MOST_DIGITS):
        raise s.refused(f"the seed must be a whole number of at most {MOST_DIGITS} digits, such as random:7")
    seed, duration = int(s.argument or s.seed), s.base.duration or 150.0 * s.scale
    if seed >= 10**MOST_DIGITS:
        raise s.refused(f"the seed {str(seed)[:20]}... has more than {MOST_DIGITS} digits")
    return s.maneuver(150.0, partial(random_telegraph, s.base.n, duration, s.scale, seed), seed=float(seed))


def _berthing(s: _Setup) -> Maneuver:
    return s.maneuver(150.0, partial(berthing, s.base.n, s.scale), share=BERTHING_SPEED)


_BUILDERS: dict[str, Callable[[_Setup], Maneuver]] = {
    "turning": _turning,
    "zigzag": _zigzag,
    "crash-stop": _crash_stop,
    "coasting": _coasting,
    "spiral": _spiral,
    "pull-out": _pull_out,
    "heading": _heading,
    "random": _random,
    "straight": lambda s: s.maneuver(100.0),
    "berthing": _berthing,
    "acceleration": lambda s: s.maneuver(200.0, share=0.0),
}

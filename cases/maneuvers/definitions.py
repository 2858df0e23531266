"""Standard and identification manoeuvres, from text such as "zigzag:20/20", and the actuators that obey.

Angles are degrees in the text and radians inside. Times, rates and revolutions are those of a 3 m model,
taken to other lengths by Froude's law (time with sqrt(L / 3 m)). Turning, zigzag and crash stop are executed
as in IMO MSC.137(76), spiral and pull-out as in its explanatory notes (MSC/Circ.1053); the rudder moves at a
limited rate from the moment of the order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from cases.maneuvers import orders
from cases.maneuvers.orders import Controller, Limits, Orders
from cases.maneuvers.self_propulsion import (
    TEST_FROUDE,
    Engine,
    approach,
    engine_of,
    engine_words,
    own_speed,
    stopping_factors,
)
from cases.quantities import as_number
from mmg.errors import BadValue, Missing, OutOfRange, UnknownName, UserError
from mmg.messages import Message
from mmg.motion.froude import reference_speed, time_scale
from mmg.ship import Ship

FORMS = (
    "turning:35, zigzag:20/20, zigzag:-10/10, crash-stop, crash-stop:0.6, coasting, spiral:15/5, pull-out:20, random, "
    "random:SEED, straight, berthing, acceleration"
)
"""What ``parse_maneuver`` understands; a negative angle begins to port."""
STOPS = ("crash-stop", "coasting")
"""Manoeuvres in which the engine is stopped or reversed."""
STOPPING_CODES = ("assumed_engine", "stopping_resistance")
"""Of the messages on the engine and the resistance that are assumed of a ship that is stopped."""


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
    found = [Message(f"{plan.kind}: {words}", STOPPING_CODES[0])] if words else []
    for symbol, share in plan.factors.items():
        said = f"{symbol} is {share:g} of that of the ship file (stopping_resistance)"
        found.append(Message(f"{plan.kind}: {said}, so the approach is at {plan.n:.4g} rps", STOPPING_CODES[1]))
    return found


def _with_factors(ship: Ship, factors: Mapping[str, float]) -> Ship:
    """The ``ship`` with some coefficients times their ``factors``."""
    c = ship.coefficients
    return (
        ship.with_coefficients({s: c[s].with_(value=f * c[s].value) for s, f in factors.items()}) if factors else ship
    )


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

    n [1/s], speed [m/s]: approach; one follows from the other by the ship's surge balance, both may be given,
    by default the speed is the ship's U_0 or that of Froude number 0.07 (7.7 kn for 320 m), in a crash stop or
    coasting 0.142. duration [s] replaces the
    default time limit; a zigzag of given duration goes on until then, otherwise it ends with the sixth execute.
    rudder_rate [rad/s] replaces the Froude-scaled 20 deg/s. seed serves "random" when the text has none.
    Raises UserError for an unknown or ill-formed text and for an approach that the ship cannot hold.
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
        limits = Limits(rudder_rate, limits.propeller_rate)
    factors = stopping_factors(ship) if kind in STOPS else {}
    ship = _with_factors(ship, factors)
    if kind in STOPS and n is None and speed is None and {"n", "n_azimuth"} & set(ship.actuators):
        speed = own_speed(ship, TEST_FROUDE)  # that of the standard's test
    steady, revolutions = approach(ship, n, speed, at_rest=kind == "acceleration")
    midships = partial(orders.constant, revolutions)
    base = Maneuver(text.strip(), kind, duration or 0.0, steady, revolutions, limits, midships)
    engine = engine_of(ship, steady, revolutions) if kind in STOPS else None
    base = replace(base, partial=duration is not None, sampled=sampled, engine=engine, factors=factors)
    return _BUILDERS[kind](_Setup(base, argument, time_scale(length), length, seed))


LEAST_ANGLE = 1e-3
"""No order is smaller [deg]."""


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
        """The manoeuvre with ``default`` as its time limit [s of the 3 m model]; no ``orders``: rudder midships.

        It starts with ``share`` times the approach speed and revolutions.
        """
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


_LEAD = 5.0
"""Straight approach before the first order [s of the 3 m model]."""


def _turning(s: _Setup) -> Maneuver:
    rudder = s.angle(s.argument)
    return s.maneuver(600.0, partial(orders.Turning, s.base.n, s.lead, rudder), rudder=rudder, order_time=s.lead)


def _zigzag(s: _Setup) -> Maneuver:
    rudder, heading = s.angles("rudder", "heading", "zigzag:20/20")
    if heading < 0:
        raise s.refused("give the side by the sign of the rudder: zigzag:-10/10")
    zigzag = partial(orders.Zigzag, s.base.n, s.lead, rudder, heading, None if s.base.partial else 6)
    return s.maneuver(600.0, zigzag, rudder=rudder, heading=heading, order_time=s.lead)


def _crash_stop(s: _Setup) -> Maneuver:
    share = as_number(s.argument or "1")
    if not 0 < share <= 2:
        raise s.refused(
            f"'{s.argument}' must be the revolutions astern by those of the approach, more than 0 and at most 2, "
            "such as crash-stop:0.6"
        )
    return s.maneuver(600.0, partial(orders.StopOrders, s.base.n, s.lead, -share * s.base.n), order_time=s.lead)


def _coasting(s: _Setup) -> Maneuver:
    least = as_number(s.argument or "0.3")
    if not 0.05 <= least < 1:
        raise s.refused(
            f"'{s.argument}' must be the share of the speed where it ends, from 0.05 to below 1, such as coasting:0.3"
        )
    stop = partial(orders.StopOrders, s.base.n, s.lead, 0.0, least)
    return s.maneuver(2000.0, stop, order_time=s.lead, least=least)


STEADY_WINDOW, STEADY_CHANGE = 3.0, 0.0002
"""The turn rate is steady when r L / U changes by no more than 0.0002 over three ship lengths (U of the approach)."""
_LONGEST_HOLD = 100.0
"""Ship lengths that one rudder angle of a spiral or pull-out may take to become steady."""


def _steps(s: _Setup, angles: tuple[float, ...], **parameters: float) -> Maneuver:
    window, tolerance = STEADY_WINDOW * s.crossing, STEADY_CHANGE / s.crossing
    longest = (s.lead + len(angles) * _LONGEST_HOLD * s.crossing) / s.scale
    held = partial(orders.StepOrders, s.base.n, s.lead, angles, window, tolerance)
    parameters |= {"order_time": s.lead, "window": window, "tolerance": tolerance, "steps": float(len(angles))}
    return s.maneuver(longest, held, **parameters)


def _spiral(s: _Setup) -> Maneuver:
    largest, step = s.angles("largest rudder", "step", "spiral:15/5")
    count = abs(largest) / step
    if step < 0 or not 1 <= round(count) <= 40 or abs(count - round(count)) > 1e-6:
        raise s.refused(
            "the step must divide the largest rudder angle into 1 to 40 equal steps; such as spiral:15/5, spiral:-20/5"
        )
    return _steps(s, orders.spiral_angles(largest, step), rudder=largest, step=step)


def _pull_out(s: _Setup) -> Maneuver:
    rudder = s.angle(s.argument)
    return _steps(s, (rudder, 0.0), rudder=rudder)


MOST_DIGITS = 15
"""Of a seed: more would be lost where it is kept as a number."""


def _random(s: _Setup) -> Maneuver:
    if s.argument and not (s.argument.isdecimal() and len(s.argument) <= MOST_DIGITS):
        raise s.refused(f"the seed must be a whole number of at most {MOST_DIGITS} digits, such as random:7")
    seed, duration = int(s.argument or s.seed), s.base.duration or 150.0 * s.scale
    if seed >= 10**MOST_DIGITS:
        raise s.refused(f"the seed {str(seed)[:20]}... has more than {MOST_DIGITS} digits")
    return s.maneuver(150.0, partial(orders.random_telegraph, s.base.n, duration, s.scale, seed), seed=float(seed))


def _berthing(s: _Setup) -> Maneuver:
    return s.maneuver(150.0, partial(orders.berthing, s.base.n, s.scale), share=orders.BERTHING_SPEED)


_BUILDERS: dict[str, Callable[[_Setup], Maneuver]] = {
    "turning": _turning,
    "zigzag": _zigzag,
    "crash-stop": _crash_stop,
    "coasting": _coasting,
    "spiral": _spiral,
    "pull-out": _pull_out,
    "random": _random,
    "straight": lambda s: s.maneuver(100.0),
    "berthing": _berthing,
    "acceleration": lambda s: s.maneuver(200.0, share=0.0),
}

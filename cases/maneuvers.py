"""Standard and identification manoeuvres, from text such as "zigzag:20/20", and the actuators that obey.

Angles are degrees in the text and radians inside. Times, rates and revolutions are those of a 3 m model,
taken to other lengths by Froude's law (time with sqrt(L / 3 m)). Turning, zigzag and crash stop are executed
as in IMO MSC.137(76); the rudder moves at a limited rate from the moment of the order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cases.orders import BERTHING_SPEED, Orders, berthing, crash_stop, held, random_telegraph, turning, zigzag
from cases.propulsion import approach
from mmg.errors import UserError
from mmg.ship import Ship

FORMS = "turning:35, zigzag:20/20, zigzag:-10/10, crash-stop, random, random:SEED, straight, berthing, acceleration"
"""What ``parse_maneuver`` understands; a negative angle begins to port."""

MODEL_LENGTH = 3.0
"""Length [m] for which the times and rates of this file are written."""


@dataclass(frozen=True)
class Limits:
    """Rates of the actuators: rudder [rad/s], propeller [1/s^2].

    20 deg/s and 20 rps/s for a 3 m model (public simulator of Osaka University; physics I), Froude scaled:
    1.9 deg/s for a ship of 320 m.
    """

    rudder_rate: float
    propeller_rate: float

    @classmethod
    def for_length(cls, length: float) -> Limits:
        """Limits for a ship of this length [m]."""
        share = MODEL_LENGTH / length
        return cls(math.radians(20.0) * math.sqrt(share), 20.0 * share)


@dataclass
class Controller:
    """Follows the orders of one run within the limits; ``over`` tells that the manoeuvre has ended.

    n [1/s] and delta [rad] are the positions reached, t [s] the time of the last call.
    """

    orders: Orders
    limits: Limits
    n: float
    delta: float = 0.0
    t: float = 0.0
    over: bool = False

    def commands(self, t: float, state: np.ndarray) -> tuple[float, float]:
        """Revolutions [1/s] and rudder angle [rad] at time t [s] (never earlier than the last call).

        state: (6,) x, y, psi (continuous, not wrapped), u, v, r. Positions move from those of the last call
        towards the order within the limits.
        """
        order = self.orders(t, state)
        if order is None:
            self.over = True
        else:
            step = max(t - self.t, 0.0)
            self.n += _clip(order[0] - self.n, self.limits.propeller_rate * step)
            self.delta += _clip(order[1] - self.delta, self.limits.rudder_rate * step)
        self.t = t
        return self.n, self.delta


def _clip(change: float, limit: float) -> float:
    return min(max(change, -limit), limit)


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
    """

    name: str
    kind: str
    duration: float
    speed: float
    n: float
    limits: Limits
    orders: Callable[[], Orders] = field(repr=False)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def controller(self) -> Controller:
        """A controller for one run; each run needs its own, it remembers executes and actuator positions."""
        return Controller(self.orders(), self.limits, self.n)

    @property
    def start(self) -> np.ndarray:
        """Initial state (6,): at the origin heading north with the approach speed."""
        return np.array([0.0, 0.0, 0.0, self.speed, 0.0, 0.0])


def parse_maneuver(
    text: str,
    ship: Ship,
    *,
    n: float | None = None,
    speed: float | None = None,
    duration: float | None = None,
    rudder_rate: float | None = None,
    seed: int = 0,
) -> Maneuver:
    """The manoeuvre that a text such as "turning:35" names, for a ship.

    n [1/s], speed [m/s]: approach; one follows from the other by the ship's surge balance, both may be given,
    by default the speed is that of Froude number 0.07 (7.7 kn for 320 m). duration [s] replaces the default
    time limit; a zigzag of given duration goes on until then, otherwise it ends with the sixth execute.
    rudder_rate [rad/s] replaces the Froude-scaled 20 deg/s. seed serves "random" when the text has none.
    Raises UserError for an unknown or ill-formed text and for an approach that the ship cannot hold.
    """
    kind, _, argument = text.strip().partition(":")
    if kind not in _BUILDERS:
        raise UserError(f"unknown manoeuvre '{text}'; known: {FORMS}")
    for name, value in (("duration", duration), ("rudder rate", rudder_rate)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise UserError(f"{name} = {value:g} must be positive")
    if kind in ("straight", "acceleration", "crash-stop", "berthing") and argument:
        raise UserError(f"manoeuvre '{text}': {kind} takes no argument; known: {FORMS}")
    scale = math.sqrt(ship.particulars["L"] / MODEL_LENGTH)
    limits = Limits.for_length(ship.particulars["L"])
    if rudder_rate is not None:
        limits = Limits(rudder_rate, limits.propeller_rate)
    at_rest = kind == "acceleration"
    steady, revolutions = approach(ship, n, speed, at_rest)
    setup = _Setup(text.strip(), kind, argument, scale, steady, revolutions, duration, limits, seed)
    return _BUILDERS[kind](setup)


@dataclass(frozen=True)
class _Setup:
    """What the builders share: the text and its parts, time scale, approach, limit of time."""

    text: str
    kind: str
    argument: str
    scale: float
    speed: float
    n: float
    duration: float | None
    limits: Limits
    seed: int

    def maneuver(
        self, default: float, orders: Callable[[], Orders], share: float = 1.0, **parameters: float
    ) -> Maneuver:
        """The manoeuvre with ``default`` as its time limit [s of the 3 m model].

        It starts with ``share`` times the approach speed and revolutions.
        """
        return Maneuver(
            name=self.text,
            kind=self.kind,
            duration=self.duration or default * self.scale,
            speed=share * self.speed,
            n=share * self.n,
            limits=self.limits,
            orders=orders,
            parameters=parameters,
        )

    def angle(self, words: str, what: str, largest: float) -> float:
        """An angle [rad] from degrees in the text. UserError unless 0 < |angle| <= ``largest`` [deg]."""
        try:
            degrees = float(words)
        except ValueError:
            degrees = math.nan
        if not 0 < abs(degrees) <= largest:
            raise UserError(
                f"manoeuvre '{self.text}': {what} '{words}' must be an angle in degrees, not 0 and at most "
                f"{largest:g}; for example {FORMS.split(', crash')[0]}"
            )
        return math.radians(degrees)


_LEAD = 5.0
"""Straight approach before the first order [s of the 3 m model]."""


def _turning(s: _Setup) -> Maneuver:
    rudder, lead = s.angle(s.argument, "rudder angle", 90), _LEAD * s.scale
    return s.maneuver(600.0, lambda: turning(s.n, rudder, lead), rudder=rudder, order_time=lead)


def _zigzag(s: _Setup) -> Maneuver:
    first, slash, second = s.argument.partition("/")
    if not slash:
        raise UserError(f"manoeuvre '{s.text}': write rudder/heading in degrees, such as zigzag:20/20")
    rudder, heading = s.angle(first, "rudder angle", 90), s.angle(second, "heading", 90)
    if heading < 0:
        raise UserError(f"manoeuvre '{s.text}': give the side by the sign of the rudder: zigzag:-10/10")
    lead, executes = _LEAD * s.scale, 6 if s.duration is None else None
    return s.maneuver(
        600.0,
        lambda: zigzag(s.n, rudder, heading, lead, executes),
        rudder=rudder,
        heading=heading,
        order_time=lead,
    )


def _crash_stop(s: _Setup) -> Maneuver:
    lead = _LEAD * s.scale
    return s.maneuver(600.0, lambda: crash_stop(s.n, lead), order_time=lead)


def _random(s: _Setup) -> Maneuver:
    seed = s.seed
    if s.argument:
        if not s.argument.isdecimal():
            raise UserError(f"manoeuvre '{s.text}': the seed must be a whole number, such as random:7")
        seed = int(s.argument)
    duration = s.duration or 150.0 * s.scale
    return s.maneuver(150.0, lambda: random_telegraph(s.n, duration, s.scale, seed), seed=float(seed))


def _straight(s: _Setup) -> Maneuver:
    return s.maneuver(100.0, lambda: held(s.n))


def _berthing(s: _Setup) -> Maneuver:
    return s.maneuver(150.0, lambda: berthing(s.n, s.scale), share=BERTHING_SPEED)


def _acceleration(s: _Setup) -> Maneuver:
    return s.maneuver(200.0, lambda: held(s.n), share=0.0)


_BUILDERS: dict[str, Callable[[_Setup], Maneuver]] = {
    "turning": _turning,
    "zigzag": _zigzag,
    "crash-stop": _crash_stop,
    "random": _random,
    "straight": _straight,
    "berthing": _berthing,
    "acceleration": _acceleration,
}

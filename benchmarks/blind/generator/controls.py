"""Manoeuvres of the 3 m ship: orders of revolutions and rudder, the steering gear, and where the runs begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray

DURATION = 150.0
RUDDER_RATE, SHAFT_RATE = np.radians(20.0), 10.0
"""Rate limits of the steering gear [rad/s] and of the shaft [1/s^2]."""

SETS = {
    "mixed": (
        ("zigzag", "zigzag", "turn", "turn", "random", "random", "berthing"),
        ("zigzag", "turn", "random", "random", "berthing"),
    ),
    "ahead": (
        ("zigzag", "zigzag", "turn", "turn", "random", "random", "random"),
        ("zigzag", "turn", "random", "random", "random"),
    ),
    **{kind: ((kind,) * 7, (kind,) * 5) for kind in ("zigzag", "turn", "random", "berthing")},
}
"""Runs for training and runs held out, by manoeuvre set."""


@dataclass
class Orders:
    """Orders of a batch of runs on the grid: n [1/s] and delta [rad] (K, B); zigzag: rudder and heading to turn at."""

    n: Array
    delta: Array
    rudder: Array  # (B,), 0 where the run is no zigzag
    switch: Array  # (B,) [rad]
    start: Array  # (B,) time of the first execute of a zigzag [s]

    @classmethod
    def joined(cls, several: Sequence[Orders]) -> Orders:
        """The orders of several cases side by side."""
        names = ("n", "delta", "rudder", "switch", "start")
        return cls(*(np.concatenate([getattr(o, name) for o in several], axis=-1) for name in names))


def _held(count: int, dt: float, values: Sequence[float] | Array, seconds: Sequence[float] | Array) -> Array:
    """A staircase: each value for its number of seconds, the last to the end."""
    ends = np.cumsum(seconds)
    return np.asarray(values)[np.minimum(np.searchsorted(ends, dt * np.arange(count), "right"), len(values) - 1)]


def _zigzag(count: int, dt: float, side: float, rng: np.random.Generator) -> tuple[Array, Array, tuple]:
    angle = np.radians(rng.choice((20.0, 25.0, 30.0, 35.0)))
    switch = angle if rng.uniform() < 0.7 else 0.5 * angle
    n = _held(count, dt, rng.uniform(7.0, 12.0, 2), (rng.uniform(60.0, 110.0), DURATION))
    return n, np.zeros(count), (side * angle, switch, rng.uniform(3.0, 10.0))


def _turn(count: int, dt: float, side: float, rng: np.random.Generator) -> tuple[Array, Array, tuple]:
    angle = side * np.radians(rng.choice((20.0, 25.0, 30.0, 35.0)))
    n = _held(count, dt, [rng.uniform(7.0, 11.0)], [DURATION])
    seconds = (rng.uniform(5.0, 20.0), rng.uniform(80.0, 150.0), DURATION)
    return n, _held(count, dt, (0.0, angle, angle * rng.choice((0.0, 0.5, -1.0))), seconds), (0.0, 0.0, 0.0)


def _random(count: int, dt: float, side: float, rng: np.random.Generator) -> tuple[Array, Array, tuple]:
    delta = np.radians(rng.uniform(-35.0, 35.0, 40)) * (rng.uniform(size=40) > 0.15)
    n = rng.uniform(4.0, 11.0, 20)
    orders = _held(count, dt, delta, rng.uniform(4.0, 16.0, 40))
    return _held(count, dt, n, rng.uniform(12.0, 40.0, 20)), orders, (0.0, 0.0, 0.0)


def _berthing(count: int, dt: float, side: float, rng: np.random.Generator) -> tuple[Array, Array, tuple]:
    values: list[float] = [rng.uniform(6.0, 10.0)]
    seconds: list[float] = [rng.uniform(15.0, 30.0)]
    while sum(seconds) < DURATION:
        values += [rng.uniform(0.0, 4.0), -rng.uniform(6.0, 12.0), 0.0, rng.uniform(5.0, 12.0)]
        seconds += list(rng.uniform((4.0, 8.0, 2.0, 8.0), (12.0, 22.0, 8.0, 20.0)))
    delta = np.radians(rng.uniform(-35.0, 35.0, 30)) * (rng.uniform(size=30) > 0.2)
    return _held(count, dt, values, seconds), _held(count, dt, delta, rng.uniform(6.0, 18.0, 30)), (0.0, 0.0, 0.0)


_MAKERS = {"zigzag": _zigzag, "turn": _turn, "random": _random, "berthing": _berthing}


def orders(kinds: Sequence[str], count: int, dt: float, sides: Array, rng: np.random.Generator) -> Orders:
    """Orders of the runs of one case; sides (B,): +1 or -1, the side of the first turn."""
    made = [_MAKERS[kind](count, dt, float(side), rng) for kind, side in zip(kinds, sides, strict=True)]
    zigzag = np.array([one[2] for one in made]).T
    return Orders(np.stack([one[0] for one in made], 1), np.stack([one[1] for one in made], 1), *zigzag)


def begin(
    kinds: Sequence[str], bank: tuple[float, float] | None, sides: Array, n: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Initial states (6, B) and the sides of the first turns (B,).

    Runs go straight ahead at first, at about the speed of their revolutions n (B,) [1/s]. They begin around the origin
    on any heading, or beside a bank (bearing [rad], distance [m] from the origin): along it, and turning away from it.
    """
    B = len(kinds)
    x, y = rng.normal(0.0, 3.0, (2, B))
    psi = rng.uniform(-np.pi, np.pi, B)
    if bank is not None:
        bearing, distance = bank
        reach = {"zigzag": (2.5, 5.5), "turn": (2.5, 6.0), "random": (5.0, 11.0), "berthing": (3.0, 8.0)}
        off = np.array([rng.uniform(*reach[kind]) for kind in kinds])
        along = rng.normal(0.0, 3.0, B)
        x = (distance - off) * np.cos(bearing) - along * np.sin(bearing)
        y = (distance - off) * np.sin(bearing) + along * np.cos(bearing)
        psi = bearing + sides * np.pi / 2 + rng.normal(0.0, 0.12, B)
    u = 0.036 * n * rng.uniform(0.6, 1.05, B)
    return np.stack([x, y, psi, u, np.zeros(B), np.zeros(B)]), sides


@dataclass
class Helm:
    """Hands the orders of a batch to a rate-limited gear, step by step; zigzags follow the heading."""

    orders: Orders
    heading: Array  # (B,) heading at the start [rad]
    dt: float

    def __post_init__(self) -> None:
        self.n, self.delta = np.empty_like(self.orders.n), np.empty_like(self.orders.delta)
        self.n[0], self.delta[0] = self.orders.n[0], self.orders.delta[0]
        self._now = np.zeros(len(self.heading))

    def advance(self, k: int, psi: Array) -> None:
        """Fills row k + 1 of n and delta, seeing the heading at row k."""
        o, turned = self.orders, psi - self.heading
        begun = (o.rudder != 0) & (k * self.dt >= o.start)
        self._now = np.where(begun & (self._now == 0), o.rudder, self._now)
        self._now = np.where(begun & (turned * np.sign(self._now) >= o.switch), -self._now, self._now)
        wanted = np.where(o.rudder != 0, self._now, o.delta[k])
        most, spin = RUDDER_RATE * self.dt, SHAFT_RATE * self.dt
        self.delta[k + 1] = self.delta[k] + np.clip(wanted - self.delta[k], -most, most)
        self.n[k + 1] = self.n[k] + np.clip(o.n[k] - self.n[k], -spin, spin)

"""Manoeuvres of the 3 m ship: orders of revolutions and rudder, the steering gear, and where the runs begin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.toml import tables

Array, Rng = np.ndarray, np.random.Generator

DURATION = 150.0
RUDDER_RATE, SHAFT_RATE, BOW_RATE = np.radians(20.0), 10.0, 30.0
"""Rate limits of the steering gear [rad/s], of the shaft and of the bow thruster [1/s^2]."""

SETS = tables(Path(__file__).with_suffix(".toml"))
"""Runs for training and runs held out, by manoeuvre set."""


@dataclass
class Orders:
    """Orders of a batch of runs on the grid: n [1/s] and delta [rad] (K, B); zigzag: rudder and heading to turn at;
    the port one of two rudders and a bow thruster, which a ship with one rudder does not have."""

    n: Array
    delta: Array
    rudder: Array  # (B,), 0 where the run is no zigzag
    switch: Array  # (B,) [rad]
    start: Array  # (B,) time of the first execute of a zigzag [s]
    port: Array
    bow: Array

    @classmethod
    def joined(cls, several: Sequence[Orders]) -> Orders:
        """The orders of several cases side by side."""
        names = ("n", "delta", "rudder", "switch", "start", "port", "bow")
        return cls(*(np.concatenate([getattr(o, name) for o in several], axis=-1) for name in names))


def _held(count: int, dt: float, values: Sequence[float] | Array, seconds: Sequence[float] | Array) -> Array:
    """A staircase: each value for its number of seconds, the last to the end."""
    ends = np.cumsum(seconds)
    return np.asarray(values)[np.minimum(np.searchsorted(ends, dt * np.arange(count), "right"), len(values) - 1)]


def _zigzag(count: int, dt: float, side: float, rng: Rng) -> tuple[Array, Array, tuple]:
    angle = np.radians(rng.choice((20.0, 25.0, 30.0, 35.0)))
    switch = angle if rng.uniform() < 0.7 else 0.5 * angle
    n = _held(count, dt, rng.uniform(7.0, 12.0, 2), (rng.uniform(60.0, 110.0), DURATION))
    return n, np.zeros(count), (side * angle, switch, rng.uniform(3.0, 10.0))


def _turn(count: int, dt: float, side: float, rng: Rng) -> tuple[Array, Array, tuple]:
    angle = side * np.radians(rng.choice((20.0, 25.0, 30.0, 35.0)))
    n = _held(count, dt, [rng.uniform(7.0, 11.0)], [DURATION])
    seconds = (rng.uniform(5.0, 20.0), rng.uniform(80.0, 150.0), DURATION)
    return n, _held(count, dt, (0.0, angle, angle * rng.choice((0.0, 0.5, -1.0))), seconds), (0.0, 0.0, 0.0)


def _random(count: int, dt: float, side: float, rng: Rng) -> tuple[Array, Array, tuple]:
    delta = np.radians(rng.uniform(-35.0, 35.0, 40)) * (rng.uniform(size=40) > 0.15)
    n = rng.uniform(4.0, 11.0, 20)
    orders = _held(count, dt, delta, rng.uniform(4.0, 16.0, 40))
    return _held(count, dt, n, rng.uniform(12.0, 40.0, 20)), orders, (0.0, 0.0, 0.0)


def _berthing(count: int, dt: float, side: float, rng: Rng) -> tuple[Array, Array, tuple]:
    values: list[float] = [rng.uniform(6.0, 10.0)]
    seconds: list[float] = [rng.uniform(15.0, 30.0)]
    while sum(seconds) < DURATION:
        values += [rng.uniform(0.0, 4.0), -rng.uniform(6.0, 12.0), 0.0, rng.uniform(5.0, 12.0)]
        seconds += list(rng.uniform((4.0, 8.0, 2.0, 8.0), (12.0, 22.0, 8.0, 20.0)))
    delta = np.radians(rng.uniform(-35.0, 35.0, 30)) * (rng.uniform(size=30) > 0.2)
    return _held(count, dt, values, seconds), _held(count, dt, delta, rng.uniform(6.0, 18.0, 30)), (0.0, 0.0, 0.0)


def _steaming(count: int, dt: float, side: float, rng: Rng) -> tuple[Array, ...]:
    """Two rudders steered together, up to 8 degrees apart, at the same revolutions throughout."""
    both = np.radians(rng.uniform(-27.0, 27.0, 40)) * (rng.uniform(size=40) > 0.15)
    apart, seconds = np.radians(rng.uniform(0.0, 8.0, 40)), rng.uniform(4.0, 16.0, 40)
    pair = [_held(count, dt, both + way * apart, seconds) for way in (0.5, -0.5)]
    return np.full(count, rng.uniform(7.0, 11.0)), pair[0], np.zeros(3), pair[1], np.zeros(count)


def _harbour(count: int, dt: float, side: float, rng: Rng) -> tuple[Array, ...]:
    """Two rudders by which a ship stops, hovers and turns while the propeller turns on, and a bow thruster."""
    moves = 40
    which, inwards = rng.integers(0, 4, moves), np.radians(rng.uniform(0.0, 35.0, moves))
    out, other_out = np.radians(rng.uniform(45.0, 105.0, (2, moves)))
    steer, one_side = np.radians(rng.uniform(-35.0, 35.0, moves)), rng.uniform(size=moves) < 0.5
    starboard = np.choose(which, (steer, out, np.where(one_side, out, -inwards), 0.0 * steer))
    port = np.choose(which, (steer, -other_out, np.where(one_side, inwards, -out), 0.0 * steer))
    seconds = rng.uniform(6.0, 18.0, moves) * np.where(which == 1, 2.0, 1.0)
    bow = rng.uniform(15.0, 40.0, moves) * rng.choice((-1.0, 0.0, 0.0, 1.0), moves)
    n = np.full(count, rng.uniform(6.0, 10.0))
    first = _held(count, dt, starboard, seconds), np.zeros(3), _held(count, dt, port, seconds)
    return n, *first, _held(count, dt, bow, rng.uniform(6.0, 18.0, moves))


_MAKERS: dict[str, Callable[[int, float, float, np.random.Generator], tuple]] = {
    "zigzag": _zigzag, "turn": _turn, "random": _random, "berthing": _berthing, "steaming": _steaming,
    "harbour": _harbour,
}  # fmt: skip


def orders(kinds: Sequence[str], count: int, dt: float, sides: Array, rng: Rng) -> Orders:
    """Orders of the runs of one case; sides (B,): +1 or -1, the side of the first turn. Where a run does not tell two
    rudders apart the port one goes with the other."""
    made = [_MAKERS[kind](count, dt, float(side), rng) for kind, side in zip(kinds, sides, strict=True)]
    rudder, switch, start = np.array([one[2] for one in made]).T
    pairs = [one[3:] or (one[1], np.zeros(count)) for one in made]
    n, delta, port, bow = (
        np.stack(columns, 1) for columns in ([m[0] for m in made], [m[1] for m in made], *zip(*pairs, strict=True))
    )
    return Orders(n, delta, rudder, switch, start, port, bow)


def begin(kinds: Sequence[str], bank: tuple[float, float] | None, sides: Array, n: Array, rng: Rng) -> Array:
    """Initial states (6, B). sides (B,): of the first turns.

    Runs go straight ahead at first, at about the speed of their revolutions n (B,) [1/s]. They begin around the origin
    on any heading, or beside a bank (bearing [rad], distance [m] from the origin): along it, and turning away from it.
    """
    B = len(kinds)
    x, y = rng.normal(0.0, 3.0, (2, B))
    psi = rng.uniform(-np.pi, np.pi, B)
    if bank is not None:
        bearing, distance = bank
        reach = {"zigzag": (2.5, 5.5), "turn": (2.5, 6.0), "random": (5.0, 11.0), "berthing": (3.0, 8.0)}
        reach |= {"steaming": (5.0, 11.0), "harbour": (3.0, 8.0)}
        off = np.array([rng.uniform(*reach[kind]) for kind in kinds])
        along = rng.normal(0.0, 3.0, B)
        x = (distance - off) * np.cos(bearing) - along * np.sin(bearing)
        y = (distance - off) * np.sin(bearing) + along * np.cos(bearing)
        psi = bearing + sides * np.pi / 2 + rng.normal(0.0, 0.12, B)
    u = 0.036 * n * rng.uniform(0.6, 1.05, B)
    return np.stack([x, y, psi, u, np.zeros(B), np.zeros(B)])


@dataclass
class Helm:
    """Hands the orders of a batch to a rate-limited gear, step by step; zigzags follow the heading."""

    orders: Orders
    heading: Array  # (B,) heading at the start [rad]
    dt: float

    def __post_init__(self) -> None:
        self.n, self.delta = np.empty_like(self.orders.n), np.empty_like(self.orders.delta)
        self.n[0], self.delta[0] = self.orders.n[0], self.orders.delta[0]
        self.port, self.bow = np.empty_like(self.n), np.empty_like(self.n)
        self.port[0], self.bow[0] = self.orders.port[0], self.orders.bow[0]
        self._now = np.zeros(len(self.heading))

    def advance(self, k: int, psi: Array) -> None:
        """Fills row k + 1 of n, delta, port and bow, seeing the heading at row k."""
        o, turned = self.orders, psi - self.heading
        begun = (o.rudder != 0) & (k * self.dt >= o.start)
        self._now = np.where(begun & (self._now == 0), o.rudder, self._now)
        self._now = np.where(begun & (turned * np.sign(self._now) >= o.switch), -self._now, self._now)
        for real, ordered, rate in (
            (self.delta, np.where(o.rudder != 0, self._now, o.delta[k]), RUDDER_RATE),
            (self.port, np.where(o.rudder != 0, self._now, o.port[k]), RUDDER_RATE),
            (self.n, o.n[k], SHAFT_RATE),
            (self.bow, o.bow[k], BOW_RATE),
        ):
            most = rate * self.dt
            real[k + 1] = real[k] + np.clip(ordered - real[k], -most, most)

"""The orders of each manoeuvre: functions of time and state that say what is asked of propeller and rudder.

Each factory returns a fresh function (t [s], state (6,)) -> (n [1/s], delta [rad]), or None once it is over.
The state is (x, y, psi continuous, u, v, r). Orders are steps; the rate limits are those of the controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Orders = Callable[[float, np.ndarray], "tuple[float, float] | None"]

FULL_TURN = 3 * math.pi
"""Change of heading after which a turning test ends [rad]: 540 degrees (IMO MSC/Circ.1053)."""

_TINY = 1e-9
"""Slack in comparisons of times [s], so that 0.1 + 0.2 is not later than 0.3."""


def held(n: float) -> Orders:
    """Revolutions n, rudder midships, for ever."""
    return lambda t, state: (n, 0.0)


def turning(n: float, rudder: float, lead: float) -> Orders:
    """Straight for ``lead`` seconds, then the rudder over until the heading has changed by 540 degrees."""
    origin: list[float] = []

    def orders(t: float, state: np.ndarray) -> tuple[float, float] | None:
        if t < lead - _TINY:
            return n, 0.0
        if not origin:
            origin.append(state[2])
        return None if abs(state[2] - origin[0]) >= FULL_TURN else (n, rudder)

    return orders


def zigzag(n: float, rudder: float, heading: float, lead: float, executes: int | None = None) -> Orders:
    """Rudder over; reversed each time the heading has changed by ``heading`` to the side of the rudder.

    The change counts from the heading at the first execute. ``executes``: the manoeuvre is over with this
    execute.
    """
    origin: list[float] = []
    side = [1.0 if rudder > 0 else -1.0]
    count = [1]

    def orders(t: float, state: np.ndarray) -> tuple[float, float] | None:
        if t < lead - _TINY:
            return n, 0.0
        if not origin:
            origin.append(state[2])
        if side[0] * (state[2] - origin[0]) >= heading:
            side[0] = -side[0]
            count[0] += 1
        if executes is not None and count[0] >= executes:
            return None
        return n, side[0] * abs(rudder)

    return orders


def crash_stop(n: float, lead: float) -> Orders:
    """Straight for ``lead`` seconds, then the same revolutions astern until headway is lost."""

    def orders(t: float, state: np.ndarray) -> tuple[float, float] | None:
        if t < lead - _TINY:
            return n, 0.0
        return None if state[3] <= 0 else (-n, 0.0)

    return orders


def schedule(n_times: np.ndarray, n: np.ndarray, delta_times: np.ndarray, delta: np.ndarray) -> Orders:
    """Orders held from each time to the next, the first at 0: (A,) [s], (A,) [1/s], (B,) [s], (B,) [rad]."""

    def orders(t: float, state: np.ndarray) -> tuple[float, float]:
        i = np.searchsorted(n_times, t + _TINY, side="right") - 1
        j = np.searchsorted(delta_times, t + _TINY, side="right") - 1
        return float(n[i]), float(delta[j])

    return orders


def random_telegraph(n: float, duration: float, scale: float, seed: int) -> Orders:
    """Random revolutions and rudder angles, each held for a random time; reproducible by ``seed``.

    Rudder: -35..35 deg, held 4..20 s. Revolutions: 0.3..1.2 n ahead, or 0.3..1 n astern (about every third
    order, and at least every fourth), held 10..30 s. ``scale`` stretches the times, which are those of a 3 m
    model.
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
_BERTHING_DELTA = (
    (0, 0),
    (8, 15),
    (20, -20),
    (34, 10),
    (50, -35),
    (70, 0),
    (88, 35),
    (97, -35),
    (112, 20),
    (130, -25),
)
"""(time [s of the 3 m model], share of n) and (time, rudder [deg]): slow ahead, reversals, kicks ahead."""


def berthing(n: float, scale: float) -> Orders:
    """Slow approach, stops, reversals, kicks ahead on large rudder; repeats after 150 s (3 m model)."""
    n_times, shares = np.array(_BERTHING_N, dtype=float).T
    delta_times, degrees = np.array(_BERTHING_DELTA, dtype=float).T
    orders = schedule(n_times, n * shares, delta_times, np.radians(degrees))
    return lambda t, state: orders(math.fmod(t / scale + _TINY, _BERTHING_PERIOD), state)

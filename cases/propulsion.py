"""Self-propulsion: the revolutions that hold a speed, and the speed they give, by a ship's surge balance."""

from __future__ import annotations

import math
from collections.abc import Callable

from mmg.errors import UserError
from mmg.model import assemble
from mmg.ship import Ship
from mmg.smooth import GRAVITY

FROUDE = 0.07
"""Froude number of the default approach: harbour speed, 7.7 kn for 320 m, 0.38 m/s for 3 m."""


def surge_balance(ship: Ship) -> Callable[[float, float], float]:
    """Surge acceleration [m/s^2] at u [m/s] and n [1/s]: straight, rudder midships, calm air."""
    rates = assemble(ship, symbols=()).rates
    return lambda u, n: float(rates([0.0, 0.0, 0.0, u, 0.0, 0.0], [n, 0.0, 0.0, 0.0], [])[3])


def revolutions_for(ship: Ship, u: float) -> float:
    """Revolutions ahead [1/s] that hold u > 0 [m/s]. Raises UserError when no revolutions do."""
    surge = surge_balance(ship)
    first = u / ship.particulars.get("D_P", 0.03 * ship.particulars["L"])
    return _root(lambda n: surge(u, n), first, f"no revolutions hold {u:g} m/s with {ship.name}")


def speed_for(ship: Ship, n: float) -> float:
    """Steady speed [m/s] at n > 0 [1/s]. Raises UserError when the ship does not settle."""
    surge = surge_balance(ship)
    first = n * ship.particulars.get("D_P", 0.03 * ship.particulars["L"])
    return _root(lambda u: -surge(u, n), first, f"{ship.name} finds no steady speed at n = {n:g} rps")


def _root(function: Callable[[float], float], first: float, failure: str) -> float:
    """Root of a function that is negative at small positive arguments and positive at large ones."""
    from scipy.optimize import brentq

    low, high = 1e-3 * first, first
    for _ in range(8):
        if function(high) > 0:
            break
        low, high = high, 2 * high
    if not function(low) < 0 < function(high):
        raise UserError(f"{failure}; check thrust and resistance, or give both n and speed")
    return float(brentq(function, low, high, xtol=1e-12, rtol=1e-12))


def approach(ship: Ship, n: float | None, speed: float | None, at_rest: bool = False) -> tuple[float, float]:
    """(speed [m/s], n [1/s]) at the start of a manoeuvre; what is not given follows from the surge balance.

    ``at_rest``: the ship starts with speed 0 whatever n is. Raises UserError for numbers that make no
    approach.
    """
    u, revolutions = _approach(ship, n, speed, at_rest)
    fastest = math.sqrt(GRAVITY * ship.particulars["L"])
    if abs(u) > fastest:
        raise UserError(
            f"an approach at {u:g} m/s is Froude number {u / fastest:.2g}, outside this model; give a lower speed or n"
        )
    return u, revolutions


def _approach(ship: Ship, n: float | None, speed: float | None, at_rest: bool) -> tuple[float, float]:
    for name, value in (("n", n), ("speed", speed)):
        if value is not None and not math.isfinite(value):
            raise UserError(f"{name} = {value} is not a finite number")
    if at_rest and n is not None:
        if speed is not None:
            raise UserError("an acceleration starts from rest: give n or the speed to reach, not both")
        return 0.0, n
    if n is not None and speed is not None:
        return speed, n
    if n is not None:
        if n <= 0:
            raise UserError(f"n = {n:g} rps gives no steady approach ahead; give a positive n, or a speed as well")
        return speed_for(ship, n), n
    if speed is not None and speed <= 0:
        raise UserError(f"speed = {speed:g} m/s: the approach must be ahead; give n as well for anything else")
    wanted = FROUDE * math.sqrt(GRAVITY * ship.particulars["L"]) if speed is None else speed
    return (0.0 if at_rest else wanted), revolutions_for(ship, wanted)

"""Self-propulsion: the revolutions that hold a speed, and the speed they give, by a ship's surge balance."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from mmg.errors import Conflict, Missing, NoSolution, OutOfRange
from mmg.model import assemble
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

FROUDE = 0.07
"""Froude number of the default approach: harbour speed, 7.7 kn for 320 m, 0.38 m/s for 3 m."""

TEST_FROUDE = 0.142
"""Froude number of the test speed of a ship whose file gives none: 15.5 kn for 320 m."""

DESIGN_PITCH = math.radians(20.0)
"""Blade angle [rad] of a controllable-pitch propeller ahead, where the ship file gives no particular ``pitch``."""


def actuator_positions(ship: Ship, n: Any, delta: Any) -> dict[str, Any]:
    """Positions of all actuators under one order: both propellers and both rudders alike, thrusters at rest.

    A controllable-pitch propeller turns ahead all the time: its blades reverse instead, as far on the other side of
    the zero-thrust pitch. A ship without a propeller is
    driven by its azimuth thruster, which also steers where there is no rudder: aft of midship it pushes to port then.
    n [1/s], delta [rad]: numbers, or arrays of one shape; ship: gives the names.
    """
    moved: dict[str, Any] = dict.fromkeys(ship.actuators, 0.0)
    for name in moved:
        if name in ("n", "n_2"):
            moved[name] = abs(n) if "pitch" in moved else n
        elif name.startswith("delta"):
            moved[name] = delta
        elif name == "pitch":
            ahead, zero = ship.particulars.get("pitch", DESIGN_PITCH), ship.coefficients["theta_0"].value
            moved[name] = np.where(n >= 0, ahead, 2 * zero - ahead)
    rudders = any(name.startswith("delta") for name in moved)
    for name in [name for name in moved if name.startswith("n_azimuth") and "n" not in moved]:
        moved[name], angle = n, name.removeprefix("n_")
        if not rudders and angle in moved:
            place = ship.particulars.get(angle.replace("azimuth", "x_az"), -1.0)
            moved[angle] = np.copysign(delta, delta * place)
    return moved


def surge_balance(ship: Ship) -> Callable[[float, float], float]:
    """Surge acceleration [m/s^2] of a ``ship`` at u [m/s] and n [1/s]: straight, rudder midships, calm, still water."""
    still = ship
    for name in ship.effects:
        still = still if name in ("fouling", "draft") else still.without_effect(name)
    model = assemble(still, symbols=())

    @cache  # the same speeds are asked for again and again
    def surge(u: float, n: float) -> float:
        moved = actuator_positions(still, n, 0.0)
        inputs = [float(moved.get(name, 0.0)) for name in still.inputs]
        return float(model.rates(model.initial([0.0, 0.0, 0.0, u, 0.0, 0.0], inputs, []), inputs, [])[3])

    return surge


def revolutions_for(ship: Ship, u: float) -> float:
    """Revolutions ahead [1/s] at which a ``ship`` holds u > 0 [m/s]. Raises UserError when no revolutions do."""
    surge = surge_balance(ship)
    first = u / ship.particulars.get("D_P", 0.03 * ship.particulars["L"])
    return _root(lambda n: surge(u, n), first, f"no revolutions hold {u:g} m/s with {ship.name}")


def speed_for(ship: Ship, n: float) -> float:
    """Steady speed [m/s] at n > 0 [1/s]. Raises UserError when the ship does not settle."""
    surge = surge_balance(ship)
    first = n * ship.particulars.get("D_P", 0.03 * ship.particulars["L"])
    return _root(lambda u: -surge(u, n), first, f"{ship.name} finds no steady speed at n = {n:g} rps")


def _root(function: Callable[[float], float], first: float, failure: str) -> float:
    """Root of a function that is negative at small positive arguments and positive at large ones.

    To 1e-12 of it by the Illinois method (Dowell & Jarratt 1971): scipy's root finders are slow to import.
    """
    low, high = 1e-3 * first, first
    for _ in range(8):
        if function(high) > 0:
            break
        low, high = high, 2 * high
    below, above = function(low), function(high)
    if not below < 0 < above:
        raise NoSolution(f"{failure}; check thrust and resistance, or give both n and speed")
    last = 0
    for _ in range(200):
        if high - low <= 1e-12 * high:
            break
        at = (low * above - high * below) / (above - below)
        value = function(at)
        if value == 0 or not low < at < high:
            return at
        if value < 0:
            low, below, above = at, value, above / 2 if last < 0 else above
        else:
            high, above, below = at, value, below / 2 if last > 0 else below
        last = -1 if value < 0 else 1
    return high


def own_speed(ship: Ship, froude: float = FROUDE) -> float:
    """Approach speed of a ``ship`` where none is asked for [m/s]: her U_0, else that of a number ``froude``."""
    return ship.particulars.get("U_0", froude * reference_speed(ship.particulars["L"]))


def approach(ship: Ship, n: float | None, speed: float | None, at_rest: bool = False) -> tuple[float, float]:
    """(speed [m/s], n [1/s]) at the start of a manoeuvre; what is not given follows from the surge balance.

    ``at_rest``: the ship starts with speed 0 whatever n is. Raises UserError for numbers that make no approach.
    """
    u, revolutions = _approach(ship, n, speed, at_rest)
    froude = u / reference_speed(ship.particulars["L"])
    if abs(froude) > 1:
        raise OutOfRange(
            f"an approach at {u:g} m/s is Froude number {froude:.2g}, outside this model; give a lower speed or n"
        )
    return u, revolutions


def _approach(ship: Ship, n: float | None, speed: float | None, at_rest: bool) -> tuple[float, float]:
    for name, value in (("n", n), ("speed", speed)):
        if value is not None and not math.isfinite(value):
            raise OutOfRange(f"{name} = {value} is not a finite number")
    if not {"n", "n_azimuth"} & set(ship.actuators):
        if n is not None or at_rest:
            raise Missing(f"{ship.name} has no propeller in its model: give a speed, not n or a start at rest")
        return own_speed(ship) if speed is None else speed, 0.0
    if at_rest and n is not None:
        if speed is not None:
            raise Conflict("an acceleration starts from rest: give n or the speed to reach, not both")
        return 0.0, n
    if n is not None and speed is not None:
        return speed, n
    if n is not None:
        if n <= 0:
            raise OutOfRange(f"n = {n:g} rps gives no steady approach ahead; give a positive n, or a speed as well")
        return speed_for(ship, n), n
    if speed is not None and speed <= 0:
        raise OutOfRange(f"speed = {speed:g} m/s: the approach must be ahead; give n as well for anything else")
    wanted = own_speed(ship) if speed is None else speed
    return (0.0 if at_rest else wanted), revolutions_for(ship, wanted)

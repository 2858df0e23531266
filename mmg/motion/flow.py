"""What a force model sees and what it returns: the one signature that all of them share.

Every force is ``force(flow, p, c, s) -> Force`` with ``flow`` the motion through water and air and the
actuators, ``p`` the particulars, ``c`` the coefficients (both by attribute) and ``s`` the smoothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

# Names of the six states of a ship in the horizontal plane, in their fixed order: m, m, rad, m/s, m/s, rad/s; x north,
# y east, psi clockwise, velocities over ground.
STATES = ("x", "y", "psi", "u", "v", "r")

# Actuators that a force model may ask for: words and unit. They are columns of trial files and fields of Flow.
INPUTS = {
    "n": ("propeller revolutions (of the starboard one of two), positive ahead", "rps"),
    "n_2": ("revolutions of the port propeller of a twin-screw ship", "rps"),
    "pitch": ("blade angle of a controllable-pitch propeller", "rad"),
    "delta": ("rudder angle, positive turns to starboard", "rad"),
    "delta_port": ("angle of the port rudder of two, positive turns to starboard", "rad"),
    "delta_starboard": ("angle of the starboard rudder of two, positive turns to starboard", "rad"),
    "n_bow": ("revolutions of the bow thruster, positive pushes the bow to starboard", "rps"),
    "n_stern": ("revolutions of the stern thruster, positive pushes the stern to starboard", "rps"),
    "n_azimuth": ("revolutions of the azimuth thruster", "rps"),
    "azimuth": ("direction into which the azimuth thruster pushes, clockwise from ahead", "rad"),
    "n_azimuth_2": ("revolutions of the second azimuth thruster", "rps"),
    "azimuth_2": ("direction into which the second azimuth thruster pushes, clockwise from ahead", "rad"),
    "n_azimuth_3": ("revolutions of the third azimuth thruster", "rps"),
    "azimuth_3": ("direction into which the third azimuth thruster pushes, clockwise from ahead", "rad"),
    "n_azimuth_4": ("revolutions of the fourth azimuth thruster", "rps"),
    "azimuth_4": ("direction into which the fourth azimuth thruster pushes, clockwise from ahead", "rad"),
}

RUDDERS, PROPELLERS = ("delta", "delta_port", "delta_starboard"), ("n", "n_2")  # among them
PODS = 4  # Most azimuth thrusters of a ship. Set by hand: names of inputs are made for so many.


def pods(particulars: Mapping[str, float]) -> tuple[str, ...]:
    """Endings of particulars and inputs of the pods after the first, such as "_2". particulars: symbol -> SI value."""
    return tuple(f"_{i}" for i in range(2, PODS + 1) if f"x_az_{i}" in particulars)


@dataclass(frozen=True)
class Slipstream:
    """What the propeller leaves for the rudder.

    one_minus_w: 1 - w_P [-]; u_P: inflow speed u (1 - w_P) [m/s]; loading: n^2 D^2 K_T [m^2/s^2], with the
    open-water K_T ahead and the effective one (no thrust deduction) when reversed; ahead: weight of n >= 0; aft: 1
    where the propeller drives the water aft, -1 where forward, None where that is the sense of its revolutions.
    """

    one_minus_w: Any
    u_P: Any
    loading: Any
    ahead: Any
    aft: Any = None


@dataclass(frozen=True)
class Blade:
    """One rudder by itself: force [N, N, N m] with its effect on the hull, and the sine of its inflow angle.

    All of X, Y, N are proportional to its normal force; sin2_alpha is sin^2 of the angle of attack.
    """

    X: Any
    Y: Any
    N: Any
    sin2_alpha: Any


@dataclass(frozen=True)
class Force:
    """X, Y [N] and N [N m] about midship, body axes.

    A propeller adds its slipstream, a rudder model its single rudders, of which it is the sum.
    """

    X: Any = 0.0
    Y: Any = 0.0
    N: Any = 0.0
    slipstream: Slipstream | None = None
    blades: tuple[Blade, ...] = ()

    def __add__(self, other: Force) -> Force:
        # a sum has no slipstream and no blades: only the parts of a ship have
        return Force(self.X + other.X, self.Y + other.Y, self.N + other.N)


@dataclass(frozen=True)
class Flow:
    """Motion of the ship through water and air, and its actuators.

    u, v, r: velocity through the water at midship [m/s, m/s, rad/s]; a_x, a_y: velocity of the air relative to
    the ship, body axes [m/s]; slipstream: of the propeller ahead of the rudder, once it is known; x, y, psi, time:
    where the ship is, its heading and since when [m, m, rad, s]. All other fields are the actuators of INPUTS,
    1/s and rad.
    """

    u: Any
    v: Any
    r: Any
    n: Any = 0.0
    delta: Any = 0.0
    a_x: Any = 0.0
    a_y: Any = 0.0
    slipstream: Slipstream | None = None
    n_2: Any = 0.0
    pitch: Any = 0.0
    delta_port: Any = 0.0
    delta_starboard: Any = 0.0
    n_bow: Any = 0.0
    n_stern: Any = 0.0
    n_azimuth: Any = 0.0
    azimuth: Any = 0.0
    n_azimuth_2: Any = 0.0
    azimuth_2: Any = 0.0
    n_azimuth_3: Any = 0.0
    azimuth_3: Any = 0.0
    n_azimuth_4: Any = 0.0
    azimuth_4: Any = 0.0
    x: Any = 0.0
    y: Any = 0.0
    psi: Any = 0.0
    time: Any = 0.0

    def with_(self, **changes: Any) -> Flow:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def actuated(self, actuators: Iterable[str], position: Callable[[str, Any], Any]) -> Flow:
        """A copy with those of the actuators that the ship has at ``position(name, order)``; others are a plain 0.0."""
        present = {name: x for name in actuators if not isinstance(x := getattr(self, name), float)}
        return replace(self, **{name: position(name, x) for name, x in present.items()})

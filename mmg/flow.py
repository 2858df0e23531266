"""What a force model sees and what it returns: the one signature that all of them share.

Every force is ``force(flow, p, c, s) -> Force`` with ``flow`` the motion through water and air and the
actuators, ``p`` the particulars, ``c`` the coefficients (both by attribute) and ``s`` the smoothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Slipstream:
    """What the propeller leaves for the rudder.

    one_minus_w: 1 - w_P [-]; u_P: inflow speed u (1 - w_P) [m/s]; loading: n^2 D^2 K_T [m^2/s^2], with the
    open-water K_T ahead and the effective one (no thrust deduction) when reversed; ahead: weight of n >= 0.
    """

    one_minus_w: Any
    u_P: Any
    loading: Any
    ahead: Any


@dataclass(frozen=True)
class Force:
    """X, Y [N] and N [N m] about midship, body axes; a propeller adds its slipstream."""

    X: Any = 0.0
    Y: Any = 0.0
    N: Any = 0.0
    slipstream: Slipstream | None = None

    def __add__(self, other: Force) -> Force:
        return Force(self.X + other.X, self.Y + other.Y, self.N + other.N)


@dataclass(frozen=True)
class Flow:
    """Motion of the ship through water and air, and its actuators.

    u, v, r: velocity through the water at midship [m/s, m/s, rad/s]; n: propeller revolutions [1/s];
    delta: rudder angle, positive turns to starboard [rad]; a_x, a_y: velocity of the air relative to the
    ship, body axes [m/s]; slipstream: of the propeller ahead of the rudder, once it is known.
    """

    u: Any
    v: Any
    r: Any
    n: Any = 0.0
    delta: Any = 0.0
    a_x: Any = 0.0
    a_y: Any = 0.0
    slipstream: Slipstream | None = None

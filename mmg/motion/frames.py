"""Earth and body frames, true and apparent wind, drift angle.

Earth x0 north, y0 east, z down; heading psi clockwise from north; body x forward, y starboard, origin midship.
Functions work on floats, numpy arrays and CasADi expressions alike.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from mmg.motion.smooth import Smoothing


def _trigonometry(x: Any) -> Any:
    return ca if isinstance(x, (ca.SX, ca.MX, ca.DM)) else np


def earth_to_body(x0: Any, y0: Any, psi: Any) -> tuple[Any, Any]:
    """Components of an earth-fixed vector along body axes, heading ``psi`` [rad]. x0, y0: its north and east
    components."""
    f = _trigonometry(psi)
    cosine, sine = f.cos(psi), f.sin(psi)
    return cosine * x0 + sine * y0, cosine * y0 - sine * x0


def body_to_earth(x: Any, y: Any, psi: Any) -> tuple[Any, Any]:
    """North and east components of a body-fixed vector, heading ``psi`` [rad]. x, y: its body components."""
    f = _trigonometry(psi)
    cosine, sine = f.cos(psi), f.sin(psi)
    return cosine * x - sine * y, sine * x + cosine * y


def wind_vector(speed: Any, direction: Any) -> tuple[Any, Any]:
    """Velocity of the air over ground (north, east) [m/s] from speed and *coming-from* direction [rad]."""
    f = _trigonometry(direction)
    return -speed * f.cos(direction), -speed * f.sin(direction)


def relative_air(wind_north: Any, wind_east: Any, psi: Any, u: Any, v: Any) -> tuple[Any, Any]:
    """Velocity of the air relative to the ship at midship, body axes [m/s] (ground velocity u, v). wind_north,
    wind_east: air over ground [m/s]; psi: heading [rad]."""
    a_x, a_y = earth_to_body(wind_north, wind_east, psi)
    return a_x - u, a_y - v


def apparent_wind(wind_speed: Any, wind_direction: Any, psi: Any, u: Any, v: Any) -> tuple[Any, Any]:
    """Apparent wind speed [m/s] and direction [rad in 0..2 pi, clockwise from the bow, coming from].

    True wind as *coming from* in the earth frame, ground velocity (u, v) at midship.
    wind_speed [m/s], wind_direction [rad]; psi: heading [rad].
    """
    a_x, a_y = relative_air(*wind_vector(wind_speed, wind_direction), psi, u, v)
    return np.hypot(a_x, a_y), np.mod(np.arctan2(-a_y, -a_x), 2 * np.pi)  # minus: coming from


def true_wind(apparent_speed: Any, apparent_direction: Any, psi: Any, u: Any, v: Any) -> tuple[Any, Any]:
    """True wind speed [m/s] and coming-from direction [rad in 0..2 pi] from the apparent one. apparent_speed [m/s],
    apparent_direction and heading psi [rad]; u, v: over ground [m/s]."""
    a_x, a_y = wind_vector(apparent_speed, apparent_direction)  # in body axes, as its direction is from the bow
    north, east = body_to_earth(a_x + u, a_y + v, psi)
    return np.hypot(north, east), np.mod(np.arctan2(-east, -north), 2 * np.pi)


def drift_angle(u: Any, v: Any, s: Smoothing) -> Any:
    """beta = atan2(-v, |u|) [rad], between -90 and 90 degrees.

    Equal to the drift angle of MMG, atan2(-v, u), for u > 0. In sternway it is the acute angle between course
    and centre line, so that -v = U sin(beta) holds on either side of u = 0 (own continuation, not published).
    Smooth: |u| is held above the speed width, at u = 1 m/s of a 7 m model beta is 1e-4 of itself too small.
    """
    return ca.atan2(-v, s.magnitude(u, s.speed))  # its second argument is never 0: no jump and no slope without bound

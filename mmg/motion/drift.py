"""Drift angle: the direction from which the water comes, defined at rest and in sternway."""

from __future__ import annotations

from typing import Any

import casadi as ca

from mmg.motion.smooth import Smoothing


def drift_angle(u: Any, v: Any, s: Smoothing) -> Any:
    """beta = atan2(-v, |u|) [rad], between -90 and 90 degrees.

    Equal to the drift angle of MMG, atan2(-v, u), for u > 0. In sternway it is the acute angle between course
    and centre line, so that -v = U sin(beta) holds on either side of u = 0 (own continuation, not published).
    Smooth: |u| is held above the speed width, at u = 1 m/s of a 7 m model beta is 1e-4 of itself too small.
    """
    return ca.atan2(-v, s.magnitude(u, s.speed))

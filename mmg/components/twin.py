"""Two screws with a rudder behind each: one side is evaluated twice, the port side in the mirror.

At +- y_P from the centre plane the water comes with u - y r. The port propeller turns the other way, so its force
is that of a starboard one in mirrored motion (v, r, delta with the opposite sign), mirrored back. Each thrust has a
lever: N = -y X. (Standard reduction; no interaction between the sides.)
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from mmg.motion.flow import Blade, Flow, Force


def mirrored_flows(flow: Flow, p: SimpleNamespace) -> tuple[Flow, Flow]:
    """What the starboard side sees, and what the port side sees in the mirror; ``p.y_P`` > 0 [m]. flow: at midship."""
    starboard = flow.with_(u=flow.u - p.y_P * flow.r, delta=flow.delta_starboard)
    # its own u is u + y_P r: only after that the mirror turns the signs of v, r and delta
    port = flow.with_(u=flow.u + p.y_P * flow.r, v=-flow.v, r=-flow.r, n=flow.n_2, delta=-flow.delta_port)
    return starboard, port


def combined(starboard: Force, port: Force, p: SimpleNamespace) -> Force:
    """The sum of the two sides, the port one mirrored back, with the moments of their thrusts. starboard, port: forces;
    p: particulars."""
    starboard, port = _levered(starboard, p, 1), _levered(port, p, -1)
    return replace(starboard + port, blades=starboard.blades + port.blades)


def _levered(force: Force, p: SimpleNamespace, side: int) -> Force:
    # side 1: starboard, N - y_P X; -1: port, mirrored back, -(N - y_P X) = -N + y_P X
    blades = tuple(Blade(b.X, side * b.Y, side * (b.N - p.y_P * b.X), b.sin2_alpha) for b in force.blades)
    return Force(force.X, side * force.Y, side * (force.N - p.y_P * force.X), blades=blades)

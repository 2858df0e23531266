"""Satellite delay: logged position and velocity over ground are late; heading and turn rate are not.

Inside the model the delay is its all-pass approximation: with V_f the velocity over ground behind a low pass of tau/2,
the position is late by T V_f and the velocity by 2 T / tau (V - V_f). The late velocity, an earth-fixed vector, is
turned into u and v by the present heading. The synthetic generator delays the columns themselves. Where a log of the
ship's own measures u and v, the position alone is late; where u and v were finished before they were held up, they are
those of ``finished`` ago, turned by the heading of then.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from mmg.effects.effect import Columns, Effect, Parameter
from mmg.motion.flow import Flow
from mmg.motion.frames import body_to_earth, earth_to_body
from mmg.motion.froude import reference_speed, time_scale
from mmg.motion.memory import Memory, delayed


class GnssDelay(Effect):
    """Late satellite position and velocity."""

    name, enters = "gnss_delay", "measurement"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        size, most = 0.5 * time_scale(p.L), 5.0 * time_scale(p.L)
        alone, finished = "time by which the position alone is late", "time by which x, y, u and v are late as they are"
        return (
            Parameter("tau", 0.0, size, 0.0, most, "s", "time by which position and velocity are late"),
            Parameter("alone", 0.0, size, 0.0, most, "s", alone, held=True, form="alone"),
            Parameter("finished", 0.0, size, 0.0, most, "s", finished, held=True, form="finished"),
        )

    def columns(self, y: Columns, flow: Flow, memory: Memory, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        # time constant of the all-pass: sqrt(delay^2 + that of an explicit integrator ^2), as in ``delayed``
        least = ca.sqrt(e.tau**2 + (e.alone + e.finished) ** 2 + time_scale(p.L) ** 2)
        behind, (north, east) = less_low_pass(y, memory, self.name, 0.5 * least, p, y[2])
        u, v = (component - 2 * e.tau / least * part for component, part in zip(y[3:5], behind, strict=True))
        u, v = (
            delayed(memory, f"{self.name}.{axis}", value, e.finished, time_scale(p.L), 0.1 * reference_speed(p.L))
            for axis, value in (("u", u), ("v", v))
        )
        late = e.tau + e.alone + e.finished  # position - late * low-passed velocity is the all-pass of the position
        return [y[0] - late * north, y[1] - late * east, y[2], u, v, y[5]]

    def samples(self, t: np.ndarray, y: Columns, flow: Flow, e: SimpleNamespace, p: SimpleNamespace) -> Columns:
        place, (u, v) = late_samples(t, y, e.tau + e.alone + e.finished)[:2], late_samples(t, y, e.tau)[3:5]
        past = t - e.finished
        return [*place, y[2], np.interp(past, t, u), np.interp(past, t, v), y[5]]


def less_low_pass(
    y: Columns, memory: Memory, name: str, time: Any, p: SimpleNamespace, heading: Any
) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """u and v of columns y less what a low pass leaves of them, and that, in axes that point to ``heading`` [rad].

    time: constant of the low pass [s]; the axes in which it acts stand still where body axes turn by ``heading``, and
    turn with the ship where that is 0. memory, name: of its states; p: particulars.
    """
    velocity = body_to_earth(y[3], y[4], heading)
    north, east = (
        memory.low_pass(f"{name}.{axis}", value, time, 0.1 * reference_speed(p.L))
        for axis, value in zip(("north", "east"), velocity, strict=True)
    )
    return earth_to_body(velocity[0] - north, velocity[1] - east, heading), (north, east)


def late_samples(t: np.ndarray, y: Columns, delay: float) -> Columns:
    """Columns with position and earth-fixed velocity of ``delay`` [s] ago; before the first sample it ran straight. t
    (N,) [s]; y: columns, (N,) each."""
    if delay == 0:
        return y
    velocity = body_to_earth(y[3], y[4], y[2])
    past = t - delay
    before = np.minimum(past - t[0], 0.0)
    positions = [np.interp(past, t, place) + before * speed[0] for place, speed in zip(y[:2], velocity, strict=True)]
    late = earth_to_body(np.interp(past, t, velocity[0]), np.interp(past, t, velocity[1]), y[2])
    return [*positions, y[2], *late, y[5]]

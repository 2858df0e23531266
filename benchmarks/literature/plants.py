"""Mathematical models of the literature as plants: turning circles and zigzags of a ship given by its rates alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from cases.criteria.figures import turning_figures, zigzag_figures
from cases.trial import Trial

Rates = Callable[[np.ndarray, float, float], np.ndarray]
"""(state, rudder angle [rad, positive to starboard], revolutions [1/s]) -> rates of the state."""


@dataclass(frozen=True)
class Plant:
    """A ship in deep water.

    length [m]; speed: of the approach [m/s]; rudder_rate [rad/s]; rates: of the state x, y, psi, u, v, r and what
    follows (SI and rad); size: of the state; revolutions: range in which those of the approach are sought [1/s].
    """

    length: float
    speed: float
    rudder_rate: float
    rates: Rates
    size: int = 6
    revolutions: tuple[float, float] = (0.05, 5.0)

    def approach(self) -> tuple[np.ndarray, float]:
        """State (size,) on a straight course at the approach speed, and the revolutions [1/s] that hold it."""
        start = np.zeros(self.size)
        start[3] = self.speed
        return start, brentq(lambda n: self.rates(start, 0.0, n)[3], *self.revolutions)

    def run(self, rudder: float, heading: float = 0.0, crossings: float = 16.0) -> Trial:
        """A turning circle, or a zigzag with the switch ``heading`` [rad]; rudder [rad]: ordered at the first sample.

        crossings: duration by the time in which the ship runs her length.
        """
        start, n = self.approach()
        step = 0.01 * self.length / self.speed
        count = round(crossings / 0.01)
        states, angles = np.empty((count + 1, self.size)), np.empty(count + 1)
        z, delta, order = start, 0.0, rudder
        for k in range(count + 1):
            states[k], angles[k] = z, delta
            if heading and math.copysign(1.0, order) * z[2] >= heading:
                order = -order
            moved = delta + float(np.clip(order - delta, -self.rudder_rate * step, self.rudder_rate * step))
            half = 0.5 * (delta + moved)
            a = self.rates(z, delta, n)
            b = self.rates(z + 0.5 * step * a, half, n)
            c = self.rates(z + 0.5 * step * b, half, n)
            e = self.rates(z + step * c, moved, n)
            z, delta = z + step / 6 * (a + 2 * b + 2 * c + e), moved
        columns = dict(zip(("x", "y", "psi", "u", "v", "r"), states[:, :6].T, strict=True))
        t = step * np.arange(count + 1)
        return Trial("plant", {"t": t, **columns, "delta": angles, "n": np.full(len(t), n)})

    def figures(self, text: str) -> dict[str, float]:
        """Figures [SI and rad] of "turning:35", "zigzag:-10/10" and the like."""
        kind, _, angles = text.partition(":")
        rudder, _, heading = angles.partition("/")
        first = math.radians(float(rudder))
        if kind == "turning":
            crossings = 16.0 if abs(first) > 0.4 else 40.0
            return turning_figures(self.run(first, crossings=crossings), first, 0.0)
        switch = math.radians(float(heading))
        return zigzag_figures(self.run(first, switch, 40.0), first, switch, 0.0)

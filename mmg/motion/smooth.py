"""Switches, moduli and clips: exact for checking, smooth (C-infinity) for optimisation.

Every force is written once against the small interface below. ``Exact`` evaluates it with branches, as the
published models do; ``Smooth`` replaces each branch by a blend of stated width so that first and second
derivatives are finite everywhere, at rest too: sqrt(x^2 + eps^2) for |x|, tanh for a switch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from mmg.motion.froude import time_scale


@dataclass(frozen=True)
class Exact:
    """Branches as published: the reference against which the smooth model is tested."""

    speed: float = 1e-12  # [m/s] does not show; not 0, so that no root of a sum of squares with it is

    def absolute(self, x: Any, width: float) -> Any:
        """|x|, zero at zero."""
        return ca.fabs(x)

    def magnitude(self, x: Any, width: float) -> Any:
        """|x|, never zero: for use as the width of a blend."""
        return ca.fabs(x) + 1e-300

    def step(self, x: Any, width: Any) -> Any:
        """1 where x > 0, else 0."""
        return ca.if_else(x > 0, 1.0, 0.0)

    def step_or_zero(self, x: Any, width: Any) -> Any:
        """1 where x >= 0, else 0: for arguments that rest exactly at zero, such as a stopped propeller."""
        return ca.if_else(x >= 0, 1.0, 0.0)

    def sign(self, x: Any, width: float) -> Any:
        return ca.sign(x)

    def positive(self, x: Any, width: float) -> Any:
        """max(x, 0)."""
        return ca.fmax(x, 0.0)

    def root(self, x: Any, width: float) -> Any:
        """sqrt of a quantity that is never negative."""
        return ca.sqrt(x)

    def signed_root(self, x: Any, width: float) -> Any:
        """sgn(x) sqrt|x|."""
        return ca.sign(x) * ca.sqrt(ca.fabs(x))

    def divide(self, x: Any, positive: Any, width: float) -> Any:
        """x / positive, zero where the denominator is zero."""
        # CasADi evaluates both branches: without the fmax the other one would be no number
        return ca.if_else(positive > 0, x / ca.fmax(positive, 1e-300), 0.0)

    def angle(self, x: Any, y: Any, width: float) -> Any:
        """|atan2(y, x)| [rad]."""
        return ca.fabs(ca.atan2(y, x))


@dataclass(frozen=True)
class Smooth:
    """Blends with widths proportional to ``speed`` [m/s], 10 mm/s for a 3 m model (Froude scaled)."""

    speed: float = 0.01

    @classmethod
    def for_length(cls, length: float) -> Smooth:
        """Widths for a ship of this length [m]: 1.84e-3 sqrt(g L), which is 10 mm/s at L = 3 m."""
        return cls(0.01 * time_scale(length))

    def absolute(self, x: Any, width: float) -> Any:
        return x * x / ca.sqrt(x * x + width * width)  # exactly 0 at 0, as sqrt(x^2 + width^2) is not

    def magnitude(self, x: Any, width: float) -> Any:
        return ca.sqrt(x * x + width * width)

    def step(self, x: Any, width: Any) -> Any:
        return 0.5 * (1.0 + ca.tanh(x / width))

    def step_or_zero(self, x: Any, width: Any) -> Any:
        """As ``step``, moved by 1.5 widths so that x = 0 is already on the upper side (0.953)."""
        return 0.5 * (1.0 + ca.tanh(x / width + 1.5))

    def sign(self, x: Any, width: float) -> Any:
        return x / ca.sqrt(x * x + width * width)

    def positive(self, x: Any, width: float) -> Any:
        return 0.5 * (x + ca.sqrt(x * x + width * width))

    def root(self, x: Any, width: float) -> Any:
        return ca.sqrt(x + width * width)

    def signed_root(self, x: Any, width: float) -> Any:
        return x / ca.sqrt(ca.sqrt(x * x + width**4))  # width: of the root, so x is of the order of its square

    def divide(self, x: Any, positive: Any, width: float) -> Any:
        return x / ca.sqrt(positive * positive + width * width)

    def angle(self, x: Any, y: Any, width: float) -> Any:
        return ca.atan2(ca.sqrt(y * y + width * width), x)  # the first argument is never 0: smooth at rest and astern


Smoothing = Exact | Smooth

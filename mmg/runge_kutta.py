"""The classical Runge-Kutta method of fourth order (Kutta 1901): its coefficients, and one step of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# Stage i is evaluated after this fraction of the step, from the step's start and the rates of stage i - 1 (Kutta 1901).
NODES = (0.0, 0.5, 0.5, 1.0)
PARTS = (1, 2, 2, 1)  # The step follows the rates of its stages in these parts of their sum (Kutta 1901).
MIDDLE = 2  # The later of the two stages in the middle of a step: a place in NODES (Kutta 1901).
WEIGHTS = tuple(part / sum(PARTS) for part in PARTS)


def rk4_step(rates: Callable[[Any, float], Any], z: Any, h: Any) -> Any:
    """State after one step; z may be an array of numpy, an expression of CasADi or a tensor of torch.

    rates: function (state, fraction of the step: 0, 0.5 or 1) -> d state / dt; z: state (S, ...); h: step [s].
    Returns (S, ...) like z.
    """
    k1 = rates(z, 0.0)
    k2 = rates(z + 0.5 * h * k1, 0.5)
    k3 = rates(z + 0.5 * h * k2, 0.5)
    k4 = rates(z + h * k3, 1.0)
    return z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

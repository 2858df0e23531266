"""Numbers out of force models, for the tests of single models: exact or smooth, with derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from types import SimpleNamespace

import casadi as ca
import numpy as np

from cases.shipfiles.ship_file import load_ship
from mmg.components.catalogue import module
from mmg.components.coefficients import names
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smooth, Smoothing

MOTION = ("u", "v", "r", "n", "delta")
SCALE = np.array([1.0, 0.3, 0.1, 10.0, 0.4])
"""Size of u, v [m/s], r [rad/s], n [1/s], delta [rad] for a 7 m model."""


def particulars_and_coefficients(name: str, **changes: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """p and c of a library ship, some values replaced."""
    ship = load_ship(name)
    values = {symbol: c.value for symbol, c in ship.coefficients.items()}
    return names(dict(ship.particulars)), names({**values, **changes})


def defaults(role: str, name: str, p: SimpleNamespace) -> dict[str, float]:
    """Default coefficients of a force model."""
    model = module(role, name)
    rows = model.coefficients(p) if hasattr(model, "coefficients") else model.COEFFICIENTS
    return {row.symbol: row.value for row in rows}


def xyn(force: Force) -> np.ndarray:
    """X, Y, N as numbers (3,)."""
    return np.array([float(ca.DM(part)) for part in (force.X, force.Y, force.N)])


def number(value: object) -> float:
    return float(ca.DM(value))


def as_function(expression: Callable[[Flow], Force]) -> ca.Function:
    """(u, v, r, n, delta) -> force (3,), Jacobian (3, 5) and all second derivatives (15, 5)."""
    x = ca.SX.sym("x", 5)
    force = expression(Flow(**{name: x[i] for i, name in enumerate(MOTION)}))
    value = ca.vertcat(force.X, force.Y, force.N)
    first = ca.jacobian(value, x)
    return ca.Function("force", [x], [value, first, ca.jacobian(ca.vec(first), x)])


def grid_with_zeros() -> list[np.ndarray]:
    """All quadrants of u, v, r, n and delta with zeros, at full and at creeping size."""
    signs = itertools.product((-1.0, 0.0, 1.0), repeat=5)
    return [size * SCALE * np.array(sign) for sign in signs for size in (1.0, 1e-4)]


def assert_finite_everywhere(function: ca.Function) -> None:
    """Values, first and second derivatives are finite on the whole grid."""
    for x in grid_with_zeros():
        for part in function(x):
            assert np.isfinite(np.array(part)).all(), x


def assert_derivatives_are_right(function: ca.Function, seed: int, count: int = 40, tolerance: float = 1e-6) -> None:
    """First and second derivatives against central differences at random points, near rest for every third."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        size_of_motion = 1.0 if k % 3 else 0.01
        x = SCALE * rng.uniform(-1, 1, 5) * size_of_motion
        _, first, second = (np.array(part) for part in function(x))
        for j in range(5):
            step = np.zeros(5)
            step[j] = 1e-6 * SCALE[j] * size_of_motion**0.5
            ahead, behind = function(x + step), function(x - step)
            slope = np.array(ahead[0] - behind[0]).ravel() / (2 * step[j])
            largest = (np.abs(first) * SCALE).max(axis=1) / SCALE[j] + 1e-6
            assert (np.abs(slope - first[:, j]) <= tolerance * largest).all(), (x, j)
            bend = np.array(ca.vec(ahead[1] - behind[1])).ravel() / (2 * step[j])
            size = np.abs(second).max() + 1e-9
            assert (np.abs(bend - second[:, j]) <= 100 * tolerance * size).all(), (x, j)


def smooth(p: SimpleNamespace) -> Smoothing:
    """The smoothing that users run for a ship of this length."""
    return Smooth.for_length(p.L)

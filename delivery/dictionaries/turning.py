"""A turning circle of two models of one ship, so that a projection's error is also said in figures of manoeuvring."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from delivery.dictionaries.motions import RATE, Motions
from mmg.model import assemble
from mmg.motion.froude import time_scale
from mmg.runge_kutta import rk4_step

Rates = Callable[[np.ndarray, float, float], np.ndarray]
"""(u, v, r (3,), n [1/s], delta [rad]) -> their rates (3,)."""


def ship_rates(samples: Motions) -> Rates:
    """The rates of the ship of ``samples`` in calm air and water."""
    model = assemble(samples.ship, symbols=())
    columns = {name: model.controls.index(name) for name in ("n", "delta") if name in model.controls}
    controls, state = np.zeros(len(model.controls)), np.zeros(6)

    def rates(nu: np.ndarray, n: float, delta: float) -> np.ndarray:
        for name, value in (("n", n), ("delta", delta)):
            if name in columns:
                controls[columns[name]] = value
        state[3:] = nu
        return np.array(model.rates(state, controls, [])).ravel()[3:6]

    return rates


def turning_circle(samples: Motions, rates: Rates) -> dict[str, float] | None:
    """Advance and tactical diameter [m] of a turning circle with the largest rudder angle of the motions.

    samples: motions of the ship with the largest revolutions and speed of the approach; rates: of the model. None where
    the heading does not change by 180 deg in 60 ship lengths.
    """
    path = turning_path(samples, rates)
    x, y, psi = path[:, 0], path[:, 1], path[:, 2]
    if psi[-1] < math.pi:
        return None
    advance = float(np.interp(0.5 * math.pi, psi, x))
    return {"advance_m": advance, "tactical_diameter_m": float(np.interp(math.pi, psi, y))}


def turning_path(samples: Motions, rates: Rates, dt: float = 0.0) -> np.ndarray:
    """Rows x, y, psi, u, v, r, n, delta (N, 8) of that circle to starboard, every ``dt`` [s] (0: L / U / 40).

    samples, rates: as for ``turning_circle``. Ends when the heading has changed by 200 deg.
    """
    L, n, largest = samples.ship.particulars["L"], float(samples.n.max()), float(np.abs(samples.delta).max())
    straight = np.argmax(np.where(np.abs(samples.r) < 0.02 * np.abs(samples.r).max(), samples.u, 0.0))
    speed = float(samples.u[straight])
    dt = dt or L / speed / 40
    rate, z, delta = RATE / time_scale(L), np.array([0.0, 0.0, 0.0, speed, 0.0, 0.0]), 0.0
    rows = []

    def derivative(state: np.ndarray, _: float) -> np.ndarray:
        psi, u, v, r = state[2:]
        moving = [u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi), r]
        return np.concatenate([moving, rates(state[3:], n, delta)])

    for _ in range(round(60 * L / speed / dt)):
        rows.append([*z, n, delta])
        if not np.isfinite(z).all() or z[2] > math.radians(200):
            break
        delta = min(largest, delta + rate * dt)
        z = rk4_step(derivative, z, dt)
    return np.array(rows)


def compared(samples: Motions, rates: Rates) -> dict[str, object]:
    """The circle of the ship and of its projection, in ship lengths, as plain values. samples: motions of the ship;
    rates: of the projection."""
    L = samples.ship.particulars["L"]

    def lengths(circle: dict[str, float] | None) -> dict[str, float] | None:
        return None if circle is None else {f"{name[:-2]}_L": value / L for name, value in circle.items()}

    return {
        "rudder_deg": math.degrees(float(np.abs(samples.delta).max())),
        "n_rps": float(samples.n.max()),
        "ship": lengths(turning_circle(samples, ship_rates(samples))),
        "projection": lengths(turning_circle(samples, rates)),
    }


def in_words(circles: dict[str, object]) -> str:
    """The sentence on ``circles`` as ``compared`` returns them."""
    ship, projection = circles["ship"], circles["projection"]
    if not isinstance(ship, dict) or not isinstance(projection, dict):
        return "a turning circle does not come round with one of the two"
    words = [f"{name[:-2].replace('_', ' ')} {ship[name]:.2f} -> {projection[name]:.2f} L" for name in ship]
    return f"turning {circles['rudder_deg']:.0f} deg, ship -> projection: {', '.join(words)}"

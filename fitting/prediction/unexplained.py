"""Accelerations that no model explains, as a ship drawn from what the trials say has them in a manoeuvre.

Two parts. A lasting one belongs to the ship: her forces differ from the model's where the trials never were
(``novelty``). A passing one belongs to a single trial: gusts, waves, and all else that changes while it runs.
"""

from __future__ import annotations

import numpy as np

from cases.maneuvers.definitions import STOPS, Maneuver
from cases.simulation.pushed_batch import Push
from cases.simulation.simulate_batch import SimulatedRuns, input_array
from fitting.prediction.bands import Bands, acceleration_sizes
from fitting.prediction.novelty import HeldMotion
from mmg.ship import Ship

SLOW = 0.1
"""Share of the points of the trials whose speed is less than that below which a lasting acceleration falls with U^2."""
UNTRIED = 1 / 3
"""Standard deviation of the mean deceleration of a stop that no trial held, by that deceleration: an estimate of this
library for reversed propellers, about which trials ahead say nothing. Sway and yaw have no more than such a force."""
LEVER = 4.0
"""Yaw acceleration by that force over mass and length, at a quarter of the length: so is the radius of gyration."""
RESISTANCE = 0.1
"""Standard deviation of ``stopping_resistance`` by its value: form factor and allowance of ITTC 7.5-02-03-01.4 (2017)
are each known to some 5 to 10 % of the total."""


def accelerations(
    bands: Bands, ship: Ship, plan: Maneuver, nominal: SimulatedRuns, count: int, dt: float, seed: int
) -> Push:
    """Accelerations of ``count`` ships, then of as many single trials of them, in the manoeuvre ``plan``.

    bands: of the calibration of the ``ship``; nominal: the manoeuvre of the ship as she is; dt: sampling interval [s];
    seed: of the draws.
    """
    process, rng = bands.process, np.random.default_rng([22, seed])
    L, times = ship.particulars["L"], np.maximum(nominal.t, dt)[:, None]
    # along the ship's own track: where a draw's own motion gave the size, what pushes it would feed on itself
    size = np.sqrt(np.einsum("ck,kct->tc", process.size**2, _sizes_along(nominal, L)))
    size *= process.factor_at(times)[:, 3:, 0]
    own, slow = np.zeros_like(size), 0.0
    if bands.held is not None:
        inputs = input_array(ship, nominal.inputs, nominal.t)
        novelty = bands.held.novelty(nominal.states, inputs, L)
        own = size * novelty * bands.held.growth[3:]
        slow = slow_speed(bands.held)
        if plan.kind in STOPS:
            force = UNTRIED * mean_deceleration(nominal, plan.parameters["order_time"])
            own = np.minimum(own, [force, force, force * LEVER / L])
            own[:, 0] = force * np.minimum(novelty[:, 0], 1.0)
    lasting = np.tile(rng.standard_normal((3, count)), 2)
    left = np.exp(-dt / process.memory)[:, None]
    passing = np.zeros((3, 2 * count))
    passing[:, count:] = rng.standard_normal((3, count))

    def push(k: int, states: np.ndarray) -> np.ndarray:
        i = min(k, len(size) - 1)  # some draws take longer to stop than the ship as it is
        value = own[i][:, None] * fading(states, slow) * lasting + size[i][:, None] * passing
        fresh = rng.standard_normal((3, count)) * np.sqrt(1 - left**2)
        passing[:, count:] = left * passing[:, count:] + fresh
        return np.nan_to_num(value)

    return push


def _sizes_along(nominal: SimulatedRuns, length: float) -> np.ndarray:
    """``acceleration_sizes`` (3, 3, T) for u, v, r along the first of ``nominal``."""
    return acceleration_sizes(nominal.states, length)[:, :, 0][:, None].repeat(3, axis=1)


def slow_speed(held: HeldMotion) -> float:
    """Speed [m/s] that few rows of the trials fall below, from the points that cover what they ``held``."""
    return float(np.quantile(np.hypot(*(held.points * held.scale)[:, :2].T), SLOW))


def fading(states: np.ndarray, slow: float) -> np.ndarray:
    """Share (M,) of a lasting acceleration at ``states`` (6, M): forces of water on a ship vanish with U^2.

    slow: speed [m/s] from which on the trials say its size themselves.
    """
    if slow <= 0:
        return np.ones(states.shape[1])
    return np.minimum((states[3] ** 2 + states[4] ** 2) / slow**2, 1.0)


def mean_deceleration(nominal: SimulatedRuns, begin: float) -> float:
    """Mean deceleration [m/s^2] of a stop ordered at ``begin`` [s], to the end of the first of ``nominal`` or rest."""
    u = nominal.states[:, 3, 0]
    first = int(np.searchsorted(nominal.t, begin))
    rest = np.flatnonzero(u <= 0)
    last = max(int(rest[0]) if len(rest) else int(nominal.last[0]), first + 1)
    last = min(last, len(u) - 1)
    return float((u[min(first, last)] - max(u[last], 0.0)) / max(nominal.t[last] - nominal.t[first], 1e-9))


def drawn_resistance(
    ship: Ship, plan: Maneuver, drawn: dict[str, np.ndarray], count: int, seed: int
) -> dict[str, np.ndarray]:
    """Coefficients ``drawn``, symbol -> (count,), with the doubt about a ship's resistance in a stop, ``plan``.

    The factors of the plan (``stopping_resistance`` of the ``ship``) are estimates: each draw has its own. seed: of
    them.
    """
    if not plan.factors:
        return drawn
    draw = np.exp(RESISTANCE * np.random.default_rng([32, seed]).standard_normal(count))
    values = ship.coefficients
    return drawn | {symbol: drawn.get(symbol, np.full(count, values[symbol].value)) * draw for symbol in plan.factors}

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
"""Standard deviation of the deceleration in a stop that no trial held, by that deceleration: an estimate of this
library for reversed propellers, of which trials ahead say nothing. Sway and yaw have no more than such a force. Nor
have other manoeuvres a larger share of what accelerates the ship in them, however far from the trials they lie: ships
that no trial told anything of turn within about that share (``benchmarks.literature``)."""
MOST_SHARE = 0.9
"""Greatest error of a deceleration, by it: water and a reversed propeller do not drive a ship on."""
LEVER = 4.0
"""Yaw acceleration by that force over mass and length, at a quarter of the length: so is the radius of gyration."""
RESISTANCE = 0.1
"""Standard deviation of ``stopping_resistance`` by its value: form factor and allowance of ITTC 7.5-02-03-01.4 (2017)
are each known to some 5 to 10 % of the total."""


def accelerations(
    bands: Bands | None,
    ship: Ship,
    plan: Maneuver,
    nominal: SimulatedRuns,
    count: int,
    dt: float,
    seed: int,
    near: float = 1.0,
) -> Push:
    """Accelerations of ``count`` ships, then of as many single trials of them, in the manoeuvre ``plan``.

    bands: of the calibration of the ``ship``; None: no trial is known, so there are no single trials, and a stop alone
    has a lasting part; nominal: the manoeuvre of the ship as she is; dt: sampling interval [s]; seed: of the draws;
    near: share of the lasting part, that of a single trial is whole.
    """
    rng, copies = np.random.default_rng([22, seed]), 1 if bands is None else 2
    L, times = ship.particulars["L"], np.maximum(nominal.t, dt)[:, None]
    size, memory = np.zeros((len(nominal.t), 3)), np.ones(3)
    if bands is not None:
        # along the ship's own track: where a draw's own motion gave the size, what pushes it would feed on itself
        size = np.sqrt(np.einsum("ck,kt->tc", bands.process.size**2, acceleration_sizes(nominal.states, L)[:, :, 0]))
        size *= bands.process.factor_at(times)[:, 3:, 0]
        memory = bands.process.memory
    own, slow = np.zeros_like(size), 0.5 * float(np.abs(nominal.states[0, 3, 0]))
    tried = plan.kind not in STOPS
    novelty = np.full((len(size), 1), 0.0 if tried else 1.0)
    if bands is not None and bands.held is not None:
        novelty = bands.held.novelty(nominal.states, input_array(ship, nominal.inputs, nominal.t), L)
        own = size * novelty
        slow = slow_speed(bands.held)
    share = np.zeros(len(size))
    if tried:
        own = np.minimum(own, UNTRIED * greatest_accelerations(nominal))
    else:
        order = plan.parameters["order_time"]
        force = UNTRIED * mean_deceleration(nominal, order)
        own = np.minimum(own, [0.0, force, force * LEVER / L])
        share = UNTRIED * np.minimum(novelty[:, 0], 1.0) * (nominal.t > order)
    before: list[np.ndarray] = []
    lasting = near * np.tile(rng.standard_normal((3, count)), copies)
    left = np.exp(-dt / memory)[:, None]
    passing = np.zeros((3, copies * count))
    if copies == 2:
        passing[:, count:] = rng.standard_normal((3, count))

    def push(k: int, states: np.ndarray) -> np.ndarray:
        i = min(k, len(size) - 1)  # some draws take longer to stop than the ship as it is
        value = own[i][:, None] * fading(states, slow) * lasting + size[i][:, None] * passing
        if before:  # what the ship herself lost in the last step
            slowing = np.maximum(before[0] - states[3], 0.0) / dt
            value[0] += np.clip(share[i] * lasting[0], -MOST_SHARE, MOST_SHARE) * slowing
        before[:] = [states[3] + dt * value[0]]
        if copies == 2:
            fresh = rng.standard_normal((3, count)) * np.sqrt(1 - left**2)
            passing[:, count:] = left * passing[:, count:] + fresh
        return np.nan_to_num(value)

    return push


def greatest_accelerations(nominal: SimulatedRuns) -> np.ndarray:
    """Greatest accelerations (3,) by forces ahead or abeam [m/s^2], alike, and in yaw [rad/s^2], in the first of
    ``nominal``."""
    rows = slice(0, max(int(nominal.last[0]) + 1, 2))
    t, (u, v, r) = nominal.t[rows], nominal.states[rows, 3:, 0].T
    du, dv, dr = (np.gradient(x, t) for x in (u, v, r))
    force = float(np.hypot(du - v * r, dv + u * r).max())
    return np.array([force, force, float(np.abs(dr).max())])


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

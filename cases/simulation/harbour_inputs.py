"""Random use of every actuator of a ship in a harbour: each by itself, held for a while, moved at its own rate.

The random manoeuvres of Miyauchi et al. (2023), section 3.3, for any list of actuators. The result is a trial without
motion, for ``simulate_controls``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cases.maneuvers.definitions import Limits
from cases.trial import Trial
from mmg.components.expansion.series import REVOLUTIONS, speed_scale
from mmg.errors import BadValue, OutOfRange
from mmg.motion.flow import INPUTS, STATES
from mmg.motion.froude import time_scale
from mmg.ship import Ship

# Range of each angle [deg]: hard over of a rudder, all round of a pod.
RANGES = {
    "delta": (-35.0, 35.0), "delta_port": (-35.0, 35.0), "delta_starboard": (-35.0, 35.0),
    **{name: (-180.0, 180.0) for name in INPUTS if name.startswith("azimuth")},
}  # fmt: skip
# Range of two rudders behind one propeller [deg], which then never reverses (Miyauchi et al. 2023, Table 2).
VECTWIN = {"delta_port": (-105.0, 35.0), "delta_starboard": (-35.0, 105.0)}
# Range of revolutions, as shares of those of harbour speed; of pods and VecTwin propellers 0 to 1.
SHARES = {"n": (-0.6, 1.0), "n_2": (-0.6, 1.0), "n_bow": (-2.0, 2.0), "n_stern": (-2.0, 2.0)}
# Shortest and longest time [s of a 3 m model] for which an order stands, by unit of the actuator: as of "random".
HELD = {"rad": (4.0, 20.0), "rps": (10.0, 30.0)}
# Shortest and longest phase [s of a 3 m model] in which VecTwin rudders stay near midships, outward, or anywhere.
PHASES = (60.0, 180.0)  # set by hand


def ranges_of(ship: Ship) -> dict[str, tuple[float, float]]:
    """Range of each actuator of ``ship`` in a harbour, [1/s] or [rad]; blade angles are not among them."""
    names = [name for name in ship.actuators if name != "pitch"]
    vectwin = {"n", "delta_port", "delta_starboard"} <= set(names) and "n_2" not in names
    most = REVOLUTIONS * speed_scale(ship.particulars["L"]) / ship.particulars["L"]
    ranges = {}
    for name in names:
        if INPUTS[name][1] == "rad":
            low, high = (VECTWIN if vectwin and name in VECTWIN else RANGES)[name]
            ranges[name] = (math.radians(low), math.radians(high))
        else:
            low, high = (0.0, 1.0) if vectwin and name == "n" else SHARES.get(name, (0.0, 1.0))
            ranges[name] = (low * most, high * most)
    return ranges


def harbour_seed(text: str, seed: int) -> int | None:
    """Seed of the manoeuvre "harbour" or "harbour:SEED" in ``text``, by default ``seed``; None for any other manoeuvre.
    Raises UserError for a seed that is no whole number."""
    kind, colon, given = text.strip().partition(":")
    if kind != "harbour":
        return None
    if colon and not (given.isdecimal() and len(given) < 10):
        raise BadValue(f"manoeuvre '{text}': the seed must be a whole number, such as harbour:7")
    return int(given) if colon else seed


def harbour_inputs(
    ship: Ship,
    seconds: float | None,
    seed: int,
    dt: float | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Trial:
    """A trial in which every actuator of ``ship`` is used at random; its motion is rest at the origin.

    seconds: its length [s], None: 400 s of a 3 m model; seed: of the draws; dt: sampling interval [s], default 0.5 s of
    a 3 m model; ranges: replaces some of ``ranges_of``.
    The same for the same seed. Raises UserError for a duration that holds no sample.
    """
    L = ship.particulars["L"]
    dt = 0.5 * time_scale(L) if dt is None else dt
    seconds = 400.0 * time_scale(L) if seconds is None else seconds
    if not (math.isfinite(dt) and 0 < dt <= seconds and math.isfinite(seconds)):
        raise OutOfRange(f"random inputs of {seconds:g} s in steps of {dt:g} s: the step must be positive and fit in")
    t = np.round(dt * np.arange(math.floor(seconds / dt + 1e-9) + 1), 9)
    limits, columns = Limits.for_ship(ship), {"t": t}
    both = np.random.default_rng([17, seed])
    shortest, longest = (time_scale(L) * x for x in PHASES)
    changes = np.cumsum(both.uniform(shortest, longest, math.ceil(seconds / shortest) + 1))
    phase = both.integers(0, 3, len(changes) + 1)[np.searchsorted(changes, t, side="right")]  # of both rudders
    for number, (name, bounds) in enumerate((ranges_of(ship) | dict(ranges or {})).items()):
        rng = np.random.default_rng([17, seed, number])  # of its own: a further actuator leaves the others as they are
        unit = INPUTS[name][1]
        shortest, longest = (time_scale(L) * x for x in HELD[unit])
        times = np.cumsum(rng.uniform(shortest, longest, math.ceil(seconds / shortest) + 1))
        orders = rng.uniform(*bounds, len(times) + 1)[np.searchsorted(times, t, side="right")]
        if unit == "rad" and name in VECTWIN and max(map(abs, bounds)) > math.radians(90.0):
            orders = _in_phase(orders, bounds, phase)
        rate = limits.rudder_rate if unit == "rad" else limits.propeller_rate
        columns[name] = _followed(orders, rate * dt)
    zero = np.zeros(len(t))
    columns |= {name: zero for name in (*STATES, "n") if name not in columns}
    columns |= {} if {"delta", "delta_port"} & set(columns) else {"delta": zero}
    return Trial(f"harbour_{seed}", columns, kind="random", meta={"ship": ship.name, "seed": str(seed)})


def _in_phase(orders: np.ndarray, bounds: tuple[float, float], phase: np.ndarray) -> np.ndarray:
    """Orders (N,) of a VecTwin rudder: near midships in phase 1, outward in phase 2 so that the ship goes astern."""
    inside, outside = min(map(abs, bounds)), max(map(abs, bounds))
    side = 1.0 if bounds[1] == outside else -1.0
    within = (side * orders + inside) / (inside + outside)  # 0: hard inward, 1: hard outward
    astern = side * (outside - inside * within)
    return np.where(phase == 1, (2 * within - 1) * inside, np.where(phase == 2, astern, orders))


def _followed(orders: np.ndarray, most: float) -> np.ndarray:
    """Positions (N,) that follow orders (N,) by at most so much in a sample."""
    positions = np.empty_like(orders)
    position = orders[0]
    for k, order in enumerate(orders):
        position = positions[k] = position + min(max(order - position, -most), most)
    return positions

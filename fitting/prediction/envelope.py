"""The envelope of trials: the range of motion, actuators and air that they held, and what leaves it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cases.inputs import model_inputs
from cases.maneuvers.definitions import STOPS
from cases.simulation.simulate_batch import SimulatedRuns
from cases.trial import Trial
from mmg.model import assemble, states_behind
from mmg.ship import Ship

DRIFT = "beta"
"""Drift angle atan2(-v, u) [rad], beside the features of a ship."""
SLOW = 0.1
"""Below this share of the greatest speed ahead or astern a drift angle has no meaning."""
BEYOND = 0.05
"""Share of the range of the trials, and of its greatest value, by which a manoeuvre may leave it."""
ANGLE = math.radians(2.0)
"""Least excess of a rudder or drift angle that is said [rad]."""
DEGREES = math.degrees(1.0)
QUANTITIES = {
    "u": ("surge velocity", "m/s", 1.0),
    "v": ("sway velocity", "m/s", 1.0),
    "r": ("yaw rate", "deg/s", DEGREES),
    DRIFT: ("drift angle", "deg", DEGREES),
    "n": ("revolutions", "1/s", 1.0),
    "delta": ("rudder angle", "deg", DEGREES),
}
"""What is compared with the trials, in words, the unit in which it is said, and that unit's factor from SI and rad."""
FAR = 2.0
"""Yaw rate or drift angle over the greatest of the trials on that side, beyond which no trial came near: less than a
quarter of the nonlinear forces, which go with the square or more, acted in them."""
TITLES = {"turning": "a turn so tight", "zigzag": "a zigzag so wide", "spiral": "a spiral so wide",
          "pull-out": "a turn so tight"}  # fmt: skip
"""How a manoeuvre is called that no trial came near."""


def envelope_of(names: Sequence[str], features: np.ndarray) -> dict[str, list[float]]:
    """Least and greatest value of each row of ``features`` (F, M) by its name of ``names``, and of the drift angle."""
    if not features.size:
        return {}
    found = {name: [float(row.min()), float(row.max())] for name, row in zip(names, features, strict=True)}
    beta = _drift(*(features[list(names).index(axis)] for axis in "uv"))
    return found | ({DRIFT: [float(beta.min()), float(beta.max())]} if len(beta) else {})


def _drift(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Drift angles where the ship moves."""
    moving = np.hypot(u, v) > SLOW * np.abs(u).max()
    return np.arctan2(-v[moving], u[moving])


def trial_envelope(ship: Ship, trials: Sequence[Trial]) -> dict[str, list[float]]:
    """What ``envelope_of`` gives of the rows of ``trials`` in which everything is known.

    The features are those of ``ship``: velocities through the water, actuators behind their lags, air relative to the
    hull. Returns {} where no row is complete.
    """
    model, parts = assemble(ship.without_network()), []
    for trial in trials:
        logged, held = trial.states.T, model_inputs(trial, ship.inputs).array.T
        logged[:2] = np.where(np.isfinite(logged[:2]), logged[:2], 0.0)
        good = np.isfinite(logged).all(axis=0) & np.isfinite(held).all(axis=0)
        if good.any():
            states = states_behind(model, logged[:, good], held[:, good], ship.values)
            parts.append(model.at_points("features", states, held[:, good], ship.values))
    return envelope_of(ship.features, np.hstack(parts)) if parts else {}


def ranges_of(runs: SimulatedRuns) -> dict[str, tuple[float, float]]:
    """Least and greatest value of each of ``QUANTITIES`` in the first of ``runs``, SI and rad."""
    rows = slice(0, int(runs.last[0]) + 1)
    u, v, r = runs.states[rows, 3:, 0].T
    n, delta = np.asarray(runs.inputs[rows, :, 0]).T
    known = {"u": u, "v": v, "r": r, DRIFT: _drift(u, v), "n": n, "delta": delta}
    return {name: (float(known[name].min()), float(known[name].max())) for name in QUANTITIES if len(known[name])}


def outside_of(envelope: Mapping[str, Sequence[float]], runs: SimulatedRuns) -> tuple[str, ...]:
    """Which quantities of the first of ``runs`` leave the ranges of an ``envelope``, in words with the worst value."""
    found = []
    for name, (least, most) in ranges_of(runs).items():
        if name not in envelope:
            continue
        low, high = (float(x) for x in envelope[name])
        slack = max(BEYOND * max(high - low, abs(low), abs(high)), ANGLE if name in (DRIFT, "delta") else 0.0)
        words, unit, factor = QUANTITIES[name]
        for reached, limit, over in ((least, low, least < low - slack), (most, high, most > high + slack)):
            if over:
                found.append(f"{words} {factor * reached:.3g} {unit}, in the trials {factor * limit:.3g}")
    return tuple(found)


def outside_words(name: str, kind: str, outside: Sequence[str], widened: bool = True) -> str:
    """A sentence on a manoeuvre of this ``name`` and ``kind`` that leaves what the trials held.

    outside: how; widened: whether its intervals grow by that.
    """
    if why := untried(kind, outside):
        return f"{name}: {why} ({'; '.join(outside)})"
    effect = "so its intervals are wider" if widened else "which its intervals do not cover"
    return f"{name}: outside the trials, {effect}: {'; '.join(outside)}"


def untried(kind: str, outside: Sequence[str]) -> str:
    """Why the figures of a manoeuvre of this ``kind`` are the prior's alone, "" where trials have a say in them.

    outside: how it leaves the trials, as of ``outside_of``.
    """
    turns = [_numbers_in(words) for words in outside if words.startswith(QUANTITIES["n"][0])]
    if kind in STOPS and any(reached < limit for reached, limit in turns):
        return "stopping was not in the trials: these figures are the prior's"
    turning = [_numbers_in(words) for words in outside if words.startswith((QUANTITIES["r"][0], QUANTITIES[DRIFT][0]))]
    if kind not in STOPS and any(abs(reached) > FAR * abs(limit) for reached, limit in turning):
        return f"no trial came near {TITLES.get(kind, 'such a manoeuvre')}: these figures are the prior's"
    return ""


def _numbers_in(words: str) -> tuple[float, float]:
    """What a manoeuvre reaches and the trials held, as ``outside_of`` words them."""
    reached, _, held = words.partition(", ")
    return float(reached.split()[-2]), float(held.split()[-1])

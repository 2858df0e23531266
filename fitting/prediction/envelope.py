"""What trials held: the range of motion, actuators and air, and how new a motion is to them.

Motion is what the forces depend on: velocities through the ship's own axes, actuators, air relative to the hull. The
trials are remembered as a few points that cover their rows (farthest-first traversal, Gonzalez 1985, Theoret Comput
Sci 38 293-306). A row is as new as its distance to the nearest point exceeds the one at which nine tenths of the rows
of each trial lie from the points of the other trials. Bands grow with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.inputs import model_inputs
from cases.maneuvers.definitions import STOPS
from cases.trial import Trial
from fitting.nlp.windows import Record
from mmg.model import assemble, states_behind
from mmg.motion.flow import INPUTS
from mmg.motion.frames import relative_air
from mmg.ship import AIR, Ship

if TYPE_CHECKING:
    from cases.simulation.simulate_batch import SimulatedRuns

DRIFT = "beta"  # Drift angle atan2(-v, u) [rad], beside the features of a ship
SLOW = 0.1  # Below this share of the greatest speed ahead or astern a drift angle has no meaning. Set by hand.
# Share of the range of the trials, and of its greatest value, by which a manoeuvre may leave it.
BEYOND = 0.05  # set by hand: it decides what is said to be outside
# Least excess of a rudder or drift angle that is said [rad]. Set by hand: what is less is no news.
ANGLE = math.radians(2.0)
DEGREES = math.degrees(1.0)
# What is compared with the trials, in words, the unit in which it is said, and that unit's factor from SI and rad.
QUANTITIES = {
    "u": ("surge velocity", "m/s", 1.0),
    "v": ("sway velocity", "m/s", 1.0),
    "r": ("yaw rate", "deg/s", DEGREES),
    DRIFT: ("drift angle", "deg", DEGREES),
    "n": ("revolutions", "1/s", 1.0),
    "delta": ("rudder angle", "deg", DEGREES),
}
# Yaw rate, drift angle or revolutions astern over the greatest of the trials on that side, beyond which no trial came
# near: less than a quarter of the nonlinear forces, which go with the square or more, acted in them. Set by hand.
FAR = 2.0
# How a manoeuvre is called that no trial came near.
TITLES = {"turning": "a turn so tight", "zigzag": "a zigzag so wide", "spiral": "a spiral so wide",
          "pull-out": "a turn so tight"}  # fmt: skip
POINTS, ROWS = 150, 4000  # Points that are kept, and most rows from which they are taken. They bound time and memory.
# Share of the rows of a trial that is not new among the other trials. Set by hand; bands without novelty held .915 of
# the rows of R/V Gunnerus for .933 over 30 s, .918 for .938 over 100 s, and as much elsewhere.
ORDINARY = 0.9
MOST_NEW = 4.0  # Novelty beyond which a band grows no further: nothing that was measured says how. Set by hand.
# Least spread of a velocity or of revolutions by which a distance is measured, by its rms. It bounds a division.
ALIKE = 0.1
LEAST_ANGLE = 0.05  # The same of a rudder angle [rad]. Set by hand.


def envelope_of(names: Sequence[str], features: np.ndarray) -> dict[str, list[float]]:
    """Least and greatest value of each row of ``features`` (F, M) by its name of ``names``, and of the drift angle."""
    if not features.size:
        return {}
    rows = dict(zip(names, features, strict=True))
    u, v = rows["u"], rows["v"]
    moving = np.hypot(u, v) > SLOW * np.abs(u).max()
    rows[DRIFT] = np.arctan2(-v[moving], u[moving])  # MMG: positive where she drifts to port
    return {name: [float(row.min()), float(row.max())] for name, row in rows.items() if len(row)}


def trial_envelope(ship: Ship, trials: Sequence[Trial]) -> dict[str, list[float]]:
    """What ``envelope_of`` gives of the rows of ``trials`` in which everything is known.

    The features are those of ``ship``: velocities through the water, actuators behind their lags, air relative to the
    hull. Returns {} where no row is complete.
    """
    model, parts = assemble(ship.without_network()), []
    for trial in trials:
        logged, inputs = trial.states.T, model_inputs(trial, ship.inputs).array.T
        logged[:2] = np.where(np.isfinite(logged[:2]), logged[:2], 0.0)  # no feature is a place
        good = np.isfinite(logged).all(axis=0) & np.isfinite(inputs).all(axis=0)
        if good.any():
            states = states_behind(model, logged[:, good], inputs[:, good], ship.values)
            parts.append(model.at_points("features", states, inputs[:, good], ship.values))
    return envelope_of(ship.features, np.hstack(parts)) if parts else {}


# A quantity of QUANTITIES that leaves the trials: its name, what a manoeuvre reaches, and the limit of the trials [SI].
Excess = tuple[str, float, float]


def outside_of(envelope: Mapping[str, Sequence[float]], runs: SimulatedRuns) -> tuple[Excess, ...]:
    """Which quantities of the first of ``runs`` leave the ranges of an ``envelope``, with the worst value."""
    rows, excesses = slice(0, int(runs.last[0]) + 1), list[Excess]()
    features = np.hstack([runs.states[rows, 3:, 0], runs.inputs[rows, :, 0]]).T
    ranges = envelope_of(("u", "v", "r", "n", "delta"), features)
    for name in (name for name in QUANTITIES if name in ranges and name in envelope):
        least, most = ranges[name]
        low, high = (float(x) for x in envelope[name])
        # of its greatest value too: revolutions that all trials held are a range of width 0
        slack = max(BEYOND * max(high - low, abs(low), abs(high)), ANGLE if name in (DRIFT, "delta") else 0.0)
        excesses += [(name, least, low)] if least < low - slack else []
        excesses += [(name, most, high)] if most > high + slack else []
    return tuple(excesses)


def outside_words(name: str, kind: str, outside: Sequence[Excess], widened: bool = True) -> str:
    """A sentence on a manoeuvre of this ``name`` and ``kind`` that leaves what the trials held; outside: how; widened:
    whether its intervals grow by that."""
    parts = []
    for quantity, reached, limit in outside:
        words, unit, factor = QUANTITIES[quantity]
        parts.append(f"{words} {factor * reached:.3g} {unit}, in the trials {factor * limit:.3g}")
    if why := untried(kind, outside):
        return f"{name}: {why} ({'; '.join(parts)})"
    effect = "so its intervals are wider" if widened else "which its intervals do not cover"
    return f"{name}: outside the trials, {effect}: {'; '.join(parts)}"


def untried(kind: str, outside: Sequence[Excess]) -> str:
    """Why the figures of a manoeuvre of this ``kind`` are the prior's alone, "" where trials have a say in them;
    outside: how it leaves the trials."""
    if kind in STOPS:
        astern = any(name == "n" and reached < FAR * min(limit, 0.0) for name, reached, limit in outside)
        return "stopping was not in the trials: these figures are the prior's" if astern else ""
    if any(name in ("r", DRIFT) and abs(reached) > FAR * abs(limit) for name, reached, limit in outside):
        return f"no trial came near {TITLES.get(kind, 'such a manoeuvre')}: these figures are the prior's"
    return ""


def motion(states: np.ndarray, inputs: np.ndarray, names: Sequence[str], length: float) -> np.ndarray:
    """What forces depend on: u, v, r L, actuators, air in body axes relative to the hull, (..., F, M). states: (..., 6,
    M) logged; inputs: (..., C, M) with ``names`` (C,), as of ``Ship.inputs``; length: of the ship [m]."""
    psi, u, v, r = (states[..., i, :] for i in (2, 3, 4, 5))
    # r L is the velocity of bow and stern by turning: a length makes it comparable with u and v
    rows = [u, v, r * length, *(inputs[..., list(names).index(name), :] for name in _actuators(names))]
    north, east = (inputs[..., list(names).index(name), :] for name in AIR)
    return np.stack([*rows, *relative_air(north, east, psi, u, v)], axis=-2)


def _actuators(names: Sequence[str]) -> list[str]:
    """Those of the inputs ``names`` that move something."""
    return [name for name in names if name in INPUTS]


@dataclass(frozen=True)
class HeldMotion:
    """Points of the motion that trials held, and what novelty does to a band. names: inputs of the ship (C,); scale:
    (F,) by which motion is divided; points: (K, F) so scaled; reach: distance from which a row is new."""

    names: tuple[str, ...]
    scale: np.ndarray
    points: np.ndarray
    reach: float

    def novelty(self, states: np.ndarray, inputs: np.ndarray, length: float) -> np.ndarray:
        """Novelty (n, M) of predicted states (n, 6, M) under inputs (n, C, M), 0: as in the trials; length [m]."""
        rows = np.moveaxis(motion(states, inputs, self.names, length), -2, -1) / self.scale  # (n, M, F)
        far = nearest(np.nan_to_num(rows.reshape(-1, rows.shape[-1])), self.points).reshape(rows.shape[:-1])
        return np.clip(far / self.reach - 1, 0.0, MOST_NEW)


def met_so_far(times: np.ndarray, novelty: np.ndarray) -> np.ndarray:
    """Mean square over time of ``novelty`` (n, M) from the start to each of the times (n, M)."""
    step = np.diff(times, axis=0)
    grown = np.vstack([np.zeros(times.shape[1]), np.cumsum(step * novelty[1:] ** 2, axis=0)])
    return np.where(times > 0, grown / np.maximum(times, 1e-9), novelty[:1] ** 2)


def nearest(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of each of ``rows`` (n, F) to the nearest of ``points`` (K, F)."""
    # |x - p|^2 = |x|^2 + (|p|^2 - 2 x p): the bracket by one product of matrices, which is the large array (n, K)
    ends = np.column_stack([-2 * points, (points**2).sum(axis=1)])
    beyond = (np.column_stack([rows, np.ones(len(rows))]) @ ends.T).min(axis=1)
    return np.sqrt(np.maximum(beyond + (rows**2).sum(axis=1), 0.0))  # rounding of what coincides


def held_motion(records: Sequence[Record], names: Sequence[str], length: float) -> HeldMotion | None:
    """What ``records`` of trials held; None where they hold nothing. The halves of a single trial stand for two. names:
    inputs of the ship; length: of the ship [m]."""
    every = max(1, sum(len(r.t) for r in records) // ROWS)
    parts = []
    for record in records:
        good = np.flatnonzero(record.good)[::every]
        parts.append(motion(record.states[good].T, record.controls[good].T, names, length).T)
    parts = [part for part in parts if len(part)]
    if len(parts) == 1:
        parts = [part for part in np.array_split(parts[0], 2) if len(part)]
    if len(parts) < 2:
        return None
    rows = np.vstack(parts)
    speed = max(float(np.sqrt((rows[:, :2] ** 2).sum(axis=1).mean())), 1e-9)
    least = np.full(rows.shape[1], speed)  # of the scale of each feature; air: the ship's own speed
    least[:3] *= ALIKE  # u, v, r L
    for i, name in enumerate(_actuators(names), 3):
        rms = float(np.sqrt((rows[:, i] ** 2).mean()))
        least[i] = LEAST_ANGLE if name.startswith("delta") else max(ALIKE * rms, 1e-3)
    scale = np.maximum(rows.std(axis=0), least)
    parts, rows = [part / scale for part in parts], rows / scale
    far = [nearest(part, np.vstack([other for j, other in enumerate(parts) if j != i])) for i, part in enumerate(parts)]
    taken = [int(np.argmin(((rows - rows.mean(axis=0)) ** 2).sum(axis=1)))]  # the row in the middle
    distance = ((rows - rows[taken[0]]) ** 2).sum(axis=1)  # squared, to the nearest that is taken
    while len(taken) < min(POINTS, len(rows)) and distance.max() > 0:
        taken.append(int(distance.argmax()))  # the one farthest from those before it
        distance = np.minimum(distance, ((rows - rows[taken[-1]]) ** 2).sum(axis=1))
    points = rows[taken]
    # the points stand for all rows: half of the radius that each covers is added
    reach = float(np.quantile(np.concatenate(far), ORDINARY)) + float(nearest(rows, points).max()) / 2
    return HeldMotion(tuple(names), scale, points, max(reach, 1e-6))


def held_dict(held: HeldMotion) -> dict[str, Any]:
    """What trials ``held`` as plain values, which result.json has under "bands"."""
    return {
        "inputs": list(held.names),
        "scale": held.scale.tolist(),
        "points": np.round(held.points, 3).tolist(),
        "reach": held.reach,
    }


def held_of(content: Mapping[str, Any] | None, names: Sequence[str]) -> HeldMotion | None:
    """What ``held_dict`` made of it, ``content``, for a ship with inputs of these ``names``; None for anything else."""
    if content is None:
        return None
    try:
        scale, points = (np.asarray(content[key], dtype=np.float64) for key in ("scale", "points"))
        reach, inputs = float(content["reach"]), tuple(content["inputs"])
    except (KeyError, TypeError, ValueError):
        return None
    sound = points.ndim == 2 and len(points) and points.shape[1] == len(scale) and reach > 0
    return HeldMotion(inputs, scale, points, reach) if sound and inputs == tuple(names) else None

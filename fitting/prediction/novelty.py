"""How far a predicted motion is from what the trials of a calibration held, and how much wider a band is there.

Motion is what the forces depend on: velocities through the ship's own axes, actuators, air relative to the hull. The
trials are remembered as a few points that cover their rows (farthest-first traversal, Gonzalez 1985, Theoret Comput
Sci 38 293-306). A row is as new as its distance to the nearest point exceeds the one at which nine tenths of the rows
of each trial lie from the points of the other trials.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.prediction.stretches import Record, WindowBatch
from mmg.motion.flow import INPUTS
from mmg.ship import AIR

POINTS, ROWS = 150, 4000
"""Points that are kept, and most rows from which they are taken."""
ORDINARY = 0.9
"""Share of the rows of a trial that is not new among the other trials."""
MOST = 4.0
"""Novelty beyond which a band grows no further: nothing that was measured says how."""
ALIKE = 0.1
"""Least spread of a velocity or of revolutions by which a distance is measured, as a share of its rms."""
ANGLE = 0.05
"""The same of a rudder angle [rad]."""


def motion(states: np.ndarray, inputs: np.ndarray, names: Sequence[str], length: float) -> np.ndarray:
    """What forces depend on: u, v, r L, actuators, air in body axes relative to the hull, (..., F, M).

    states: (..., 6, M) logged; inputs: (..., C, M) with ``names`` (C,), as of ``Ship.inputs``; length: of the ship [m].
    """
    psi, u, v, r = (states[..., i, :] for i in (2, 3, 4, 5))
    rows = [u, v, r * length, *(inputs[..., list(names).index(name), :] for name in _actuators(names))]
    north, east = (inputs[..., list(names).index(name), :] for name in AIR)
    c, s = np.cos(psi), np.sin(psi)
    return np.stack([*rows, c * north + s * east - u, -s * north + c * east - v], axis=-2)


def _actuators(names: Sequence[str]) -> list[str]:
    """Those of the inputs ``names`` that move something."""
    return [name for name in names if name in INPUTS]


@dataclass(frozen=True)
class HeldMotion:
    """Points of the motion that trials held, and what novelty does to a band.

    names: inputs of the ship (C,); scale: (F,) by which motion is divided; points: (K, F) so scaled; reach: distance
    from which a row is new.
    """

    names: tuple[str, ...]
    scale: np.ndarray
    points: np.ndarray
    reach: float

    def novelty(self, states: np.ndarray, inputs: np.ndarray, length: float) -> np.ndarray:
        """Novelty (n, M) of predicted states (n, 6, M) under inputs (n, C, M), 0: as in the trials; length [m]."""
        rows = np.moveaxis(motion(states, inputs, self.names, length), -2, -1) / self.scale
        far = nearest(np.nan_to_num(rows.reshape(-1, rows.shape[-1])), self.points).reshape(rows.shape[:-1])
        return np.clip(far / self.reach - 1, 0.0, MOST)

    def widening(self, times: np.ndarray, states: np.ndarray, inputs: np.ndarray, length: float) -> np.ndarray:
        """Factor (n, 1, M) on the variance of the process at times (n, M) since the start, by the novelty met so far.

        states, inputs, length: as of ``novelty``.
        """
        met = met_so_far(times, self.novelty(states, inputs, length))
        return 1 + met[:, None]


def met_so_far(times: np.ndarray, novelty: np.ndarray) -> np.ndarray:
    """Mean square over time of ``novelty`` (n, M) from the start to each of the times (n, M)."""
    step = np.diff(times, axis=0)
    grown = np.vstack([np.zeros(times.shape[1]), np.cumsum(step * novelty[1:] ** 2, axis=0)])
    return np.where(times > 0, grown / np.maximum(times, 1e-9), novelty[:1] ** 2)


def nearest(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of each of ``rows`` (n, F) to the nearest of ``points`` (K, F)."""
    ends = np.column_stack([-2 * points, (points**2).sum(axis=1)])
    beyond = (np.column_stack([rows, np.ones(len(rows))]) @ ends.T).min(axis=1)  # one pass: the array is large
    return np.sqrt(np.maximum(beyond + (rows**2).sum(axis=1), 0.0))


def inputs_at(batch: WindowBatch, rows: np.ndarray) -> np.ndarray:
    """Inputs (n, C, M) that act at the ``rows`` (n,) of the windows of a ``batch``."""
    return batch.inputs[np.minimum(rows, len(batch.inputs) - 1)]


def held_motion(records: Sequence[Record], names: Sequence[str], length: float) -> HeldMotion | None:
    """What ``records`` of trials held; None where they hold nothing. The halves of a single trial stand for two.

    names: inputs of the ship; length: of the ship [m].
    """
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
    scale = np.maximum(rows.std(axis=0), _least(rows, names))
    parts = [part / scale for part in parts]
    far = [nearest(part, np.vstack([other for j, other in enumerate(parts) if j != i])) for i, part in enumerate(parts)]
    points = covering(rows / scale, POINTS)
    reach = float(np.quantile(np.concatenate(far), ORDINARY)) + float(nearest(rows / scale, points).max()) / 2
    return HeldMotion(tuple(names), scale, points, max(reach, 1e-6))


def _least(rows: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Least scale of each feature of ``rows`` (n, F)."""
    speed = max(float(np.sqrt((rows[:, :2] ** 2).sum(axis=1).mean())), 1e-9)
    found = [ALIKE * speed] * 3
    for i, name in enumerate(_actuators(names)):
        rms = float(np.sqrt((rows[:, 3 + i] ** 2).mean()))
        found.append(ANGLE if name.startswith("delta") else max(ALIKE * rms, 1e-3))
    return np.array(found + [speed] * (rows.shape[1] - len(found)))


def covering(rows: np.ndarray, count: int) -> np.ndarray:
    """Up to ``count`` of ``rows`` (n, F) that cover them: each is the one farthest from those before it."""
    taken = [int(np.argmin(((rows - rows.mean(axis=0)) ** 2).sum(axis=1)))]
    far = ((rows - rows[taken[0]]) ** 2).sum(axis=1)
    while len(taken) < min(count, len(rows)) and far.max() > 0:
        taken.append(int(far.argmax()))
        far = np.minimum(far, ((rows - rows[taken[-1]]) ** 2).sum(axis=1))
    return rows[taken]


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
        arrays = [np.asarray(content[key], dtype=np.float64) for key in ("scale", "points")]
        reach, inputs = float(content["reach"]), tuple(content["inputs"])
    except (KeyError, TypeError, ValueError):
        return None
    scale, points = arrays
    sound = points.ndim == 2 and len(points) and points.shape[1] == len(scale) and reach > 0
    return HeldMotion(inputs, scale, points, reach) if sound and inputs == tuple(names) else None

"""Stretches of trials simulated side by side from their measured first row, in still or in moving water."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.nlp.windows import Stretch
from mmg.model import INVERSIONS, columns, settled
from mmg.motion.frames import earth_to_body
from mmg.rollout import Simulator


@dataclass(frozen=True)
class FadingCurrent:
    """A uniform current over ground that decays: velocity (2, M) north and east [m/s] at the first row, decay [s]."""

    velocity: np.ndarray
    decay: float


@dataclass(frozen=True)
class WindowBatch:
    """Stretches as arrays: steps (N, M) [s], 0 where a stretch has ended; inputs (N, C, M); logged start (6, M).

    values: all coefficients (P, M) where records have their own, else None.
    """

    steps: np.ndarray
    inputs: np.ndarray
    logged: np.ndarray
    values: np.ndarray | None = None

    @classmethod
    def of(cls, stretches: Sequence[Stretch]) -> WindowBatch:
        """The ``stretches`` side by side, M of them over N steps. All of their records have values, or none has."""
        N = max(1, max(s.steps for s in stretches))
        steps = np.zeros((N, len(stretches)))
        inputs = np.zeros((N, stretches[0].record.controls.shape[1], len(stretches)))
        for i, s in enumerate(stretches):
            steps[: s.steps, i] = np.diff(s.t)
            inputs[: s.steps, :, i] = s.controls
            inputs[0, :, i] = s.record.controls[s.first]
        own = [s.record.values for s in stretches if s.record.values is not None]
        logged = np.array([s.record.states[s.first] for s in stretches]).T
        return cls(steps, inputs, logged, np.array(own).T if own else None)

    def between(self, rows: np.ndarray) -> WindowBatch:
        """The same stretches in steps from each of ``rows`` (n,) to the next, with the means of their inputs; the first
        and the last row are among them."""
        begins = rows[:-1]
        steps = np.add.reduceat(self.steps, begins, axis=0)
        weighted = np.add.reduceat(self.inputs * self.steps[:, None], begins, axis=0)
        whole = steps[:, None] > 0
        inputs = np.where(whole, weighted / np.where(whole, steps[:, None], 1.0), self.inputs[begins])
        return WindowBatch(steps, inputs, self.logged, self.values)

    def times_over(self, count: int) -> WindowBatch:
        """The same stretches ``count`` times side by side."""
        values = None if self.values is None else np.tile(self.values, count)
        return WindowBatch(np.tile(self.steps, count), np.tile(self.inputs, count), np.tile(self.logged, count), values)

    @property
    def times(self) -> np.ndarray:
        """Seconds since the first row, (N + 1, M)."""
        return np.vstack([np.zeros(self.steps.shape[1]), np.cumsum(self.steps, axis=0)])


def rollout(
    simulator: Simulator,
    batch: WindowBatch,
    water: FadingCurrent | None = None,
    offset: np.ndarray | None = None,
    method: str = "rk4",
) -> tuple[np.ndarray, np.ndarray]:
    """Logged columns (N + 1, 6, M) and states (N + 1, S, M) of a ``batch``, from its logged start, by ``simulator``.

    water: computed in the frame that moves with it: velocities and air are relative to it, the way it has gone is added
    to the positions, and its decay accelerates nothing (relative-velocity formulation, Fossen 2021). Forces that
    depend on the place (bank, shelf) see the position without that way, a few decimetres. offset: (S - 6, M) what the
    remembered states start from beyond their settled values; method: "rk4" or "euler".
    """
    inputs, logged = batch.inputs, batch.logged
    if water is not None:
        fade = np.exp(-batch.times / water.decay)[:, None]
        drift, way = water.velocity * fade, water.velocity * water.decay * (1 - fade)
        inputs, logged = inputs.copy(), logged.copy()
        air = simulator.model.controls.index("wind_north")
        inputs[:, air : air + 2] -= drift[:-1]
        logged[3:5] -= earth_to_body(drift[0, 0], drift[0, 1], logged[2])
    start = _started(simulator, logged, inputs[0], offset, batch.values)
    states = simulator.run(start, inputs, batch.steps, batch.values, method)
    out = np.array(simulator.columns(states, batch.values))
    if water is not None:
        out[:, :2] += way
        out[:, 3:5] += np.stack(earth_to_body(drift[:, 0], drift[:, 1], out[:, 2]), axis=1)
    return out, states


def wrapped_error(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """``predicted`` minus ``measured``, both (N, 6), the heading error wrapped into (-pi, pi]."""
    error = predicted - measured
    error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
    return error


def _started(
    simulator: Simulator,
    logged: np.ndarray,
    controls: np.ndarray,
    offset: np.ndarray | None,
    own: np.ndarray | None,
) -> np.ndarray:
    """States (S, M) logged as (6, M), their memory settled or beyond that by ``offset``; own: coefficients (P, M)."""
    if offset is None or len(simulator.model.states) == 6:
        return simulator.start(logged, controls, own)
    model, values = simulator.model, simulator.ship.values if own is None else own
    six = np.array(logged)
    for _ in range(INVERSIONS):
        start = settled(model, six, controls, values)
        start[6:] += offset
        error = columns(model, start, values) - logged
        six -= error
        if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
            break
    return start

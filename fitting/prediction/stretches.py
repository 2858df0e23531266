"""Stretches of trials simulated side by side from their measured first row, in still or in moving water.

The seconds before a window are cut into short restarts from the measured state. Their errors, younger ones counting
more, are explained by a current with a Gaussian prior: one Gauss-Newton step, all windows and both directions in one
batch. In the forecast the current decays. (A Kalman filter with latent accelerations of two memories and a current, its
sizes chosen on the same records, was no better.) States of lags and filters start at their values at the end of the
last restart, relative to settled. Rows from a window's start on are never read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.inputs import model_inputs
from cases.trial import Trial
from fitting.nlp.windows import Record, Stretch
from mmg.model import CLOSE, INVERSIONS, columns, settled
from mmg.motion.frames import earth_to_body
from mmg.motion.froude import state_scale, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship


@dataclass(frozen=True)
class FadingCurrent:
    """A uniform current over ground that decays: velocity (2, M) north and east [m/s] at the first row, decay [s]."""

    velocity: np.ndarray
    decay: float


@dataclass(frozen=True)
class WindowBatch:
    """Stretches as arrays: steps (N, M) [s], 0 where a stretch has ended; inputs (N, C, M); logged start (6, M).
    values: all coefficients (P, M) where records have their own, else None."""

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
            inputs[0, :, i] = s.record.controls[s.first]  # a stretch without a step needs inputs for its start too
        values = [s.record.values for s in stretches if s.record.values is not None]
        logged = np.array([s.record.states[s.first] for s in stretches]).T  # (6, M)
        return cls(steps, inputs, logged, np.array(values).T if values else None)

    def between(self, rows: np.ndarray) -> WindowBatch:
        """The same stretches in steps from each of ``rows`` (n,) to the next, with the means of their inputs; the first
        and the last row are among them."""
        begins = rows[:-1]
        steps = np.add.reduceat(self.steps, begins, axis=0)
        weighted = np.add.reduceat(self.inputs * self.steps[:, None], begins, axis=0)
        lasts = steps[:, None] > 0  # steps of length 0 lie behind the end of a stretch: no mean to divide for
        inputs = np.where(lasts, weighted / np.where(lasts, steps[:, None], 1.0), self.inputs[begins])
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
        fade = np.exp(-batch.times / water.decay)[:, None]  # (N + 1, 1, M)
        drift, way = water.velocity * fade, water.velocity * water.decay * (1 - fade)  # way: integral of drift
        inputs, logged = inputs.copy(), logged.copy()
        air = simulator.model.controls.index("wind_north")  # wind_east follows it (mmg.ship.AIR)
        inputs[:, air : air + 2] -= drift[:-1]  # air over ground -> air over the water
        logged[3:5] -= earth_to_body(drift[0, 0], drift[0, 1], logged[2])
    if offset is None or len(simulator.model.states) == 6:
        start = simulator.start(logged, inputs[0], batch.values)
    else:  # as mmg.model.states_behind: a lagged sensor shows its memory, so the motion behind it is iterated for
        model, theta = simulator.model, simulator.ship.values if batch.values is None else batch.values
        six = np.array(logged)
        for _ in range(INVERSIONS):
            start = settled(model, six, inputs[0], theta)
            start[6:] += offset
            error = columns(model, start, theta) - logged
            six -= error
            if not np.nanmax(np.abs(error), initial=0.0) > CLOSE:
                break
    states = simulator.run(start, inputs, batch.steps, batch.values, method)
    out = np.array(simulator.columns(states, batch.values))
    if water is not None:  # back over ground
        out[:, :2] += way
        out[:, 3:5] += np.stack(earth_to_body(drift[:, 0], drift[:, 1], out[:, 2]), axis=1)
    return out, states


def record_of(trial: Trial, inputs: Sequence[str], values: np.ndarray | None = None) -> Record:
    """A ``trial`` as windows need it, for a model with these ``inputs``; x = y = 0 where no positions were measured.
    values: all coefficients (P,) of the ship in this trial, where they are not the simulator's."""
    states, controls = trial.states, model_inputs(trial, inputs).array
    if not trial.has_position:
        states = states.copy()
        states[:, :2] = 0.0
    good = np.isfinite(states).all(axis=1) & np.isfinite(controls).all(axis=1)
    return Record(trial.t, states, controls, good, trial.has_position, values)


def window_rows(t: np.ndarray, length: float, stride: float, short_last: bool) -> list[tuple[int, int]]:
    """First and last row of windows of ``length`` seconds every ``stride`` seconds from the first of the times t (N,).
    ``length`` 0 is the whole run. ``short_last`` keeps a last window that the run's end cuts short."""
    if length <= 0:
        return [(0, len(t) - 1)]
    tolerance = 0.5 * float(np.median(np.diff(t)))
    result = []
    start = t[0]
    while start < t[-1] - tolerance:
        first = int(np.searchsorted(t, start - tolerance))
        last = int(np.searchsorted(t, t[first] + length + tolerance)) - 1
        is_whole = t[min(last, len(t) - 1)] >= t[first] + length - 2 * tolerance
        if last > first and (is_whole or short_last):
            result.append((first, min(last, len(t) - 1)))
        start += max(stride, 2 * tolerance)  # no two windows begin at one sample, and 1e-9 s do not take for ever
    return result


def measured_columns(stretches: Sequence[Stretch]) -> np.ndarray:
    """Logged columns (N + 1, 6, M) of ``stretches``, NaN where they were not measured or have ended."""
    measured = np.full((max(1, max(s.steps for s in stretches)) + 1, 6, len(stretches)), np.nan)
    for i, stretch in enumerate(stretches):
        measured[: stretch.steps + 1, :, i] = stretch.logged
        if not stretch.record.has_position:
            measured[:, :2, i] = np.nan
    return measured


def wrapped_error(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """``predicted`` minus ``measured``, both (N, 6, ...), the heading error wrapped into (-pi, pi]."""
    error = predicted - measured
    error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
    return error


# Seconds: length of a restart, time in which an error's weight falls to 1/e^2, decay time of the current. From half to
# twice of each nothing is better by more than its error (22 records; benchmarks/RESULTS.md of 5f878e7).
RESTART, FORGET, DECAY = 8.0, 15.0, 120.0
# Prior standard deviation of the current [m/s]; .01 and .03 are 1 to 2 % worse (as above). So it was measured.
SIZE = 0.02
# Typical error of x, y [m], psi [rad], u, v [m/s], r [rad/s] over a restart: what of it a current explains counts
# against these. Set by hand with SIZE, which they act through.
ERRORS = (0.06, 0.04, 0.017, 0.011, 0.0066, 0.003)
AT_ONCE = 256  # Windows adapted in one batch, which bounds the memory it takes
# Sensitivity of a state to a current [SI] over the seconds of a restart, beyond which the rollout has diverged: a
# current moves a position by its own way, at most a few times. Set by hand.
DIVERGED = 1e3
ROBUST = 3.0  # Errors count less beyond so many of these (Huber). Set by hand.
# Seconds of past of a 3 m model that are used by default; 60 s are no better (as above). So it was measured.
PAST = 30.0


def past_begin(record: Record, row: int, seconds: float) -> int:
    """First row of the unbroken, measured stretch of at most ``seconds`` before ``row`` of a ``record``. ``row`` itself
    if there is none."""
    t = record.t
    gap = 2.5 * float(np.median(np.diff(t)))  # one sample may be missing
    first = int(np.searchsorted(t, t[row] - seconds - 0.2 * gap))  # with half a sample of tolerance
    broken = ~record.good[first : row + 1]
    broken[:-1] |= np.diff(t[first : row + 1]) > gap
    breaks = np.flatnonzero(broken)
    return min(row, first + int(breaks[-1]) + 1) if len(breaks) else first


def restarts(record: Record, row: int, seconds: float, restart: float) -> list[Stretch]:
    """The ``seconds`` before a window that starts at ``row`` of a ``record``, in pieces of ``restart`` [s], youngest
    first; none but the youngest under half length."""
    begin, sample = past_begin(record, row, seconds), float(np.median(np.diff(record.t)))
    result: list[Stretch] = []
    last = row  # backwards: what is left over lies at the old end
    while last > begin:
        first = max(begin, int(np.searchsorted(record.t, record.t[last] - restart - 0.5 * sample)))
        if first == last or (result and record.t[last] - record.t[first] < 0.5 * restart):
            break
        result.append(Stretch(record, first, last))
        last = first
    return result


def adapt(simulator: Simulator, windows: Sequence[Stretch], seconds: float) -> tuple[FadingCurrent, np.ndarray]:
    """Current at the start of each of ``windows`` (M of them), fading, and offsets (S - 6, M) from the settled memory,
    by so many ``seconds`` before it; both are zero for a window without a past. simulator: of the ship."""
    parts = [_adapt(simulator, windows[i : i + AT_ONCE], seconds) for i in range(0, len(windows), AT_ONCE)]
    decay = DECAY * time_scale(simulator.ship.particulars["L"])
    return FadingCurrent(np.hstack([w for w, _ in parts]), decay), np.hstack([o for _, o in parts])


def _adapt(simulator: Simulator, windows: Sequence[Stretch], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Currents (2, M) and offsets (S - 6, M) of some windows, by constants that scale with Froude's law."""
    k = time_scale(simulator.ship.particulars["L"])
    size, errors = SIZE * k, np.array(ERRORS) * state_scale(simulator.ship.particulars["L"])
    M = len(windows)
    offset = np.zeros((len(simulator.model.states) - 6, M))
    pasts = [restarts(w.record, w.first, seconds, RESTART * k) for w in windows]
    pieces = [piece for past in pasts for piece in past]
    owner = [(i, j == 0) for i, past in enumerate(pasts) for j in range(len(past))]
    if not pieces:
        return np.zeros((2, M)), offset
    batch, K = WindowBatch.of(pieces), len(pieces)
    probed = batch.times_over(3)
    probe = np.zeros((2, 3, K))  # no current, north, east: differences of these are the sensitivities
    probe[0, 1] = probe[1, 2] = 0.5 * size
    # within a restart the current hardly decays: its age is counted in the weights
    out, states = rollout(simulator, probed, FadingCurrent(probe.reshape(2, -1), 1e3 * DECAY * k))
    information, gradient = np.zeros((M, 2, 2)), np.zeros((M, 2))  # normal equations of each window
    for number, (piece, (i, youngest)) in enumerate(zip(pieces, owner, strict=True)):
        now = float(piece.record.t[windows[i].first])
        found = out[:, :, [number, K + number, 2 * K + number]]
        J, error, weight = _equations(found, piece, now, 0.5 * size, k, errors)
        information[i] += np.einsum("ans,ns,bns->ab", J, weight, J)
        gradient[i] -= np.einsum("ans,ns,ns->a", J, weight, error)
        if youngest and len(offset):
            end = states[piece.steps, :, number : number + 1]  # (S, 1), of the run without a current
            here = piece.record.controls[piece.last][:, None]
            values = simulator.ship.values if piece.record.values is None else piece.record.values
            beyond = (end - settled(simulator.model, end[:6], here, values))[6:, 0]
            offset[:, i] = beyond if np.isfinite(beyond).all() else 0.0
    # one Gauss-Newton step: the prior N(0, size^2) of both components adds 1 / size^2 to the diagonal
    return np.linalg.solve(information + np.eye(2) / size**2, gradient[..., None])[..., 0].T, offset


def _equations(
    out: np.ndarray, piece: Stretch, now: float, probe: float, k: float, errors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sensitivities (2, n, 6), errors (n, 6) and weights (n, 6) of one restart at about ten of its rows.

    out: (rows, 6, 3) without and with a probing current, ``probe`` [m/s], in either direction; now: when the window
    starts [s]; k: scale of times; errors: (6,) typical ones. The rows of a restart of full length
    together count as one observation of each state.
    """
    rows, t, restart = piece.steps, piece.t, RESTART * k
    every = max(1, round(0.1 * restart * rows / max(float(t[-1] - t[0]), 1e-9)))
    at = np.arange(rows, 0, -every)[::-1]  # the last row always, the first never: its error is zero
    error = wrapped_error(out[at, :, 0], piece.logged[at])
    J = np.moveaxis(out[at, :, 1:] - out[at, :, :1], 2, 0) / probe
    age = now - t[at]
    share = every * (t[-1] - t[0]) / rows / restart  # errors of neighbouring rows are alike, so the rows share one
    relative = np.abs(error) / errors
    # Huber (1964): weight 1 up to ROBUST, beyond it ROBUST / relative
    weight = share * np.exp(-2 * age / (FORGET * k))[:, None] * ROBUST / np.maximum(relative, ROBUST)
    weight = weight / errors**2
    usable = np.isfinite(error) & (np.abs(J) < DIVERGED * restart).all(axis=0)
    usable[:, :2] &= piece.record.has_position
    return np.where(usable, J, 0.0), np.where(usable, error, 0.0), np.where(usable, weight, 0.0)


def default_past(ship: Ship) -> float:
    """Seconds of past that are used by default for a ``ship``, by Froude's law, whole ones."""
    return float(max(1.0, round(PAST * time_scale(ship.particulars["L"]))))

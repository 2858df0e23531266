"""Kinematic consistency: do the logged position, heading, u, v and r follow from one another?

Over windows of some seconds the displacement of the position P = x + i y is compared with the integral of w = u + i v
turned by the heading, and the change of the heading with the integral of r, both sides smoothed alike. What differs is
regressed on what sensors do wrong, with robust weights::

    dP = int e^(i psi(t)) w(t + lag) dt (gains, heading offset) - biases + drift + arm (e^(i psi) end - start)
    d psi = (int r dt + T dr) / (1 + share) - bias

Few faults explain the data (kinematic_fit.py); rivals that would do nearly as well are named beside them. All times
and sizes are those of a 3 m model; others follow by Froude's law.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from cases.evidence.kinematic_fit import SIGMAS, Fit, Rows, fit
from cases.evidence.kinematic_words import LAG, TRACK, TURN, UNSEEN, Quantity, Reading, pooled_with, reading
from cases.trial import Trial
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.ship import Ship

SMOOTHING = 1.1
"""s; moving average over the measured and the derived velocities (at least 5 samples): below it the
differentiated satellite position is noise."""
WINDOW, STRIDE, BLOCK = 8.0, 2.0, 30.0
"""s: length of a window, distance of windows, and block that a jackknife leaves out (a twelfth of a short run)."""
CORRELATION = 0.9
"""A displacement or turn that correlates less with the integral of the velocities is a fault of the data."""
MOVED, TURNED = 0.3, 0.03
"""m and rad, RMS over the windows: a run that moves or turns less says nothing about it."""
FRAMES = ("earth", "body")
FAULT = 0.5 * SIGMAS**2
"""Gain in log likelihood that a further fault must bring, or axes of the lag that are not those of the earth."""


@dataclass(frozen=True)
class Consistency:
    """Readings of a run, or of all that are no fault of the data.

    frame: axes of the lag: "earth" (a late velocity over ground, turned by the present heading) or, where that is
    clearly likelier, "body" (u and v each late or behind a low pass, which windows cannot tell apart). track, turn:
    correlation of displacements and of changes of heading with the integrals of the velocities, NaN when there is
    nothing to correlate. faults: sentences on what makes the data unusable.
    """

    name: str
    readings: tuple[Reading, ...]
    frame: str
    track: float
    turn: float
    faults: tuple[str, ...] = ()

    def __getitem__(self, symbol: str) -> Reading:
        return next(reading for reading in self.readings if reading.symbol == symbol)


@dataclass(frozen=True)
class Kinematics:
    """All runs, each by itself and pooled; warnings: faults of data, what could not be checked, what cannot be seen."""

    runs: tuple[Consistency, ...]
    pooled: Consistency
    warnings: tuple[str, ...]

    @property
    def found(self) -> tuple[Reading, ...]:
        """Pooled readings to report: found, or found in some runs."""
        return tuple(r for r in self.pooled.readings if r.verdict in ("found", "some runs"))

    def effects(self) -> dict[str, dict[str, tuple[float, float]]]:
        """effect -> parameter -> (value, std) of found faults that an effect of the library repeats exactly."""
        named: dict[str, dict[str, tuple[float, float]]] = {}
        for r in self.pooled.readings:
            if r.verdict == "found" and r.exact:
                named.setdefault(r.effect, {})[r.parameter] = (r.value, r.std)
        return named

    def form_of(self, effect: str) -> str:
        """The ``effect`` as text for freeing it, "NAME" or "NAME:key=value": a velocity filter acts in these axes."""
        in_body_axes = effect == "velocity_filter" and self.pooled.frame == "body"
        return f"{effect}:body_axes=1" if in_body_axes else effect


def consistency(trials: Sequence[Trial], ship: Ship) -> Kinematics:
    """Kinematic consistency of ``trials`` of a ``ship``, by run and pooled over runs without a fault of the data.

    The last answer is kept, by what it depends on: a process that is asked the same again calculates nothing.
    """
    k = time_scale(ship.particulars["L"])
    key = _contents(trials, k)
    answer = _LAST.get(key)
    if answer is None:
        answer = _consistency(trials, k)
        _LAST.clear()
        _LAST[key] = answer
    return answer


_LAST: dict[bytes, Kinematics] = {}


def _contents(trials: Sequence[Trial], k: float) -> bytes:
    """A digest of what the consistency of ``trials`` depends on."""
    digest = hashlib.sha256(repr((k, [(t.name, t.has_position, t.dt) for t in trials])).encode())
    for trial in trials:
        digest.update(np.ascontiguousarray(trial.t).tobytes() + np.ascontiguousarray(trial.states).tobytes())
    return digest.digest()


def _consistency(trials: Sequence[Trial], k: float) -> Kinematics:
    logs = [_Log(trial, k) for trial in trials]
    sound = [log for log in logs if not log.faults()]
    frame, lag = _axes_of_lag(sound, k)
    readings, known = _readings(sound, k, frame, (lag, ()))
    runs = tuple(
        Consistency(log.name, _readings([log], k, frame, known)[0], frame, log.track, log.turn, log.faults())
        for log in logs
    )
    good = [run for run in runs if not run.faults]
    clear = {r.symbol for r in readings if r.verdict == "found"}
    pooled = [pooled_with(r, [(run.name, run[r.symbol]) for run in good], clear) for r in readings]
    warnings = [f"{run.name}: {fault}" for run in runs for fault in run.faults]
    bare = [log.name for log, trial in zip(logs, trials, strict=True) if not trial.has_position]
    if bare:
        what = "u and v cannot be checked (lag, gain, offset, lever arm), only r against psi"
        warnings.append(f"{', '.join(bare)}: no positions, so {what}")
    every = np.array([[run.track, run.turn] for run in good]).reshape(-1, 2)
    track, turn = (float(np.median(c[np.isfinite(c)])) if np.isfinite(c).any() else math.nan for c in every.T)
    return Kinematics(runs, Consistency("all runs", tuple(pooled), frame, track, turn), (*warnings, UNSEEN))


class _Log:
    """One trial on a uniform clock with its windows: M of n steps from ``starts``, each in the block ``block``."""

    def __init__(self, trial: Trial, k: float) -> None:
        self.name, self.dt, self.delta = trial.name, trial.dt, max(trial.dt, 0.2 * k)
        clock = trial.t[0] + self.dt * np.arange(min(round(trial.duration / self.dt) + 1, 20 * len(trial)))
        x, y, psi, self.u, self.v, self.r = (uniform(trial.t, c, clock, self.dt) for c in trial.states.T)
        self.width = max(round(SMOOTHING / self.dt), 5) | 1
        self.turned = np.exp(1j * psi)
        self.place, self.psi = smooth(x + 1j * y, self.width), smooth(psi, self.width)
        self.n = max(round(WINDOW * k / self.dt), 4)
        self.starts = np.arange(0, max(len(clock) - self.n, 0), max(round(STRIDE * k / self.dt), 1))
        length = float(np.clip(trial.duration / 12, 1.5 * WINDOW * k, BLOCK * k))
        self.block = (self.starts * self.dt // length).astype(int)
        self.moved, self.swung = self.between(self.place), self.between(self.psi)
        self.track = _correlation(self.moved, self.integral(self.turned * (self.u + 1j * self.v)), MOVED * k**2)
        self.turn = _correlation(self.swung, self.integral(self.r), TURNED)
        self._ways: dict[tuple[str, int], tuple[np.ndarray, ...]] = {}

    def between(self, values: np.ndarray) -> np.ndarray:
        """End less start of every window, (M,)."""
        return values[self.starts + self.n] - values[self.starts]

    def integral(self, values: np.ndarray) -> np.ndarray:
        """Integral of the smoothed values (N,) over every window (M,), NaN where one is missing."""
        f = smooth(values, self.width)
        missing = ~np.isfinite(f)
        f = np.where(missing, 0.0, f)
        total = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * self.dt)])
        holes = np.concatenate([[0], np.cumsum(missing)])
        gap = holes[self.starts + self.n + 1] > holes[self.starts]
        return np.where(gap, np.nan, self.between(total))

    def faults(self) -> tuple[str, ...]:
        """Sentences on velocities that do not belong to the positions or the heading."""
        pairs = (("u and v", "position", self.track), ("r", "heading", self.turn))
        return tuple(
            f"data fault: {logged} hardly follow{'s' * (logged == 'r')} from the {source} (correlation {c:.2f}, "
            f"below {CORRELATION:g}); left out, see mmg check"
            for logged, source, c in pairs
            if c < CORRELATION
        )

    def track_rows(self, frame: str, lag: float) -> tuple[np.ndarray, np.ndarray]:
        """(A (M, 10), y (M,)), complex: y = A TRACK, linear about a lag [s]."""
        at, before, after = (self._way(lag + step, frame) for step in (0.0, -self.delta, self.delta))
        slope = (sum(after) - sum(before)) / (2 * self.delta)
        rows = np.empty((len(self.starts), len(TRACK)), dtype=complex)
        rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = slope, *at, 1j * sum(at)
        rows[:, 4:] = self._without_lag
        return rows, self.moved - sum(at) + slope * lag

    @cached_property
    def _without_lag(self) -> np.ndarray:
        """Columns of the arm, of the biases and of the drift, (M, 6), complex."""
        arm, bias = self.between(smooth(self.turned, self.width)), self.integral(self.turned)
        time = np.full(len(self.starts), self.n * self.dt)
        return np.column_stack([arm, 1j * arm, -bias, -1j * bias, time, 1j * time])

    def turn_rows(self, lag: float) -> tuple[np.ndarray, np.ndarray]:
        """(A (M, 3), y (M,)): y = A TURN."""
        return self._turn_rows

    @cached_property
    def _turn_rows(self) -> tuple[np.ndarray, np.ndarray]:
        way, swing = self.integral(self.r), self.between(smooth(self.r, self.width))
        return np.column_stack([swing, way, np.full(len(way), -self.n * self.dt)]), self.swung - way

    def _way(self, lag: float, frame: str) -> tuple[np.ndarray, np.ndarray]:
        """Displacements (M,) by u and by v that are late by ``lag`` [s]."""
        shift, weight = shift_and_weight(-lag / self.dt)
        low, high = (self._way_ahead(frame, whole) for whole in (shift, shift + 1))
        u, v = ((1 - weight) * a + weight * b for a, b in zip(low, high, strict=True))
        return u, 1j * v

    def _way_ahead(self, frame: str, shift: int) -> tuple[np.ndarray, ...]:
        """Integrals (M,) of u and of v so many samples ahead; kept, as fits ask for the same ones again and again."""
        way = self._ways.get((frame, shift))
        if way is None:
            parts = (self.u, self.v)
            late = (ahead(self.turned * w, shift) if frame == "earth" else self.turned * ahead(w, shift) for w in parts)
            way = self._ways[frame, shift] = tuple(self.integral(w) for w in late)
        return way


def smooth(values: np.ndarray, width: int) -> np.ndarray:
    """Centred moving average of ``values`` (N,) over ``width`` samples, (N,), NaN where the window is not complete."""
    out = np.full(len(values), np.nan, dtype=np.result_type(values, float))
    if len(values) < width:
        return out
    kernel, whole = np.full(width, 1.0 / width), slice(width // 2, len(values) - width // 2)
    if np.iscomplexobj(values):  # by parts: for real numbers there is a quicker way
        out.real[whole], out.imag[whole] = (np.convolve(part, kernel, "valid") for part in (values.real, values.imag))
    else:
        out[whole] = np.convolve(values, kernel, "valid")
    return out


def shift_and_weight(steps: float) -> tuple[int, float]:
    """How many samples ``ahead`` values lie that are late by a number of ``steps``, and the share of those one further
    ahead."""
    whole = round(-steps)
    shift = whole if abs(whole + steps) < 1e-9 else math.floor(-steps)
    return shift, max(-steps - shift, 0.0)


def ahead(values: np.ndarray, shift: int) -> np.ndarray:
    """``values`` (N,) ``shift`` samples later, (N,), NaN outside."""
    out = np.full(len(values), np.nan, dtype=np.result_type(values, float))
    first, last = max(0, -shift), min(len(values), len(values) - shift)
    if last > first:
        out[first:last] = values[first + shift : last + shift]
    return out


def uniform(t: np.ndarray, values: np.ndarray, clock: np.ndarray, dt: float) -> np.ndarray:
    """``values`` (N,) logged at ``t`` (N,) [s] on another ``clock`` (M,) [s] of step ``dt`` [s]: (M,), NaN
    outside, and where more than 3 dt are missing.
    """
    good = np.flatnonzero(np.isfinite(values))
    if len(good) < 2:
        return np.full(len(clock), np.nan)
    out = np.interp(clock, t[good], values[good], left=np.nan, right=np.nan)
    for i in np.flatnonzero(np.diff(t[good]) > 3 * dt):
        out[(clock > t[good[i]]) & (clock < t[good[i + 1]])] = np.nan
    return out


def _correlation(a: np.ndarray, b: np.ndarray, least: float) -> float:
    """Correlation through the origin, real part; NaN where the RMS of both is below ``least`` or nothing is there."""
    good = np.isfinite(a) & np.isfinite(b)
    size = [math.sqrt(float(np.mean(np.abs(c[good]) ** 2))) if good.sum() >= 8 else 0.0 for c in (a, b)]
    if max(size) < least or min(size) == 0:
        return math.nan
    return float(np.mean((a * np.conj(b))[good]).real) / (size[0] * size[1])


def _axes_of_lag(logs: Sequence[_Log], k: float) -> tuple[str, Sequence[int]]:
    """The frame under which the tracks of all runs are likelier, given a lag of u and v and the faults beside it; and
    the lag as a fault, where it shows so: without it, the rows that show it would count as outliers."""
    earth, body = (_track(logs, k, frame, [LAG]) for frame in FRAMES)
    if earth is None or body is None:
        return FRAMES[0], ()
    gain = earth.cost - body.cost + FAULT * (len(earth.active) - len(body.active))
    frame, way = (FRAMES[1], body) if gain > FAULT else (FRAMES[0], earth)
    return frame, (LAG,) if _shows(way, LAG, TRACK[LAG], k) else ()


def _readings(
    logs: Sequence[_Log], k: float, frame: str, known: Sequence[Sequence[int]] = ((), ())
) -> tuple[tuple[Reading, ...], tuple[Sequence[int], Sequence[int]]]:
    """(readings of all quantities, faults of track and turn) of runs together, the lag in the axes of ``frame``.

    known: faults that all runs have, so that a run is judged by what it has on top.
    """
    turn = [log for log in logs if math.isfinite(log.turn)]
    way, yaw = _track(logs, k, frame, known[0]), _solved(turn, TURN, k, [log.turn_rows for log in turn], known[1])
    faults = way.active if way else (), yaw.active if yaw else ()
    return (*_judged(way, TRACK, k), *_judged(yaw, TURN, k)), faults


def _track(logs: Sequence[_Log], k: float, frame: str, known: Sequence[int]) -> Fit | None:
    """The faults behind the tracks of those ``logs`` that have one."""
    track = [log for log in logs if math.isfinite(log.track)]
    return _solved(track, TRACK, k, [partial(log.track_rows, frame) for log in track], known)


def _solved(
    logs: Sequence[_Log], of: Sequence[Quantity], k: float, rows: Sequence[Rows], known: Sequence[int]
) -> Fit | None:
    """The faults among these quantities behind the rows of the runs; None without runs."""
    prior, least = np.array([[q.prior, q.threshold] * np.array(k ** (2 * q.power)) for q in of]).T
    preferred = np.array([q.exact for q in of])
    return fit(rows, [log.block for log in logs], prior, least, preferred, STRIDE / WINDOW, known) if logs else None


def _judged(found: Fit | None, of: Sequence[Quantity], k: float) -> list[Reading]:
    """Readings of a fit of all runs."""
    if found is None:
        return [reading(q, math.nan, math.nan, "not checked") for q in of]
    out = []
    for i, q in enumerate(of):
        value, std = q.as_logged(found.values[i]), float(found.std[i])
        least = q.threshold * k ** (2 * q.power)
        if _shows(found, i, q, k):
            verdict = "found"
        else:
            verdict = "none" if max(abs(value), std) < least and found.sharp[i] else "undetermined"
        rivals = [(of[j], of[j].as_logged(size)) for j, size in found.rivals.get(i, [])]
        out.append(reading(q, value, std, verdict, rivals))
    return out


def _shows(found: Fit, i: int, q: Quantity, k: float) -> bool:
    """Whether the quantity q, number i of a fit, is more than chance and large enough to matter."""
    return abs(q.as_logged(found.values[i])) > max(found.crit * float(found.std[i]), q.threshold * k ** (2 * q.power))


def kinematics_of(trials: Sequence[Trial], ship: Ship) -> Kinematics | None:
    """What the logs of ``trials`` of a ``ship`` say of one another, None where they cannot be compared."""
    try:
        return consistency(trials, ship)
    except (UserError, np.linalg.LinAlgError):
        return None

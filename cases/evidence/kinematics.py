"""Kinematic consistency: do the logged position, heading, u, v and r follow from one another?

Over windows of some seconds the displacement of the position P = x + i y is compared with the integral of w = u + i v
turned by the heading, and the change of the heading with the integral of r, both sides smoothed alike. What differs is
regressed on what sensors do wrong, with robust weights::

    dP = int e^(i psi(t)) w(t + lag) dt (gains, heading offset) - biases + drift + arm (e^(i psi) end - start)
    d psi = (int r dt + T dr) / (1 + share) - bias

Few faults explain the data, by forward selection: the fault that explains most is added while it is significant by
jackknife standard errors, over blocks of a run or, where there are many runs, over runs; rivals that would do nearly as
well are named beside them. All times and sizes are those of a 3 m model; others follow by Froude's law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from cases.evidence.signals import jackknife
from cases.evidence.tails import normal_tail, student_quantile
from cases.trial import Trial
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.ship import Ship

SIGMAS = 3.0  # Standard errors that a found value must exceed; more (by Student's t) with few blocks. Set by hand.
RUNS = 10  # From so many runs on, standard errors are those between runs. Set by hand.
# Standard deviations from which an error counts by its size, not by its square (Huber 1964: between 1 and 2).
CLIP = 1.5  # set by hand
ITERATIONS, MOST = 8, 5  # Of a fit, and faults at most. Set by hand.
# A rival is named if it explains less by at most CLOSE in chi-squared, or SHARE of it; of two such faults the one that
# an effect of the library repeats comes first. Set by hand.
CLOSE, SHARE = 6.0, 0.8
Rows = Callable[[float], tuple[np.ndarray, np.ndarray]]  # lag [s] -> (A (M, P), y (M,)), linear about it.


@dataclass(frozen=True)
class Fit:
    """Few faults that explain the rows, and what each other one would be in addition.

    active: the faults; values, std: (P,); crit: Student's SIGMAS; rivals: fault -> [(other, its value)] that would
    explain the rows nearly as well in its place; cost: negative logarithm of the likelihood of what is left, with
    Huber's tails.
    """

    active: tuple[int, ...]
    values: np.ndarray
    std: np.ndarray
    crit: float
    rivals: dict[int, list[tuple[int, float]]]
    cost: float


@dataclass(frozen=True)
class Normal:
    """Normal equations by group, N (G, P, P) and h (G, P), of parameters with a prior (P,). cost: as of ``Fit`` at the
    present values; squares: weighted squares of the rows, ``rows`` in number."""

    N: np.ndarray
    h: np.ndarray
    prior: np.ndarray
    cost: float
    squares: float
    rows: float

    def solve(self, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray, float]:
        """(values, std, drop of the weighted squares) with only these, the others 0."""
        c = np.array(chosen, dtype=int)
        N, h, wish = self.N[:, c[:, None], c], self.h[:, c], np.diag(self.prior[c] ** -2.0)
        b, std = jackknife(N, h, wish)
        drop = float(b @ h.sum(axis=0))
        # rows that scatter less once these faults are taken off know the faults better than their weights say
        sharper = max(self.rows / max(self.squares - drop, 1e-12 * self.squares), 1.0)
        plain = np.sqrt(np.diag(np.linalg.inv(sharper * N.sum(axis=0) + wish)))
        return b, np.maximum(plain, std), drop


def _normal(rows: Sequence[Rows], blocks: Sequence[np.ndarray], b: np.ndarray, prior: np.ndarray, few: float) -> Normal:
    """Huber-weighted normal equations about b (P,), one group per run, or per block where there are few runs."""
    groups, cost, squares, count = [], 0.0, 0.0, 0.0
    for row, block in zip(rows, blocks, strict=True):
        A, y = row(b[0])
        good = np.isfinite(A).all(axis=1) & np.isfinite(y)
        A, y, group = A[good], y[good], block[good] if len(rows) < RUNS else np.zeros(good.sum())
        error = np.abs(y - A @ b)
        # medians of Rayleigh's law (two components) and of half a normal law: 1.18 and .67 standard deviations
        spread = float(np.median(error)) / (1.18 if np.iscomplexobj(A) else 0.67) + 1e-6 * prior[0]
        scaled = error / spread
        weight = few / np.maximum(scaled / CLIP, 1.0) / spread**2
        tails = np.where(scaled < CLIP, 0.5 * scaled**2, CLIP * (scaled - 0.5 * CLIP))
        cost += few * float(len(y) * (1 + np.iscomplexobj(A)) * math.log(spread) + tails.sum())
        squares, count = squares + float(weight @ np.abs(y) ** 2), count + few * len(y) * (1 + np.iscomplexobj(A))
        AW = (A.conj() * weight[:, None]).T
        for g in np.unique(group):
            at = group == g
            groups.append(((AW[:, at] @ A[at]).real, (AW[:, at] @ y[at]).real))
    N, h = (np.stack(parts) for parts in zip(*groups, strict=True))
    return Normal(N, h, prior, cost, squares, count)


def fit(
    rows: Sequence[Rows],
    blocks: Sequence[np.ndarray],
    prior: np.ndarray,
    least: np.ndarray,
    preferred: np.ndarray,
    few: float,
    start: Sequence[int] = (),
) -> Fit:
    """The few faults among P that explain the ``rows`` of the runs; blocks: (M,) block of each row, by run.

    prior, least: (P,) prior standard deviation, and least size that matters; preferred: (P,) bool, first of two that
    explain alike; few: share of a row that is independent, as windows overlap; start: faults present in any case.
    """
    P = len(prior)
    active = list(start)
    b, std = np.zeros(P), np.zeros(P)
    while True:
        for _ in range(ITERATIONS if active else 3):  # the weights follow the errors, the errors the values
            system = _normal(rows, blocks, b, prior, few)
            if active:  # a step of one prior standard deviation at most: the rows are linear about a lag
                b[active] += np.clip(system.solve(active)[0] - b[active], -prior[active], prior[active])
        crit = -student_quantile(normal_tail(SIGMAS), len(system.N) - 1) if len(system.N) > 1 else math.inf
        values, drops = b.copy(), np.full(P, -math.inf)
        for j in range(P):
            chosen = [i for i in active if i != j] + [j]  # last, so that its value and error are those at -1
            value, error, drop = system.solve(chosen)
            values[j], std[j] = value[-1], error[-1]
            if j not in active and abs(values[j]) > max(crit * std[j], least[j]):
                drops[j] = drop
        if not np.isfinite(drops).any() or len(active) >= MOST:
            return Fit(tuple(active), values, std, crit, _rivals(system, active), system.cost)
        base = system.solve(active)[2] if active else 0.0
        alike = drops - base >= SHARE * (drops.max() - base)
        first = alike & preferred if (alike & preferred).any() else alike
        active.append(int(np.argmax(np.where(first, drops, -np.inf))))


def _rivals(system: Normal, active: Sequence[int]) -> dict[int, list[tuple[int, float]]]:
    """Per fault the others that would do nearly as well in its place, and how large they would be."""
    out: dict[int, list[tuple[int, float]]] = {}
    for j in active:
        rest = [i for i in active if i != j]
        value, std, drop = system.solve([*rest, j])
        gain = drop - (system.solve(rest)[2] if rest else 0.0)
        for k in set(range(len(system.prior))) - set(active):
            other = system.solve([*rest, k])
            lost = (drop - other[2]) / gain
            # a fault of z standard errors is worth z^2 in chi-squared
            if lost < max(1 - SHARE, CLOSE * float(std[-1] / value[-1]) ** 2):
                out.setdefault(j, []).append((k, float(other[0][-1])))
    return out


# Faults that look much the same in a single run: the first at steady speed, where sway and turning go together, the
# others where speed or turning rate hardly change.
ALIKE: tuple[Set[str], ...] = (
    {"lag", "gain_v", "arm_x"},
    {"heading", "bias_v"},
    {"gain_u", "bias_u"},
    {"gain_r", "bias_r"},
)
UNSEEN = (
    "what moves position and velocities alike cannot be seen without dynamics: heading_bias (u and v turn with the "
    "logged heading), gnss_delay (position and velocity equally late), antenna_offset (both of the same point)"
)


@dataclass(frozen=True)
class SensorFault:
    """A fault of a sensor.

    unit as shown; threshold: the least size that matters; prior: standard deviation before the data; power: of the
    length by which threshold and prior grow; form: in words, with {} for the first of ``ends`` where the value is
    positive, else for the second; effect, parameter: of the library, "" where it has none; exact: the effect of the
    library does the same to the columns.
    """

    symbol: str
    unit: str
    threshold: float
    prior: float
    power: float
    form: str
    ends: tuple[str, str]
    effect: str = ""
    parameter: str = ""
    exact: bool = False

    def as_logged(self, value: float) -> float:
        """A fitted value as an error of the log: a gain is fitted as what corrects it."""
        return float(-value / (1 + value)) if self.symbol.startswith("gain") else float(value)

    def words(self, value: float) -> str:
        """What a value means."""
        return f"{self.form.format(self.ends[0 if value > 0 else 1])} by {_shown(abs(value), self.unit)}"


SIZE = ("large", "small")
COURSE = "the course of the position lies {} of u, v and psi"
POINT = "the position belongs to a point {} that of u and v"
DRIFT = "the position drifts {} against u and v (through the water?)"
# Thresholds and priors are set by hand, for a 3 m model.
TRACK = (
    SensorFault(
        "lag", "s", 0.1, 1.0, 0.5, "logged u and v {} the position", ("lag", "lead"), "velocity_filter", "tau", True
    ),
    SensorFault("gain_u", "", 0.005, 0.1, 0, "logged u is too {}", SIZE, "log_scale", "share", True),
    SensorFault("gain_v", "", 0.03, 0.1, 0, "logged v is too {}", SIZE),
    SensorFault("heading", "rad", 0.01, 0.1, 0, COURSE, ("clockwise", "counter-clockwise")),
    SensorFault("arm_x", "m", 0.06, 0.3, 1, POINT, ("ahead of", "aft of"), "antenna_offset", "x"),
    SensorFault("arm_y", "m", 0.06, 0.3, 1, POINT, ("to starboard of", "to port of"), "antenna_offset", "y"),
    SensorFault("bias_u", "m/s", 0.005, 0.02, 0.5, "logged u is always too {}", SIZE),
    SensorFault("bias_v", "m/s", 0.005, 0.02, 0.5, "logged v is always too {}", SIZE),
    SensorFault("drift_x", "m/s", 0.01, 0.03, 0.5, DRIFT, ("north", "south")),
    SensorFault("drift_y", "m/s", 0.01, 0.03, 0.5, DRIFT, ("east", "west")),
)
LAG = 0  # Place of the lag in TRACK
TURN = (
    SensorFault("lag_r", "s", 0.1, 1.0, 0.5, "logged r {} the heading", ("lags", "leads"), "gyro", "T", True),
    SensorFault("gain_r", "", 0.005, 0.1, 0, "logged r is too {}", SIZE, "gyro", "share", True),
    SensorFault("bias_r", "rad/s", 0.0005, 0.005, -0.5, "logged r is always too {}", SIZE),
)


@dataclass(frozen=True)
class Reading:
    """One quantity of one run or of all.

    value, std: NaN when not checked. Of what is found: a sentence, which names other quantities that would explain it
    nearly as well; effect and parameter of the library, "" without one; exact: that effect does the same to the
    columns.
    """

    symbol: str
    value: float
    std: float
    sentence: str = ""
    effect: str = ""
    parameter: str = ""
    exact: bool = False

    @classmethod
    def found(cls, q: SensorFault, value: float, std: float, rivals: Sequence[tuple[SensorFault, float]]) -> Reading:
        """That of the quantity q [q.unit], which was found; rivals: others that would explain the same, and how large
        they would be."""
        effect, parameter, exact = q.effect, q.parameter, q.exact
        sentence = f"{q.words(value)} +- {_shown(std, q.unit)}"
        if q.symbol == "lag" and value < 0:
            effect, exact = "gnss_delay", False
            sentence += "; a late position (gnss_delay of the library makes u and v as late)"
        elif q.symbol == "lag_r" and value < 0:
            effect, parameter, exact = "", "", False
        elif q.symbol.startswith("arm"):
            sentence += (
                ' (antenna_offset of the position alone; reference_point with applies_to = "position" corrects it)'
            )
        elif effect:
            sentence += f" ({effect})"
        if rivals:
            sentence += f"; hardly to be told from: {', or '.join(other.words(size) for other, size in rivals)}"
        return cls(q.symbol, value, std, sentence, effect, parameter, exact)


def _shown(value: float, unit: str) -> str:
    """A size in the unit that people read: degrees, per cent."""
    if unit in ("rad", "rad/s"):
        return f"{math.degrees(value):.2g} {unit.replace('rad', 'deg')}"
    return f"{100 * value:.2g} %" if not unit else f"{value:.2g} {unit}"


# s; moving average over the measured and the derived velocities (at least 5 samples): below it the differentiated
# satellite position is noise. Set by hand.
SMOOTHING = 1.1
# s: length of a window, distance of windows, and block that a jackknife leaves out (a twelfth of a short run).
WINDOW, STRIDE, BLOCK = 8.0, 2.0, 30.0  # set by hand
# A displacement or turn that correlates less with the integral of the velocities is a fault of the data.
CORRELATION = 0.9  # set by hand
# m and rad, RMS over the windows: a run that moves or turns less says nothing about it. Set by hand.
MOVED, TURNED = 0.3, 0.03
FRAMES = ("earth", "body")
# Gain in log likelihood that a further fault must bring, or axes of the lag that are not those of the earth: that of
# SIGMAS standard errors of one value.
FAULT = 0.5 * SIGMAS**2


@dataclass(frozen=True)
class Consistency:
    """Readings of a run, or of all that are no fault of the data.

    frame: axes of the lag: "earth" (a late velocity over ground, turned by the present heading) or, where that is
    clearly likelier, "body" (u and v each late or behind a low pass, which windows cannot tell apart). faults:
    sentences on what makes the data unusable.
    """

    name: str
    readings: tuple[Reading, ...]
    frame: str
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
        """Pooled readings that were found."""
        return tuple(r for r in self.pooled.readings if r.sentence)

    def effects(self) -> dict[str, dict[str, tuple[float, float]]]:
        """effect -> parameter -> (value, std) of found faults that an effect of the library repeats exactly."""
        named: dict[str, dict[str, tuple[float, float]]] = {}
        for r in self.found:
            if r.exact:
                named.setdefault(r.effect, {})[r.parameter] = (r.value, r.std)
        return named

    def lag_below(self, least: float) -> bool:
        """Whether velocities are late by less than ``least`` [s], by two standard errors; no where not checked."""
        lag = self.pooled["lag"]
        return abs(lag.value) + 2 * lag.std < least

    def form_of(self, effect: str) -> str:
        """The ``effect`` as text for freeing it, "NAME" or "NAME:key=value": a velocity filter acts in these axes."""
        in_body_axes = effect == "velocity_filter" and self.pooled.frame == "body"
        return f"{effect}:body_axes=1" if in_body_axes else effect


def consistency(trials: Sequence[Trial], ship: Ship) -> Kinematics:
    """Kinematic consistency of ``trials`` of a ``ship``, by run and pooled over runs without a fault of the data. The
    last answer is kept: who asks the same of the same trials again calculates nothing."""
    return _consistency(tuple(trials), time_scale(ship.particulars["L"]))


@lru_cache(maxsize=1)
def _consistency(trials: tuple[Trial, ...], k: float) -> Kinematics:
    logs = [_Log(trial, k) for trial in trials]
    sound = [log for log in logs if not log.faults()]
    frame, lag = _axes_of_lag(sound, k)
    readings, known = _readings(sound, k, frame, (lag, ()))
    runs = tuple(Consistency(log.name, _readings([log], k, frame, known)[0], frame, log.faults()) for log in logs)
    warnings = [f"{run.name}: {fault}" for run in runs for fault in run.faults]
    bare = [log.name for log, trial in zip(logs, trials, strict=True) if not trial.has_position]
    if bare:
        what = "u and v cannot be checked (lag, gain, offset, lever arm), only r against psi"
        warnings.append(f"{', '.join(bare)}: no positions, so {what}")
    return Kinematics(runs, Consistency("all runs", readings, frame), (*warnings, UNSEEN))


class _Log:
    """One trial on a uniform clock with its windows: M of n steps from ``starts``, each in the block ``block``."""

    def __init__(self, trial: Trial, k: float) -> None:
        self.name, self.dt, self.delta = trial.name, trial.dt, max(trial.dt, 0.2 * k)
        # 20 N rows at most: a log with a long gap would have a clock of mostly nothing
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

    def between(self, values: np.ndarray) -> np.ndarray:
        """End less start of every window, (M,)."""
        return values[self.starts + self.n] - values[self.starts]

    def integral(self, values: np.ndarray) -> np.ndarray:
        """Integral of the smoothed values (N,) over every window (M,), NaN where one is missing."""
        f = smooth(values, self.width)
        missing = ~np.isfinite(f)
        f = np.where(missing, 0.0, f)
        total = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * self.dt)])
        holes = np.concatenate([[0], np.cumsum(missing)])  # how many are missing before each row
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
        slope = (sum(after) - sum(before)) / (2 * self.delta)  # derivative by the lag, central difference
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
        rows = np.arange(len(self.u))
        # earth: the velocity over ground is late, logged in the axes of the present heading; body: u and v are late
        turn = self.turned if frame == "earth" else np.ones(1)
        late = (np.interp(rows + lag / self.dt, rows, turn * w, np.nan, np.nan) for w in (self.u, self.v))
        u, v = (self.integral(w if frame == "earth" else self.turned * w) for w in late)
        return u, 1j * v


def smooth(values: np.ndarray, width: int) -> np.ndarray:
    """Centred moving average of ``values`` (N,) over ``width`` samples, (N,), NaN where the window is not complete."""
    out = np.full(len(values), np.nan, dtype=np.result_type(values, float))
    if len(values) >= width:
        out[width // 2 : len(values) - width // 2] = np.convolve(values, np.full(width, 1.0 / width), "valid")
    return out


def uniform(t: np.ndarray, values: np.ndarray, clock: np.ndarray, dt: float) -> np.ndarray:
    """``values`` (N,) logged at ``t`` (N,) [s] on another ``clock`` (M,) [s] of step ``dt`` [s]: (M,), NaN outside, and
    where more than 3 dt are missing."""
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
    """(readings of all quantities, faults of track and turn) of runs together, the lag in the axes of ``frame``. known:
    faults that all runs have, so that a run is judged by what it has on top."""
    turn = [log for log in logs if math.isfinite(log.turn)]
    way, yaw = _track(logs, k, frame, known[0]), _solved(turn, TURN, k, [log.turn_rows for log in turn], known[1])
    faults = way.active if way else (), yaw.active if yaw else ()
    return (*_judged(way, TRACK, k), *_judged(yaw, TURN, k)), faults


def _track(logs: Sequence[_Log], k: float, frame: str, known: Sequence[int]) -> Fit | None:
    """The faults behind the tracks of those ``logs`` that have one."""
    track = [log for log in logs if math.isfinite(log.track)]
    return _solved(track, TRACK, k, [partial(log.track_rows, frame) for log in track], known)


def _solved(
    logs: Sequence[_Log], of: Sequence[SensorFault], k: float, rows: Sequence[Rows], known: Sequence[int]
) -> Fit | None:
    """The faults among these quantities behind the rows of the runs; None without runs."""
    # k is the time scale: lengths go with k^2 (Froude)
    prior, least = np.array([[q.prior, q.threshold] * np.array(k ** (2 * q.power)) for q in of]).T
    preferred = np.array([q.exact for q in of])
    return fit(rows, [log.block for log in logs], prior, least, preferred, STRIDE / WINDOW, known) if logs else None


def _judged(solution: Fit | None, of: Sequence[SensorFault], k: float) -> list[Reading]:
    """Readings of a fit of all runs."""
    if solution is None:
        return [Reading(q.symbol, math.nan, math.nan) for q in of]
    out = []
    for i, q in enumerate(of):
        value, std = q.as_logged(solution.values[i]), float(solution.std[i])
        rivals = [(of[j], of[j].as_logged(size)) for j, size in solution.rivals.get(i, [])]
        shows = _shows(solution, i, q, k)
        out.append(Reading.found(q, value, std, rivals) if shows else Reading(q.symbol, value, std))
    return out


def _shows(solution: Fit, i: int, q: SensorFault, k: float) -> bool:
    """Whether the quantity q, number i of a fit, is more than chance and large enough to matter."""
    least = max(solution.crit * float(solution.std[i]), q.threshold * k ** (2 * q.power))
    return abs(q.as_logged(solution.values[i])) > least


def kinematics_of(trials: Sequence[Trial], ship: Ship) -> Kinematics | None:
    """What the logs of ``trials`` of a ``ship`` say of one another, None where they cannot be compared."""
    try:
        return consistency(trials, ship)
    except (UserError, np.linalg.LinAlgError):
        return None

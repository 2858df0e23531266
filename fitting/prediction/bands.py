"""Standard deviations of the six predicted states, growing with the time since the start.

Three parts. The process: accelerations that no model explains, correlated over some seconds (Ornstein-Uhlenbeck) and
of a size that grows with speed and turning, drive errors of u, v, r that decay; heading and position follow by
kinematics along the predicted track. Its sizes and times are the most likely ones for the errors of the training
windows, and a factor per state and horizon makes 90 % of those fall into the 90 % band; it grows where a motion is new
to the trials (fitting/prediction/envelope.py). The coefficients: draws from their covariance, simulated. The
measurement: noise of the start and of the sample compared with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from cases.evidence.signals import white_noise
from cases.evidence.tails import student_quantile
from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.envelope import HeldMotion, held_dict, held_motion, held_of, met_so_far
from fitting.prediction.stretches import (
    WindowBatch,
    adapt,
    default_past,
    measured_columns,
    record_of,
    rollout,
    window_rows,
    wrapped_error,
)
from mmg.motion.flow import STATES
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

# Seconds of a 3 m model: length of windows whose errors are used, between their starts, between counted rows. The
# first two are those of the scores. The last was set by hand.
LENGTH, STRIDE, EVERY = 100.0, 15.0, 2.0
MEMORIES, DECAYS = (1.0, 3.0, 10.0), (5.0, 15.0, 50.0, 200.0)  # Times tried [s of a 3 m model]. A grid set by hand.
# Seconds of a 3 m model: up to the first the noise of the samples is taken, at the others the factors, from errors up
# to WIDE times earlier and later. Set by hand; without factors bands held .939 of the rows of 35 records for .906 over
# 30 s, .946 for .893 over 100 s.
EARLY, HORIZONS, WIDE = 2.0, (2.0, 5.0, 15.0, 30.0, 60.0, 100.0), 1.5
MOST_WINDOWS = 400  # Windows whose errors are used, which bounds the time it takes
# Half width of the 90 % band in standard deviations. (Abramowitz & Stegun 1964, chapter 26.)
NORMAL = 1.6448536269514722
COVER = 0.9  # Share of the errors of trials left out in that band. Set with NORMAL. Set by hand: a usual level.


# Draws of the coefficients, and the factor by which they are shrunk, their effect rescaled, to stay linear. Set by
# hand; without them bands held .877 of the rows of 35 records for .906 over 30 s, .839 for .893 over 100 s.
DRAWS, SHRINK = 16, 0.3
COARSE = 0.5  # Step of the covariance in seconds of a 3 m model. Set by hand: bands grow over many seconds.


@dataclass(frozen=True)
class Process:
    """Unexplained accelerations of u, v [m/s^2] and r [rad/s^2] and what follows from them.

    memory, decay: (3,) decay times [s] of the accelerations, and of the velocity errors. size: (3, 3) standard
    deviation of each acceleration: a constant part, one per U^2 / L, one per U |r| (r: each over L). noise: (6,) of the
    samples; factor: (H, 6) by which the process part of each state is multiplied at the ``horizons`` (H,) [s], adapted:
    the same for predictions that use the past of a window (fitting.prediction.stretches).
    """

    memory: np.ndarray
    decay: np.ndarray
    size: np.ndarray
    noise: np.ndarray
    factor: np.ndarray
    adapted: np.ndarray
    horizons: np.ndarray

    def factor_at(self, times: np.ndarray, adapted: bool = False) -> np.ndarray:
        """Factors (n, 6, M) at ``times`` (n, M) since the start, straight in log time, held beyond the horizons.
        adapted: of predictions that use the past of a window."""
        horizons, at = np.log(self.horizons), np.log(np.maximum(times, 1e-9))  # time 0 has the first factor
        rows = self.adapted if adapted else self.factor
        return np.stack([np.interp(at, horizons, rows[:, s]) for s in range(6)], axis=1)


def acceleration_sizes(states: np.ndarray, length: float) -> np.ndarray:
    """Squares of what the size of the accelerations grows with, (3, ..., M), from predicted ``states`` (..., 6, M).
    length: of the ship [m]."""
    u, v, r = states[..., 3, :], states[..., 4, :], states[..., 5, :]
    U2 = u * u + v * v
    return np.array([np.ones_like(u), (U2 / length) ** 2, U2 * r * r])


def coarse_rows(batch: WindowBatch, step: float) -> np.ndarray:
    """Rows (n,) of a ``batch`` at about ``step`` seconds, the first and the last among them."""
    taken = batch.steps[batch.steps > 0]
    every = max(1, round(step / float(np.median(taken)))) if len(taken) else 1
    return np.unique(np.append(np.arange(0, len(batch.steps) + 1, every), len(batch.steps)))


def acceleration_steps(dt: np.ndarray, memory: float, decay: float) -> np.ndarray:
    """Steps ``dt`` (n, M) of an acceleration of unit variance and the velocity error that it drives, (n, 6, M): shares
    of acceleration and error that are left; error per acceleration [s]; variance of the acceleration, its covariance
    with the error and variance of that by what the noise within the step adds. memory, decay: of both [s]."""
    # da = -a / memory dt + sqrt(2 / memory) dW (Ornstein-Uhlenbeck, variance 1), de = (a - e / T) dt, solved exactly
    # over a step; aa, ae, ee are integrals of products of their responses to dW over it
    T = decay * 1.01 if abs(decay - memory) < 0.01 * memory else decay  # equal ones would divide by zero
    fade, error, rate = np.exp(-dt / memory), np.exp(-dt / T), 1 / T - 1 / memory
    both = (1 - fade * error) / (1 / memory + 1 / T)  # integrals of products of the two exponentials
    twice_fade, twice_error = memory / 2 * (1 - fade**2), T / 2 * (1 - error**2)
    noise = 2 / memory
    ee = np.maximum(noise / rate**2 * (twice_fade - 2 * both + twice_error), 0.0)  # rounding of short steps
    return np.stack([fade, error, (fade - error) / rate, 1 - fade**2, noise / rate * (twice_fade - both), ee], axis=1)


def velocity_variance(square: np.ndarray, dt: np.ndarray, memory: float, decay: float) -> np.ndarray:
    """Variance (n + 1, ..., M) of the velocity error that accelerations of variance ``square`` (n + 1, ..., M) leave.

    dt: (n, M) steps; memory, decay: of accelerations and errors [s]. The accelerations start with their local size, the
    error with zero.
    """
    aa = square[0].copy()  # they began long before
    ae, ee = np.zeros_like(aa), np.zeros_like(aa)
    out = [ee]
    for (fade, error, gain, a, b, e), now in zip(acceleration_steps(dt, memory, decay), square, strict=False):
        ee = error**2 * ee + 2 * error * gain * ae + gain**2 * aa + e * now
        ae = fade * (error * ae + gain * aa) + b * now
        aa = fade**2 * aa + a * now
        out.append(ee)
    return np.array(out)


@dataclass(frozen=True)
class Bands:
    """Standard deviations of predictions; ``root`` (P, draws): draws of all coefficients less their values; held: the
    motion that the trials held, None: not known."""

    process: Process
    root: np.ndarray
    held: HeldMotion | None = None

    @np.errstate(over="ignore", invalid="ignore")  # where a prediction runs away its band is infinite, or no number
    def std(self, simulator: Simulator, batch: WindowBatch, out: np.ndarray, adapted: bool = False) -> np.ndarray:
        """Standard deviations (N + 1, 6, M) of predicted columns ``out`` (N + 1, 6, M); zero in the first row. The
        first row is the measured state, repeated in the prediction."""
        length = float(simulator.ship.particulars["L"])
        rows = coarse_rows(batch, COARSE * time_scale(length))
        times, states = batch.times[rows], out[rows]
        variance = self.process_variance(times, states, length) * self.process.factor_at(times, adapted) ** 2
        if self.held is not None:
            # novelty widens what no model explains; noise of sensors and of coefficients stay what they are
            inputs = batch.inputs[np.minimum(rows, len(batch.inputs) - 1)]
            variance *= 1 + met_so_far(times, self.held.novelty(states, inputs, length))[:, None]
        variance += self.measurement_variance(times, states)
        variance += self.coefficient_variance(simulator, batch, rows)
        coarse = np.sqrt(variance)
        # straight lines from coarse row to coarse row
        place = np.interp(np.arange(len(out)), rows, np.arange(len(rows)))
        low = np.minimum(place.astype(int), max(len(rows) - 2, 0))  # the last row is the upper end of the last span
        high = np.minimum(low + 1, len(rows) - 1)
        share = (place - low)[:, None, None]
        std = (1 - share) * coarse[low] + share * coarse[high]
        std[0] = 0.0  # the first row is the measurement itself
        return std

    def process_variance(self, times: np.ndarray, states: np.ndarray, length: float) -> np.ndarray:
        """Variance (n, 6, M) by the process, without its factors, at predicted states (n, 6, M) and their times (n, M)
        since the start."""
        p, M = self.process, states.shape[2]
        square = np.einsum("ck,k...->c...", p.size**2, acceleration_sizes(states, length))
        # order: accelerations (3), errors of u, v, r (3), of x, y, psi (3)
        P = np.zeros((M, 9, 9))
        for c in range(3):
            P[:, c, c] = square[c, 0]  # the accelerations began long before: stationary
        result = [np.zeros((6, M))]
        every = [acceleration_steps(np.diff(times, axis=0), p.memory[c], p.decay[c]) for c in range(3)]
        for k in range(len(times) - 1):
            F = np.tile(np.eye(9), (M, 1, 1))
            for c, steps in enumerate(every):
                F[:, c, c], F[:, 3 + c, 3 + c], F[:, 3 + c, c] = steps[k, :3]
            # positions by the velocity errors after the step (columns 3 to 5), and by their own (6 to 8) before it
            (_, _, psi, u, v, _), dt = states[k], times[k + 1] - times[k]
            c, s, G = np.cos(psi), np.sin(psi), np.tile(np.eye(3, 9, 6), (M, 1, 1))
            G[:, 0, 3], G[:, 0, 4], G[:, 0, 8] = dt * c, -dt * s, -dt * (u * s + v * c)  # of x' = u cos psi - v sin psi
            G[:, 1, 3], G[:, 1, 4], G[:, 1, 8] = dt * s, dt * c, dt * (u * c - v * s)  # of y' = u sin psi + v cos psi
            G[:, 2, 5] = dt
            F[:, 6:] = G @ F
            P = F @ P @ np.swapaxes(F, 1, 2)
            for c, steps in enumerate(every):  # what the noise within the step adds, by the local size
                aa, ae, ee = steps[k, 3:] * square[c, k]
                P[:, c, c] += aa
                P[:, 3 + c, 3 + c] += ee
                P[:, c, 3 + c] += ae
                P[:, 3 + c, c] += ae
            d = np.diagonal(P, axis1=1, axis2=2).T
            result.append(np.maximum(np.concatenate([d[6:], d[3:6]]), 0.0))  # in the order of STATES
        return np.array(result)

    def measurement_variance(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Variance (n, 6, M) by noise of the start, carried on, and of the sample that is predicted."""
        noise = self.process.noise**2
        fade = np.exp(-2 * times[:, None] / self.process.decay[:, None])  # of the variance of a velocity (n, 3, M)
        reach = (1 - np.sqrt(fade)) * self.process.decay[:, None]  # [s]: integral of a velocity error that decays
        way = np.hypot(states[:, 0] - states[0, 0], states[:, 1] - states[0, 1])
        # a wrong velocity, in whatever direction it goes, and a wrong heading by the way
        place = np.maximum(noise[3], noise[4]) * np.maximum(reach[:, 0], reach[:, 1]) ** 2 + noise[2] * way**2
        start = np.stack(
            [place, place, noise[5] * reach[:, 2] ** 2, *np.moveaxis(noise[3:, None] * fade, 1, 0)], axis=1
        )
        start[:, :3] += noise[:3, None]  # x, y, psi of the start are carried on whole
        return start + noise[:, None]

    def coefficient_variance(self, simulator: Simulator, batch: WindowBatch, rows: np.ndarray) -> np.ndarray:
        """Variance (n, 6, M) by the draws of the coefficients at ``rows`` (n,) of a ``batch``, in steps between them:
        no lag of the model is shorter. A draw that fails somewhere does not count there."""
        total = np.zeros((len(rows), 6, batch.steps.shape[1]))
        if not self.root.shape[1]:
            return total
        batch = batch.between(rows)

        def states(theta: np.ndarray, batch: WindowBatch) -> np.ndarray:
            start = simulator.start(batch.logged, batch.inputs[0], theta)
            return simulator.run(start, batch.inputs, batch.steps, theta)[:, :6]

        values = simulator.ship.values
        centre, M = states(values, batch), batch.steps.shape[1]
        draws = values[:, None] + SHRINK * self.root
        count = draws.shape[1] if simulator.is_stepwise else 1  # side by side: in Python many points at once are faster
        repeated = batch.times_over(count)
        for some in np.split(draws, draws.shape[1] // count, axis=1):
            theta = some[:, 0] if count == 1 else np.repeat(some, M, axis=1)
            for end in np.split(states(theta, repeated), count, axis=2):
                total += np.nan_to_num((end - centre) / SHRINK) ** 2
        return total / draws.shape[1]


SIZES = ("constant", "U2/L", "U r")  # What the accelerations grow with, as named in result.json


def process_dict(p: Process) -> dict[str, Any]:
    """A process ``p`` as plain values, which result.json holds under "bands"."""
    return {
        "acceleration_memory_s": dict(zip("uvr", p.memory.tolist(), strict=True)),
        "error_decay_s": dict(zip("uvr", p.decay.tolist(), strict=True)),
        "acceleration_std": {c: dict(zip(SIZES, p.size[i], strict=True)) for i, c in enumerate("uvr")},
        "noise": dict(zip(STATES, p.noise.tolist(), strict=True)),
        "horizons_s": p.horizons.tolist(),
        "factor": dict(zip(STATES, p.factor.T.tolist(), strict=True)),
        "factor_adapted": dict(zip(STATES, p.adapted.T.tolist(), strict=True)),
    }


def bands_of(result: Mapping[str, Any], ship: Ship) -> Bands | None:
    """The bands that the ``result`` of a run (the content of its result.json) holds for its ``ship``; None if it holds
    none."""
    try:
        b = result["bands"]
        times = [[b[key][c] for c in "uvr"] for key in ("acceleration_memory_s", "error_decay_s")]
        size = [[b["acceleration_std"][c][name] for name in SIZES] for c in "uvr"]
        noise = [b["noise"][s] for s in STATES]
        horizons = b.get("horizons_s", [1.0])  # results before there were horizons have one factor for all
        factors = [[np.broadcast_to(b[key][s], len(horizons)) for s in STATES] for key in ("factor", "factor_adapted")]
        arrays = (*times, size, noise, *(np.array(part, dtype=float).T for part in factors), horizons)
        process = Process(*(np.array(part, dtype=float) for part in arrays))
    except (AttributeError, KeyError, TypeError, ValueError):
        return None
    return Bands(process, draws_of(result, ship), held_of(b.get("held"), ship.inputs))


def draws_of(result: Mapping[str, Any], ship: Ship) -> np.ndarray:
    """Draws (P, DRAWS) of the coefficients of ``ship`` about their values, from the errors and correlations in
    ``result``."""
    root, correlation = np.zeros((len(ship.symbols), DRAWS)), correlation_in(result)
    if correlation is None:
        return root[:, :0]
    symbols, matrix = correlation
    try:
        std = np.array([result["coefficients"][s]["std"] for s in symbols], dtype=float)
        at = [ship.symbols.index(s) for s in symbols]
    except (KeyError, TypeError, ValueError):
        return root[:, :0]
    if not np.isfinite(std).all():
        return root[:, :0]
    # not Cholesky: rounded numbers of a file may be a little indefinite
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    normal = np.random.default_rng(0).standard_normal((len(symbols), DRAWS))  # one seed: a run has one band
    root[at] = std[:, None] * (vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * normal))
    return root


def correlation_in(content: Mapping[str, Any]) -> tuple[list[str], np.ndarray] | None:
    """Symbols (Q,) and correlation matrix (Q, Q) of the estimates in the ``content`` of a result.json, None where
    there is none or numbers are missing in it."""
    try:
        symbols = [str(s) for s in content["correlation"]["symbols"]]
        matrix = np.array(content["correlation"]["matrix"], dtype=float)
    except (KeyError, TypeError, ValueError):
        return None
    sound = matrix.shape == (len(symbols), len(symbols)) and np.isfinite(matrix).all()
    return (symbols, matrix) if sound else None


def student_factor(runs: int) -> float:
    """Ends of a 90 % interval by Student's t over those by the normal distribution, where so many ``runs`` tell it:
    errors are alike in a run, so the degrees of freedom are one less than runs, and two at least.
    With the normal distribution 108 of 126 figures of nine new ships lay inside for 116 (benchmarks/yards.py)."""
    return student_quantile(0.95, max(runs - 1, 2)) / NORMAL


def sample_noise(trials: Sequence[Trial]) -> np.ndarray:
    """White noise of the logged states of ``trials`` (6,), from third differences of neighbouring samples; 0 where
    there are none."""
    stretches = [trial.states.copy() for trial in trials]
    for states in stretches:
        states[:, 2] = np.unwrap(np.nan_to_num(states[:, 2]))  # a jump by 2 pi would be noise
    return white_noise(stretches, slice(2, None))


@np.errstate(all="ignore")  # a model that explodes has none
def fit_bands(
    simulator: Simulator,
    trials: Sequence[Trial],
    root: np.ndarray | None = None,
    without: np.ndarray | None = None,
) -> dict[str, Any] | None:
    """The process behind the errors of ``simulator`` on windows of ``trials``, and what motion those held, as plain
    values.

    root: (P, draws) draws of the coefficients (``draws_of``), whose part of the errors the factors leave out; without:
    (R, P) all coefficients by which each trial is predicted; by default, and where a row is not finite, those of the
    ship, which suits trials that she was not calibrated on. None when there are too few windows.
    """
    ship, length = simulator.ship, float(simulator.ship.particulars["L"])
    k = time_scale(length)
    stretches = _stretches(trials, ship, without)
    if len(stretches) < 5:  # set by hand: fewer tell no size
        return None
    batch = WindowBatch.of(stretches)
    rows = coarse_rows(batch, COARSE * k)
    out, measured, times = rollout(simulator, batch)[0][rows], measured_columns(stretches)[rows], batch.times[rows]
    states, error = np.nan_to_num(out), wrapped_error(out, measured)
    process = _likely_process(error, times, states, length, sample_noise(trials))
    if process is None:
        return None
    bands = Bands(process, np.zeros((len(simulator.model.symbols), 0)) if root is None else root)
    fixed = bands.coefficient_variance(simulator, batch, rows)
    rest = bands.process_variance(times, states, length)
    early = _counted(error, times, EARLY * k)
    # third differences see white noise alone; what of early errors is above that is noise of samples too
    for s in (3, 4, 5, 2, 0, 1):  # the noise of a state counts in that of those that follow from it
        total = rest + fixed + bands.measurement_variance(times, states)
        # share 2: the noise counts in the start and in the sample that is compared with
        more = _wanted(error[:, s][early], np.full(int(early.sum()), 2.0), total[:, s][early])
        process.noise[s] = np.sqrt(process.noise[s] ** 2 + max(0.0, float(np.nan_to_num(more))))
    fixed += bands.measurement_variance(times, states)
    few_runs = student_factor(len({id(s.record) for s in stretches}))
    water, offset = adapt(simulator, stretches, default_past(ship))
    adapted = wrapped_error(rollout(simulator, batch, water, offset)[0][rows], measured)
    # variances along the same track, so that the factors with and without the past differ by the errors alone
    factor, with_past = (few_runs * _factors(e, times, k, rest, fixed) for e in (error, adapted))
    process = replace(process, factor=factor, adapted=with_past)
    trial_motion = held_motion([record_of(trial, ship.inputs) for trial in trials], ship.inputs, length)
    return process_dict(process) | ({"held": held_dict(trial_motion)} if trial_motion else {})


def _stretches(trials: Sequence[Trial], ship: Ship, without: np.ndarray | None) -> list[Stretch]:
    """Windows of ``trials``, evenly spread, up to MOST_WINDOWS; without: (R, P) coefficients by trial."""
    k, windows = time_scale(ship.particulars["L"]), []
    values = [None] * len(trials) if without is None else [v if np.isfinite(v).all() else ship.values for v in without]
    for trial, value in zip(trials, values, strict=True):
        record = record_of(trial, ship.inputs, value)
        for first, last in window_rows(trial.t, LENGTH * k, STRIDE * k, True):
            bad = np.flatnonzero(~record.good[first : last + 1])
            end = first + int(bad[0]) - 1 if len(bad) else last  # a window ends before a row that is missing
            if end > first and trial.t[end] - trial.t[first] >= EVERY * k:
                windows.append(Stretch(record, first, end))
    if len(windows) <= MOST_WINDOWS:
        return windows
    return [windows[i] for i in np.linspace(0, len(windows) - 1, MOST_WINDOWS).round().astype(int)]


def _counted(error: np.ndarray, times: np.ndarray, seconds: float = np.inf) -> np.ndarray:
    """Which rows (n, M) of an ``error`` (n, 6, M) exist, did not diverge, and lie up to ``seconds`` after the start."""
    return np.isfinite(error[:, 2:]).all(axis=1) & (times > 0) & (times <= seconds)


def _factors(error: np.ndarray, times: np.ndarray, scale: float, process: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Factors (H, 6) on the process that put COVER of the errors about each of HORIZONS into the 90 % band.

    error, process, rest: (n, 6, M), with the variances by the process without factors, and by all else; scale: of
    seconds of a 3 m model. A horizon that too few errors reach has the factors of the one before it.
    """
    result = np.ones((len(HORIZONS), 6))
    for h, horizon in enumerate(HORIZONS):
        near = _counted(error, times, horizon * WIDE * scale) & (times > horizon / WIDE * scale)
        for s in range(6):
            square = _wanted(error[:, s][near], process[:, s][near], rest[:, s][near])
            before = result[h - 1, s] if h else 1.0
            # squares: factors stay between 0.1 and 10, set by hand
            result[h, s] = np.sqrt(np.clip(square, 0.01, 100.0)) if np.isfinite(square) else before
    return result


def _likely_process(
    error: np.ndarray, times: np.ndarray, states: np.ndarray, length: float, noise: np.ndarray
) -> Process | None:
    """The process of most likely times and sizes, without its factors; None when there are too few errors."""
    every, k = max(1, round(EVERY / COARSE)), time_scale(length)
    sampled = np.where(_counted(error, times)[:, None], error, np.nan)[every::every, 3:]  # of u, v, r
    if (np.isfinite(sampled).sum(axis=(0, 2)) < 50).any():  # set by hand, for five numbers of each state
        return None
    shape, dt = np.moveaxis(acceleration_sizes(states, length), 0, 1), np.diff(times, axis=0)
    memory, decay, size, best = np.empty(3), np.empty(3), np.empty((3, 3)), np.full(3, np.inf)
    for m, d in product(MEMORIES, DECAYS):
        parts = np.moveaxis(velocity_variance(shape, dt, m * k, d * k), 0, 1)[:, every::every]
        for c in range(3):
            value, sizes = _likely_sizes(parts, sampled[:, c], 2 * noise[3 + c] ** 2)
            if value < best[c]:
                best[c], memory[c], decay[c], size[c] = value, m * k, d * k, sizes
    one = np.ones((len(HORIZONS), 6))
    return Process(memory, decay, size, noise, one, one, k * np.array(HORIZONS))


def _likely_sizes(parts: np.ndarray, error: np.ndarray, floor: float) -> tuple[float, np.ndarray]:
    """Least -log likelihood of ``error`` (n, M) over sizes (K,), with variance sum size^2 ``parts`` (K, n, M) +
    ``floor``."""
    from scipy.optimize import minimize  # late: slow to import

    good = np.isfinite(error)
    A, e2 = parts[:, good], error[good] ** 2
    typical = float(e2.mean())
    floor = max(floor, 1e-6 * typical, 1e-300)
    means = np.maximum(A.mean(axis=1), 1e-300)
    A = A / means[:, None]  # each part of mean 1: sizes of one order, whatever its unit

    def objective(log: np.ndarray) -> tuple[float, np.ndarray]:
        weight = typical * np.exp(log)  # squared sizes by their logarithm: never negative
        variance = weight @ A + floor
        slope = (1 / variance - e2 / variance**2) / len(e2)
        return float((np.log(variance) + e2 / variance).mean()), weight * (A @ slope)

    minimum = minimize(objective, np.full(len(A), -1.0), jac=True, method="L-BFGS-B", bounds=[(-12.0, 6.0)] * len(A))
    return float(minimum.fun), np.sqrt(typical * np.exp(minimum.x) / means)


def _wanted(e: np.ndarray, share: np.ndarray, rest: np.ndarray) -> float:
    """The COVER quantile of what must multiply ``share`` so that an error is just inside its band; NaN if too few."""
    good = np.isfinite(e)
    if good.sum() < 100:  # set by hand: ten errors lie beyond the quantile
        return np.nan
    with np.errstate(over="ignore"):  # of a ship that explodes
        return float(np.quantile(((e[good] / NORMAL) ** 2 - rest[good]) / np.maximum(share[good], 1e-300), COVER))

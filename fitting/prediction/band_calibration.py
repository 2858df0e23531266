"""Prediction bands, calibrated on the errors of a calibrated ship."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from cases.evidence.signals import white_noise
from cases.evidence.tails import student_quantile
from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.bands import (
    COARSE,
    Bands,
    Process,
    acceleration_sizes,
    coarse_rows,
    process_dict,
    velocity_variance,
)
from fitting.prediction.envelope import held_dict, held_motion
from fitting.prediction.predict import record_of, window_rows
from fitting.prediction.stretches import (
    Adaptation,
    WindowBatch,
    adapt,
    default_past,
    measured_columns,
    rollout,
    wrapped_error,
)
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

    root: (P, draws) draws of the coefficients (``bands.draws_of``), whose part of the errors the factors leave out;
    without: (R, P) all coefficients by which each trial is predicted; by default, and where a row is not finite, those
    of the ship, which suits trials that she was not calibrated on. None when there are too few windows.
    """
    ship, length = simulator.ship, float(simulator.ship.particulars["L"])
    k = time_scale(length)
    stretches = _stretches(trials, ship, without)
    if len(stretches) < 5:  # set by hand: fewer tell no size
        return None
    batch = WindowBatch.of(stretches)
    out = rollout(simulator, batch)[0]
    errors = _WindowErrors(simulator, stretches, batch, out)
    process = _likely_process(errors, sample_noise(trials))
    if process is None:
        return None
    bands = Bands(process, np.zeros((len(simulator.model.symbols), 0)) if root is None else root)
    rows = coarse_rows(batch, COARSE * k)
    fixed = bands.coefficient_variance(simulator, batch, rows)
    rest = bands.process_variance(errors.times, errors.states, errors.length)
    early = errors.until(EARLY)
    # third differences see white noise alone; what of early errors is above that is noise of samples too
    for s in (3, 4, 5, 2, 0, 1):  # the noise of a state counts in that of those that follow from it
        total = rest + fixed + bands.measurement_variance(errors.times, errors.states)
        # share 2: the noise counts in the start and in the sample that is compared with
        more = _wanted(errors.error[:, s][early], np.full(int(early.sum()), 2.0), total[:, s][early])
        process.noise[s] = np.sqrt(process.noise[s] ** 2 + max(0.0, float(np.nan_to_num(more))))
    fixed += bands.measurement_variance(errors.times, errors.states)
    few_runs = student_factor(len({id(s.record) for s in stretches}))
    water, offset = adapt(simulator, stretches, Adaptation.of(ship, default_past(ship)))
    # variances along the same track, so that the factors with and without the past differ by the errors alone
    adapted = _WindowErrors(simulator, stretches, batch, rollout(simulator, batch, water, offset)[0], along=out)
    factor, with_past = (few_runs * part.factors(rest, fixed) for part in (errors, adapted))
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


class _WindowErrors:
    """Errors of predicted windows against what was logged, at rows COARSE seconds of a 3 m model apart.

    out: (N + 1, 6, M) predicted columns of a ``batch``; along: those along which variances grow, default ``out``.
    times: (n, M) since the start; states: (n, 6, M); error: (n, 6, M), NaN where unknown; counted: (n, M) rows that
    exist and did not diverge.
    """

    def __init__(
        self,
        simulator: Simulator,
        stretches: Sequence[Stretch],
        batch: WindowBatch,
        out: np.ndarray,
        along: np.ndarray | None = None,
    ) -> None:
        self.length = float(simulator.ship.particulars["L"])
        self.scale = time_scale(self.length)
        rows = coarse_rows(batch, COARSE * self.scale)
        self.times, self.states = batch.times[rows], np.nan_to_num((out if along is None else along)[rows])
        self.error = wrapped_error(out[rows], measured_columns(stretches)[rows])
        self.counted = np.isfinite(self.error[:, 2:]).all(axis=1)

    def until(self, seconds: float) -> np.ndarray:
        """Which errors count up to ``seconds`` of a 3 m model after the start, (n, M)."""
        return self.counted & (self.times > 0) & (self.times <= seconds * self.scale)

    def factors(self, process: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Factors (H, 6) on the process that put COVER of the errors about each of HORIZONS into the 90 % band.

        process, rest: (n, 6, M) variance by the process without factors, and by all else. A horizon that too few
        errors reach has the factors of the one before it.
        """
        result = np.ones((len(HORIZONS), 6))
        for h, horizon in enumerate(HORIZONS):
            near = self.until(horizon * WIDE) & (self.times > horizon / WIDE * self.scale)
            for s in range(6):
                square = _wanted(self.error[:, s][near], process[:, s][near], rest[:, s][near])
                before = result[h - 1, s] if h else 1.0
                # squares: factors stay between 0.1 and 10, set by hand
                result[h, s] = np.sqrt(np.clip(square, 0.01, 100.0)) if np.isfinite(square) else before
        return result


def _likely_process(errors: _WindowErrors, noise: np.ndarray) -> Process | None:
    """The process of most likely times and sizes, without its factors; None when there are too few errors."""
    every, k = max(1, round(EVERY / COARSE)), errors.scale
    sampled = np.where(errors.counted[:, None], errors.error, np.nan)[every::every, 3:]  # of u, v, r
    if (np.isfinite(sampled).sum(axis=(0, 2)) < 50).any():  # set by hand, for five numbers of each state
        return None
    shape, dt = np.moveaxis(acceleration_sizes(errors.states, errors.length), 0, 1), np.diff(errors.times, axis=0)
    memory, decay, size, best = np.empty(3), np.empty(3), np.empty((3, 3)), np.full(3, np.inf)
    for m, d in product(MEMORIES, DECAYS):
        parts = np.moveaxis(velocity_variance(shape, dt, m * k, d * k), 0, 1)[:, every::every]
        for c in range(3):
            value, sizes = likely_sizes(parts, sampled[:, c], 2 * noise[3 + c] ** 2)
            if value < best[c]:
                best[c], memory[c], decay[c], size[c] = value, m * k, d * k, sizes
    one = np.ones((len(HORIZONS), 6))
    return Process(memory, decay, size, noise, one, one, k * np.array(HORIZONS))


def likely_sizes(parts: np.ndarray, error: np.ndarray, floor: float) -> tuple[float, np.ndarray]:
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

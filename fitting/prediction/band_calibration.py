"""Prediction bands and the benefit of adaptation, calibrated on the errors of a calibrated ship."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from cases.checks.motion import white_noise
from cases.trial import Trial
from fitting.prediction.adaptation import Adaptation, adapt
from fitting.prediction.bands import (
    COARSE,
    Bands,
    Process,
    acceleration_sizes,
    coarse_rows,
    process_dict,
    velocity_variance,
)
from fitting.prediction.predict import record_of, window_rows
from fitting.prediction.score import pooled_sigma, score
from fitting.prediction.stretches import Stretch, WindowBatch, rollout
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator

LENGTH, STRIDE, EVERY = 100.0, 15.0, 2.0
"""Seconds of a 3 m model: length of windows whose errors are used, between their starts, between counted rows."""
MEMORIES, DECAYS = (1.0, 3.0, 10.0), (5.0, 15.0, 50.0, 200.0)
"""Times tried [s of a 3 m model]."""
EARLY, HORIZON = 2.0, 60.0
"""Seconds of a 3 m model: up to the first the noise of the samples, up to the second the factors are taken."""
PAST = 30.0
"""Seconds of past with which adaptation is tried."""
NORMAL = 1.6448536269514722
"""Half width of the 90 % band in standard deviations."""
COVER = 0.91
"""Share of the training errors in that band: more than 90 %, as the coefficients were fitted to them (validation)."""


def adaptation_pays(simulator: Simulator, trials: Sequence[Trial], sigma: np.ndarray, which: str) -> dict[str, Any]:
    """Both metrics of ``simulator`` on ``trials`` without and with the past of each window, as plain values.

    sigma: (6,) by which errors are divided; which: name of the trials. It is worthwhile when 30 s windows become better
    and 100 s restarts no worse.
    """
    plain = score(simulator, trials, sigma)
    with_past = score(simulator, trials, sigma, adapt=PAST)
    rows = {"window": [plain.window, with_past.window], "paper": [plain.paper, with_past.paper]}
    good = with_past.window < 0.99 * plain.window and not with_past.paper > plain.paper
    return {"past_s": PAST, "trials": which, "without": {k: v[0] for k, v in rows.items()},
            "with": {k: v[1] for k, v in rows.items()}, "worthwhile": bool(good)}  # fmt: skip


def sample_noise(trials: Sequence[Trial]) -> np.ndarray:
    """White noise of the logged states of ``trials`` (6,), from third differences of neighbouring samples; 0 where
    there are none.
    """
    stretches = [trial.states.copy() for trial in trials]
    for states in stretches:
        states[:, 2] = np.unwrap(np.nan_to_num(states[:, 2]))
    return white_noise(stretches, slice(2, None))


def fit_bands(simulator: Simulator, trials: Sequence[Trial], root: np.ndarray | None = None) -> dict[str, Any] | None:
    """The process behind the errors of ``simulator`` on windows of ``trials``, as ``process_dict`` gives it.

    root: (P, draws) draws of the coefficients (``bands.draws_of``), whose part of the errors the factors leave out.
    None when there are too few windows.
    """
    length = float(simulator.ship.particulars["L"])
    k = time_scale(length)
    stretches = []
    for trial in trials:
        record = record_of(trial, simulator.ship.inputs)
        for first, last in window_rows(trial.t, LENGTH * k, STRIDE * k, True):
            bad = np.flatnonzero(~record.good[first : last + 1])
            end = first + int(bad[0]) - 1 if len(bad) else last
            if end > first and trial.t[end] - trial.t[first] >= EVERY * k:
                stretches.append(Stretch(record, first, end))
    if len(stretches) < 5:
        return None
    batch = WindowBatch.of(stretches)
    out = rollout(simulator, batch)[0]
    error, counted = _errors(stretches, out)
    noise = sample_noise(trials)
    rows = coarse_rows(batch, 0.5 * k)
    memory, decay, size = np.empty(3), np.empty(3), np.empty((3, 3))
    dt = np.diff(batch.times[rows], axis=0)
    shape = acceleration_sizes(np.nan_to_num(out[rows]), length)
    every = max(1, round(EVERY / 0.5))
    sampled = np.where(counted[rows, None], error[rows], np.nan)[every::every, 3:]
    if (np.isfinite(sampled).sum(axis=(0, 2)) < 50).any():
        return None
    best = np.full(3, np.inf)
    for m in MEMORIES:
        for d in DECAYS:
            parts = np.moveaxis(velocity_variance(np.moveaxis(shape, 0, 1), dt, m * k, d * k), 0, 1)[:, every::every]
            for c in range(3):
                value, found = likely_sizes(parts, sampled[:, c], 2 * noise[3 + c] ** 2)
                if value < best[c]:
                    best[c], memory[c], decay[c], size[c] = value, m * k, d * k, found
    process = Process(memory, decay, size, noise, np.ones(6), np.ones(6))
    bands = Bands(process, np.zeros((len(simulator.model.symbols), 0)) if root is None else root)
    rows = coarse_rows(batch, COARSE * k)
    fixed = np.zeros((len(rows), 6, out.shape[2]))
    if bands.root.shape[1]:
        fixed = bands.coefficient_variance(simulator, batch, out, rows)
    process = _scaled(bands, length, batch, out, error, counted, fixed)
    water, offset = adapt(simulator, stretches, Adaptation.of(simulator.ship, PAST * k))
    error, counted = _errors(stretches, rollout(simulator, batch, water, offset)[0])
    known = replace(bands, process=process)
    return process_dict(replace(process, adapted=_factors(known, length, batch, out, error, counted, fixed)))


def _errors(stretches: Sequence[Stretch], out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predicted minus logged (N + 1, 6, M), NaN where unknown, and which rows exist and did not diverge (N + 1, M)."""
    error = np.full(out.shape, np.nan)
    for i, s in enumerate(stretches):
        rows = s.last - s.first + 1
        error[:rows, :, i] = out[:rows, :, i] - s.logged
        if not s.record.has_position:
            error[:, :2, i] = np.nan
    error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
    return error, np.isfinite(error[:, 2:]).all(axis=1)


def likely_sizes(parts: np.ndarray, error: np.ndarray, floor: float) -> tuple[float, np.ndarray]:
    """Least -log likelihood of ``error`` (n, M) over sizes (K,), with variance sum size^2 ``parts`` (K, n, M) +
    ``floor``.
    """
    good = np.isfinite(error)
    A, e2 = parts[:, good], error[good] ** 2
    floor = max(floor, 1e-6 * float(e2.mean()), 1e-300)
    means = np.maximum(A.mean(axis=1), 1e-300)
    A = A / means[:, None]
    typical = float(e2.mean())

    def objective(log: np.ndarray) -> tuple[float, np.ndarray]:
        weight = typical * np.exp(log)
        variance = weight @ A + floor
        slope = (1 / variance - e2 / variance**2) / len(e2)
        return float((np.log(variance) + e2 / variance).mean()), weight * (A @ slope)

    found = minimize(objective, np.full(len(A), -1.0), jac=True, method="L-BFGS-B", bounds=[(-12.0, 6.0)] * len(A))
    return float(found.fun), np.sqrt(typical * np.exp(found.x) / means)


def _wanted(e: np.ndarray, share: np.ndarray, rest: np.ndarray) -> float:
    """The COVER quantile of what must multiply ``share`` so that an error is just inside its band; NaN if too few."""
    good = np.isfinite(e)
    if good.sum() < 100:
        return np.nan
    return float(np.quantile(((e[good] / NORMAL) ** 2 - rest[good]) / np.maximum(share[good], 1e-300), COVER))


def _scaled(
    bands: Bands,
    length: float,
    batch: WindowBatch,
    out: np.ndarray,
    error: np.ndarray,
    counted: np.ndarray,
    fixed: np.ndarray,
) -> Process:
    """The process with noise and factors that put COVER of the errors into the 90 % band, early and up to HORIZON.

    fixed: (n, 6, M) variance at coarse rows by the coefficients.
    """
    k = time_scale(length)
    rows, out = coarse_rows(batch, COARSE * k), np.nan_to_num(out)
    rest = bands.process_variance(batch, out, length, rows) + fixed
    times = batch.times[rows]
    use = counted[rows] & (times > 0) & (times <= EARLY * k)
    noise = bands.process.noise.copy()
    for s in (3, 4, 5, 2, 0, 1):
        now = replace(bands, process=replace(bands.process, noise=noise))
        total = rest + now.measurement_variance(batch, out, rows)
        more = _wanted(error[rows, s][use], np.full(int(use.sum()), 2.0), total[:, s][use])
        noise[s] = np.sqrt(noise[s] ** 2 + max(0.0, float(np.nan_to_num(more))))
    known = replace(bands, process=replace(bands.process, noise=noise))
    return replace(known.process, factor=_factors(known, length, batch, out, error, counted, fixed))


def _factors(
    bands: Bands,
    length: float,
    batch: WindowBatch,
    out: np.ndarray,
    error: np.ndarray,
    counted: np.ndarray,
    fixed: np.ndarray,
) -> np.ndarray:
    """Factors (6,) on the process that put COVER of the errors up to HORIZON into the 90 % band."""
    k = time_scale(length)
    rows, out = coarse_rows(batch, COARSE * k), np.nan_to_num(out)
    process = bands.process_variance(batch, out, length, rows)
    rest = fixed + bands.measurement_variance(batch, out, rows)
    times = batch.times[rows]
    use = counted[rows] & (times > 0) & (times <= HORIZON * k)
    square = np.array([_wanted(error[rows, s][use], process[:, s][use], rest[:, s][use]) for s in range(6)])
    return np.where(np.isfinite(square), np.sqrt(np.clip(square, 0.01, 100.0)), 1.0)


def adaptation_worth(simulator: Simulator, held_out: Sequence[Trial]) -> dict[str, Any] | None:
    """Whether adaptation pays for ``simulator`` on ``held_out`` trials; None where none of them can be scored."""
    located = [t for t in held_out if t.has_position]
    try:
        return adaptation_pays(simulator, located, pooled_sigma(located), "validation")
    except UserError:
        return None

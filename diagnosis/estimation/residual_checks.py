"""Checks after a fit: correlation time of the latent force, whiteness of the residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import periodogram
from scipy.stats import gamma

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import TransitionModel

LEAST_ROWS, BINS, NEIGHBOURS = 60, 30, 9
"""Grid times that a window needs for a spectrum, bands of the spectrum, and bands that a line is compared with."""


@np.errstate(all="ignore")
def with_correlation_time(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> Estimate:
    """The fit ``found`` of the model ``steps`` to ``data`` with the most likely correlation time of the latent force.

    The likelihood is taken as a parabola through three values of the logarithm of the time.
    """
    active = active_states(steps, found.free.symbols, found.theta)
    logs, values = np.log(found.noise.tau) + np.array([-0.6, 0.0, 0.6]), []
    for log in logs:
        tau = float(np.exp(log))
        size = found.noise.force * (tau / found.noise.tau) ** 0.25  # between equal size and equal change over a second
        point = replace(found.fixed(), noise=found.noise.with_(tau=tau, force=size))
        values.append(linearise_and_filter(steps, data, point, active).nll)
    a, b, _ = np.polyfit(logs - logs[1], values, 2)
    if not a > 0:
        return found
    tau = float(np.exp(logs[1] + np.clip(-b / (2 * a), -0.7, 0.7)))
    if not 2 * data.h <= tau <= 60 * data.h:
        return found
    return estimate(steps, data, replace(found, noise=found.noise.with_(tau=tau)), iterations=6)


@np.errstate(all="ignore")
def residuals(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> np.ndarray:
    """Whitened residuals (K + 1, R, 6) of the fit ``found`` of ``steps`` to ``data``, 0 where nothing is compared."""
    active = active_states(steps, found.free.symbols, found.theta)
    white = linearise_and_filter(steps, data, found.fixed(), active).white
    return np.where(data.good, white[..., -1], 0.0)


def lag_correlation(data: GriddedTrials, w: np.ndarray) -> float:
    """Largest correlation of whitened residuals w (K + 1, R, 6) of ``data`` one or two samples apart, over sensors."""
    w = w[data.good.any(axis=(1, 2))][4:]
    square = (w**2).sum(axis=(0, 1))
    pairs = [np.abs((w[lag:] * w[:-lag]).sum(axis=(0, 1))) / np.maximum(square, 1e-300) for lag in (1, 2)]
    return float(np.max(pairs)) if len(w) > 4 else 0.0


def spectral_line(data: GriddedTrials, w: np.ndarray) -> tuple[float, float]:
    """(p, period [s]) of the sharpest line in the spectrum of whitened residuals w (K + 1, R, 6) of ``data``.

    p: probability of such a line by chance (Fisher 1929), 1 where samples are left out or too few. Periodograms are
    summed over windows and bands: by chance a sum of exponentials with about the median of the neighbouring bands (so p
    is somewhat too small). A periodic force, as of waves, makes a line, which the latent force cannot follow.
    """
    compared = np.asarray(data.good.any(axis=2))
    total, count = np.zeros((BINS, w.shape[2])), np.zeros(BINS)
    for r in range(w.shape[1]):
        rows = np.flatnonzero(compared[:, r])[4:]
        if len(rows) < LEAST_ROWS or np.ptp(rows) + 1 > len(rows):
            continue
        power = periodogram(w[rows, r], axis=0)[1][1:-1]
        power /= np.maximum(power.mean(axis=0), 1e-300)
        at = np.linspace(0, BINS, len(power), endpoint=False).astype(int)
        np.add.at(total, at, power)
        count += np.bincount(at, minlength=BINS)
    if not count.any():
        return 1.0, float("inf")
    mean, size = total / np.maximum(count, 1)[:, None], np.maximum(count, 1)[:, None]
    ratio = mean / np.maximum(median_filter(mean, (NEIGHBOURS, 1), mode="nearest"), 1e-300)
    p = np.asarray(gamma.sf(size * ratio, size))
    line = int(np.argmin(p.min(axis=1)))
    return min(1.0, p.size * float(p.min())), 2 * data.h * BINS / (line + 0.5)

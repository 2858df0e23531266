"""What is learnt about a fit afterwards: the memory of its latent force, and whether what remains is white."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import gamma

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearised_model import TransitionModel
from diagnosis.estimation.map_estimate import Estimate, estimate, linearise_and_filter
from diagnosis.estimation.parameters import NO_PRIORS, active_states

LEAST_ROWS, BINS, NEAR = 60, 30, 9
"""Grid times of a window whose spectrum is taken, bands of it, and neighbours that a line is compared with."""


@np.errstate(all="ignore")
def with_correlation_time(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> Estimate:
    """A fit with the memory of its latent force made more likely: a parabola through three values of its logarithm."""
    active = active_states(steps, found.free.symbols, found.theta)
    logs, values = np.log(found.noise.tau) + np.array([-0.6, 0.0, 0.6]), []
    for log in logs:
        tau = float(np.exp(log))
        size = found.noise.force * (tau / found.noise.tau) ** 0.25  # between equal size and equal change over a second
        noise = found.noise.with_(tau=tau, force=size)
        values.append(
            linearise_and_filter(steps, data, found.theta, found.path, noise, NO_PRIORS, np.zeros(0), active).nll
        )
    a, b, _ = np.polyfit(logs - logs[1], values, 2)
    if not a > 0:
        return found
    tau = float(np.exp(logs[1] + np.clip(-b / (2 * a), -0.7, 0.7)))
    if not 2 * data.h <= tau <= 60 * data.h:
        return found
    noise = found.noise.with_(tau=tau)
    return estimate(steps, data, found.theta, found.free, noise, found.path, found.p, iterations=6)


@np.errstate(all="ignore")
def residuals(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> np.ndarray:
    """Whitened residuals (K + 1, R, 6) of a fit, 0 where nothing is compared."""
    active = active_states(steps, found.free.symbols, found.theta)
    a = linearise_and_filter(steps, data, found.theta, found.path, found.noise, NO_PRIORS, np.zeros(0), active)
    return np.where(data.good, a.white[..., -1], 0.0)


def lag_correlation(data: GriddedTrials, w: np.ndarray) -> float:
    """Largest correlation of ``residuals`` (K + 1, R, 6) of a sensor with those one or two samples before; 0 if all is
    well."""
    seen = data.good.any(axis=(1, 2))
    w = w[seen][4:]
    square = (w**2).sum(axis=(0, 1))
    pairs = [np.abs((w[lag:] * w[:-lag]).sum(axis=(0, 1))) / np.maximum(square, 1e-300) for lag in (1, 2)]
    return float(np.max(pairs)) if len(w) > 4 else 0.0


def spectral_line(data: GriddedTrials, w: np.ndarray) -> tuple[float, float]:
    """(p, period [s]) of the sharpest line in the spectrum of ``residuals`` (K + 1, R, 6); p by chance (Fisher 1929).

    Periodograms are added over windows and narrow bands: under chance a sum of exponentials, here about the median of
    the neighbouring bands (so p is somewhat too small). A force that swings, as in waves, stands out as a line, which
    the random force cannot follow. p = 1 where samples are left out or too few.
    """
    seen = np.asarray(data.good.any(axis=2))
    total, count = np.zeros((BINS, w.shape[2])), np.zeros(BINS)
    for r in range(w.shape[1]):
        rows = np.flatnonzero(seen[:, r])[4:]
        if len(rows) < LEAST_ROWS or np.ptp(rows) + 1 > len(rows):
            continue
        part = w[rows, r]
        full = np.abs(np.fft.rfft(part - part.mean(axis=0), axis=0)[1:-1]) ** 2
        full /= np.maximum(full.mean(axis=0), 1e-300)
        at = np.linspace(0, BINS, len(full), endpoint=False).astype(int)
        np.add.at(total, at, full)
        count += np.bincount(at, minlength=BINS)
    if not count.any():
        return 1.0, float("inf")
    mean, size = total / np.maximum(count, 1)[:, None], np.maximum(count, 1)[:, None]
    about = median_filter(mean, (NEAR, 1), mode="nearest")
    ratio = mean / np.maximum(about, 1e-300)
    p = np.asarray(gamma.sf(size * ratio, size))
    line = int(np.argmin(p.min(axis=1)))
    return min(1.0, p.size * float(p.min())), 2 * data.h * BINS / (line + 0.5)

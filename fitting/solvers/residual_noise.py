"""Size and correlation time of the residuals of a fit: the weights of the next solve.

Residuals of a real ship are not white: a gust or an unmodelled effect displaces a trajectory for many seconds, so a
1 Hz record of 1000 s holds far fewer than 1000 independent errors. Each channel therefore gets an effective standard
deviation rms sqrt(tau), tau the integrated autocorrelation time in samples (at least 1): the likelihood then counts
the effective number of samples, and white noise (tau = 1) is weighted as usual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.nlp.loss import without_outliers
from fitting.nlp.windows import Segments

STAYS = 0.1
"""Least share of the squares of residuals that is not blamed on how their states were derived. Set by hand."""


@dataclass(frozen=True)
class ResidualNoise:
    """Residual statistics by state channel, each (6,): rms [SI], tau [samples], sigma = rms sqrt(tau)."""

    rms: np.ndarray
    tau: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        return self.rms * np.sqrt(self.tau)

    def counted(self, weight: float) -> tuple[np.ndarray, np.ndarray]:
        """sigma and tau (6,) with which all residuals count with the share ``weight`` of their information."""
        return self.sigma / np.sqrt(weight), self.tau / weight


def residual_series(segments: Segments, node_residuals: np.ndarray, interior: np.ndarray) -> list[np.ndarray]:
    """Residuals in time order per window of ``segments``, each (samples, 6), NaN where not measured.

    node_residuals: (B, 6); interior: (K-1, 6, M) residuals inside the intervals.
    """
    parts: list[list[np.ndarray]] = [[] for _ in segments.run]
    for i in np.lexsort((segments.start, segments.window)):
        inside = np.where(segments.mask[:, :, i] > 0, interior[:, :, i], np.nan)[: segments.steps[i] - 1]
        parts[segments.window[i]] += [node_residuals[segments.start[i]][None], inside]
    last = np.zeros(len(parts), dtype=int)
    np.maximum.at(last, segments.window, segments.end)
    return [np.vstack([*p, node_residuals[node][None]]) for p, node in zip(parts, last, strict=True)]


def correlation_time(residuals: list[np.ndarray], longest: int) -> float:
    """Integrated autocorrelation time [samples] of one channel from ``residuals`` of windows, (n,) each; at least 1.

    Sums the pooled autocorrelation up to its first value below 0.05 (a self-consistent window, Sokal 1997), or to the
    lag ``longest``.
    """
    products, counts = np.zeros(longest), np.zeros(longest)
    for e in residuals:
        e = np.nan_to_num(e)
        n = len(e)
        lags = np.arange(min(longest, n))
        products[lags] += np.correlate(e, e, "full")[n - 1 :][lags]
        counts[lags] += n - lags
    if products[0] <= 0:
        return 1.0
    rho = (products / np.maximum(counts, 1)) / (products[0] / counts[0])
    below = np.flatnonzero(rho < 0.05)
    end = int(below[0]) if len(below) else longest
    return float(max(1.0, 1 + 2 * rho[1:end].sum()))


def estimate_noise(
    segments: Segments, node_residuals: np.ndarray, interior: np.ndarray, floor: np.ndarray, robust: bool = False
) -> ResidualNoise:
    """Noise of each channel from the residuals of a fit over ``segments``.

    node_residuals: (B, 6); interior: (K - 1, 6, M); floor: (6,) smallest rms; robust: leave out residuals beyond
    four robust standard deviations. Where the states of a window were derived, their variance is taken off the squares,
    of which at least STAYS is left. One degree of freedom per window and channel is given to the free initial states. A
    channel that is nowhere measured keeps rms = floor, tau = 1.
    """
    windows = residual_series(segments, np.where(segments.node_mask > 0, node_residuals, np.nan), interior)
    rms, tau = np.array(floor, dtype=float), np.ones(6)
    for channel in range(6):
        e = [w[:, channel] for w in windows if np.isfinite(w[:, channel]).any()]
        e = without_outliers(e) if robust else e
        count = sum(int(np.isfinite(part).sum()) for part in e)
        if count <= len(e):
            continue
        total = sum(float(np.nansum(part**2)) for part in e)
        if segments.variance is not None:
            derived = [
                int(np.isfinite(w[:, channel]).sum()) * v
                for w, v in zip(windows, segments.variance[:, channel], strict=True)
            ]
            total = max(total - sum(derived), STAYS * total)
        rms[channel] = max(np.sqrt(total / (count - len(e))), floor[channel])
        tau[channel] = correlation_time(e, longest=max(2, max(len(part) for part in e) // 2))
    return ResidualNoise(rms, tau)

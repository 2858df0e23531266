"""From the particles of an ensemble to bands that hold the truth: calibrated on windows that no member was trained on.

Members share the error of their common equations, their common data and of gusts that none can know, so the spread of
an ensemble alone is too small. The variance of a state is taken as

    (factor * std of the particles)^2 + sum_j size_j^2 g_j(t / T),    g = 1, 1 - exp(-4 s), s, s^2, s^4,

with the most likely sizes for the errors of the calibration windows; a last factor per state then puts the wanted
share of these errors into the band. Without the common part only the factor of the particles is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.prediction.band_calibration import NORMAL, likely_sizes
from mmg.errors import UserError

LEVEL = 0.9
"""Share of the truth that a band is to hold; NORMAL standard deviations to each side."""
LEAST = 100
"""Fewest errors per state to calibrate on."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of an ensemble's mean. factor: (6,) of the particles' own; common: (6, 5) sizes of the
    part that all members share, in the units of the states, of windows of ``seconds`` [s] on a grid of ``h`` [s].
    """

    factor: np.ndarray
    common: np.ndarray
    seconds: float
    h: float

    def std(self, paths: np.ndarray) -> np.ndarray:
        """(N + 1, 6, M) for particles (N + 1, 6, P, M)."""
        shared = np.einsum("sk,kn->ns", self.common**2, growing(len(paths), self.h, self.seconds))
        return np.sqrt(self.factor[:, None] ** 2 * paths.var(axis=2) + shared[:, :, None])


def growing(rows: int, h: float, seconds: float) -> np.ndarray:
    """The functions g (5, rows) at rows h [s] apart."""
    s = np.arange(rows) * h / seconds
    return np.array([np.ones(rows), 1 - np.exp(-4 * s), s, s**2, s**4])


def errors(paths: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Truth less mean of the particles (N + 1, 6, M); NaN in the first row, which is given, and where not measured."""
    error = np.where(mask > 0, truth - paths.mean(axis=2), np.nan)
    error[0] = np.nan
    return error


def calibrated(
    paths: np.ndarray, truth: np.ndarray, mask: np.ndarray, h: float, common: bool = True, level: float = LEVEL
) -> Spread:
    """The spread that puts ``level`` of the true states (N + 1, 6, M) into the band, for each state.

    common: with the part that all members share. Raises UserError when there are too few windows.
    """
    rows = len(paths)
    seconds = (rows - 1) * h
    error, own = errors(paths, truth, mask), paths.var(axis=2)
    shapes = growing(rows, h, seconds)
    factor, sizes = np.zeros(6), np.zeros((6, len(shapes)))
    for s in range(6):
        good = np.isfinite(error[:, s])
        if good.sum() < LEAST:
            raise UserError(f"the spread needs at least {LEAST} measured rows of every state to be calibrated on")
        if common:
            parts = np.concatenate([own[None, :, s], np.broadcast_to(shapes[:, :, None], (5, *good.shape))])
            found = likely_sizes(parts, error[:, s], 0.0)[1]
        else:
            found = np.append(1.0, np.zeros(len(shapes)))
        variance = found[0] ** 2 * own[:, s] + (found[1:] ** 2 @ shapes)[:, None]
        wanted = np.abs(error[:, s][good]) / np.sqrt(np.maximum(variance[good], 1e-300)) / NORMAL
        found = found * np.quantile(wanted, level)
        factor[s], sizes[s] = found[0], found[1:]
    return Spread(factor, sizes, seconds, h)


def inside(paths: np.ndarray, truth: np.ndarray, mask: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Whether the truth lies in the band (N + 1, 6, M): 1.0, 0.0 or NaN where there is none."""
    error = errors(paths, truth, mask)
    return np.where(np.isfinite(error), (np.abs(error) <= NORMAL * std).astype(float), np.nan)


def coverage(paths: np.ndarray, truth: np.ndarray, mask: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Share of rows and windows in which each true state lies in the band, (6,)."""
    return np.asarray(np.nanmean(inside(paths, truth, mask, std), axis=(0, 2)))

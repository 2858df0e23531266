"""A step of the sizes of the noise to where they are likeliest, by their average information.

With the residuals e and their covariance V, the sum of a part V_i for each variance, half the logarithm of V's
determinant and half e' V^-1 e have by the logarithm of a variance the slope (tr V^-1 V_i - e' V^-1 V_i V^-1 e) / 2. The
mean of the observed and the expected information on two of them is e' V^-1 V_i V^-1 V_j V^-1 e / 2, which needs only
whitened columns (Gilmour, Thompson & Cullis 1995): each is the response to what the smoother makes of one source of
noise. Steps with it come to the optimum in a few iterations, where those of the fixed point take dozens.
"""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.filtering import whitened
from diagnosis.estimation.kalman import PRIOR_SAMPLES, NoiseModel
from diagnosis.estimation.linearisation import Linearisation
from diagnosis.estimation.noise_sizes import GUST, LEAST, MOST, least_force

SHORTEST, LONGEST = -3.0, 1.4
"""Least and largest change of the logarithm of a variance in one step."""
RIDGE = 1e-3, 1e-6
"""Share of each information that is added to it, and as much again: sources that look alike are not told apart."""


def noise_step(here: Linearisation, r: np.ndarray, u: np.ndarray, typical: NoiseModel) -> tuple[NoiseModel, float]:
    """The sizes of the noise after one step from those of a linearisation ``here``, and the gain of log likelihood that
    is expected from it.

    r: (K, R, n), u: (K + 1, R, 6) of the smoother; typical: sizes of which LEAST and LEAST_FORCE are the smallest and
    MOST the largest force. A prior of the noise counts as PRIOR_SAMPLES more samples.
    """
    noise, data = here.at.noise, here.data
    coloured = noise.coloured > 0
    gust = noise.gust if data.gusts is not None else np.zeros(0)
    sizes = np.concatenate([noise.force, gust, noise.coloured[coloured], noise.white])
    errors = LEAST * typical.white
    lower = np.concatenate([least_force(noise, data, typical), np.full(len(gust), GUST[0]), errors[coloured], errors])
    upper = np.full(len(sizes), np.inf)
    upper[: 3 + len(gust)] = [*MOST * typical.force, *np.full(len(gust), GUST[1])]
    slope, information = slope_and_information(here, r, u)
    if noise.prior is not None:
        own = np.array([*range(3), *range(len(sizes) - 6, len(sizes))])
        known = (np.concatenate([noise.prior.force, noise.prior.white]) / sizes[own]) ** 2
        slope[own] += 0.5 * PRIOR_SAMPLES * (1 - known)
        information[own, own] += 0.5 * PRIOR_SAMPLES * known
    free = ~((sizes <= lower) & (slope > 0)) & ~((sizes >= upper) & (slope < 0))
    own_information = information[np.ix_(free, free)]
    own_information += np.diag(RIDGE[0] * np.diag(own_information) + RIDGE[1])
    step = np.zeros(len(sizes))
    step[free] = np.clip(-np.linalg.solve(own_information, slope[free]), SHORTEST, LONGEST)
    gain = -float(slope @ step + 0.5 * step @ information @ step)
    found = np.clip(sizes * np.exp(0.5 * step), lower, upper)
    force, gust, colours, white = np.split(found, [3, 3 + len(gust), len(found) - 6])
    every = noise.coloured.copy()
    every[coloured] = colours
    new = noise.with_(white=white, coloured=every, gust=gust if len(gust) else noise.gust)
    return new.with_(force=np.maximum(force, least_force(new, data, typical))), gain


def slope_and_information(here: Linearisation, r: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope (q,) of the negative log likelihood by the logarithms of the variances that drive the system of ``here``,
    without those of its first states, and their average information (q, q): force, gusts where there are any, coloured
    errors, white errors (6). r: (K, R, n), u: (K + 1, R, 6) of the smoother."""
    system, A = here.system, len(here.active)
    (K, R, n), random = system.T.shape[:3], system.T.shape[2] - A
    inside, good = system.inside[..., None], system.good
    pushed, seen = np.where(inside, r[..., A:], 0.0), np.where(good, u, 0.0)
    variances = np.concatenate([system.Q[A:], system.R])
    expected = [
        (np.where(mask, x, 0.0)).sum(axis=(0, 1))
        for mask, x in ((inside, here.adjoint.N[..., A:]), (good, here.adjoint.D))
    ]
    squares = [(x**2).sum(axis=(0, 1)) for x in (pushed, seen)]
    slope = 0.5 * variances * (np.concatenate(expected) - np.concatenate(squares))
    forcing, observed = np.zeros((K, R, n, random + 6)), np.zeros((K + 1, R, 6, 6))
    at, each = np.arange(random), np.arange(6)
    forcing[:, :, A + at, at] = system.Q[A:] * pushed
    observed[:, :, each, each] = system.R * seen
    columns = DrivenColumns(forcing, observed, random + each)
    white = whitened(system, here.filter, columns, rows=here.rows)[0].reshape(-1, random + 6)
    return slope, 0.5 * white.T @ white

"""Initial sizes of the noise, and their update by expectation-maximisation."""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import PRIOR_SAMPLES, Adjoint, NoiseModel
from mmg.motion.froude import force_scale, length_scale, state_scale, time_scale
from mmg.ship import Ship

LEAST, MOST = 0.02, 15.0
"""Least size of a sensor's errors and largest of the latent force, in those of ``initial_noise``. A larger force, which
would swallow all that moves the ship, is none of chance."""
GUST = (1e-3, 0.5)
"""Least and largest size of gusts, in the speed of the wind."""
LEAST_FORCE = 1e-3
"""Least size of the latent force, in that of ``initial_noise``. One that is larger than the truth makes the residuals
smaller than the filter expects, and then the likelihood grows with the masses, which such a force moves less: in trials
without any random force 0.02 named ``draft``."""


def initial_noise(ship: Ship) -> NoiseModel:
    """Initial sizes for a ``ship``: those of a 3 m model scaled by Froude's law."""
    length = float(ship.particulars["L"])
    force = np.array([0.2, 0.3, 0.2 * length_scale(length)]) * force_scale(length)
    white = np.array([0.02, 0.02, 0.003, 0.006, 0.006, 0.001]) * state_scale(length)
    return NoiseModel(
        force, 6.0 * time_scale(length), white, np.zeros(6), 4.0 * time_scale(length), gust_tau=time_scale(length)
    )


def least_noise(ship: Ship) -> NoiseModel:
    """Sizes below which no estimate for a ``ship`` goes: LEAST and LEAST_FORCE of the initial ones."""
    typical = initial_noise(ship)
    white = LEAST * typical.white
    return typical.with_(force=LEAST_FORCE * typical.force, white=white, coloured=white)


def wider(known: NoiseModel, ship: Ship) -> NoiseModel:
    """First sizes for trials of a ``ship`` whose instruments and surroundings had the sizes ``known`` in others: none
    below the initial ones.

    A fit that begins with hardly any random force or error makes the coefficients explain all that an unmodelled effect
    does, and ends far from the ship.
    """
    first = initial_noise(ship)
    force, white = np.maximum(known.force, first.force), np.maximum(known.white, first.white)
    return known.with_(force=force, white=white, gust=np.maximum(known.gust, first.gust), prior=known)


def swallows(noise: NoiseModel, ship: Ship) -> bool:
    """Whether the force of ``noise`` comes near the most that is allowed for a ``ship``."""
    return bool((noise.force > 0.5 * MOST * initial_noise(ship).force).any())


BESIDE_GUSTS = 0.2
"""Least size of the latent force, in the force of the gusts: they are not the same all along a ship, and wind
coefficients are not exact. In a single run gusts would leave nothing of it, and a model that is sure of that sees
effects."""


def least_force(noise: NoiseModel, data: GriddedTrials, typical: NoiseModel) -> np.ndarray:
    """Least size (3,) [N, N, N m] of the latent force of trials ``data`` whose gusts have the sizes of ``noise``;
    typical: as of ``updated_noise``."""
    least = LEAST_FORCE * typical.force
    if data.gusts is None:
        return least
    blown = (data.gusts[data.inside] ** 2).mean(axis=0) @ noise.gust**2
    return np.asarray(np.maximum(least, BESIDE_GUSTS * np.sqrt(blown)))


def updated_noise(
    noise: NoiseModel, data: GriddedTrials, found: Adjoint, r: np.ndarray, u: np.ndarray, A: int, typical: NoiseModel
) -> NoiseModel:
    """The sizes ``noise`` after one step of the fixed point q <- q sum r^2 / sum N (force, coloured errors) and R <- R
    sum u^2 / sum D; a prior counts as PRIOR_SAMPLES more samples of each.

    data: windows; found: with N and D; r: (K, R, n), u: (K + 1, R, 6) of the smoother; A: number of ship states;
    typical: sizes of which LEAST and LEAST_FORCE are the smallest and MOST the largest force.
    """
    prior = noise.prior
    pull = PRIOR_SAMPLES if prior is not None else 0.0
    force, white = (noise.force, noise.white) if prior is None else (prior.force, prior.white)
    rest = len(found.N[0, 0]) - A - 3
    fresh = 1 - np.exp(-2 * data.h / noise.tau)
    added = pull / (fresh * np.concatenate([noise.force**2, np.full(rest, np.inf)]))
    more = np.concatenate([(force / noise.force) ** 2, np.zeros(rest)])

    def ratio(
        top: np.ndarray, bottom: np.ndarray, mask: np.ndarray, known: np.ndarray, count: np.ndarray
    ) -> np.ndarray:
        a, b = (np.where(mask, x, 0.0).sum(axis=(0, 1)) for x in (top, bottom))
        a, b = a + count * known, b + count
        return np.clip(np.where(b > 0, a / np.maximum(b, 1e-300), 1.0), 0.1, 10.0)

    grown = ratio(r[..., A:] ** 2, found.N[..., A:], data.inside[..., None], more, added)
    scattered = ratio(u**2, found.D, data.good, (white / noise.white) ** 2, pull / noise.white**2)
    colours = noise.coloured.copy()
    gusts = 0 if data.gusts is None else 2
    gust = np.clip(noise.gust * np.sqrt(grown[3:5]), *GUST) if gusts else noise.gust
    colours[noise.coloured > 0] *= np.sqrt(grown[3 + gusts :])
    return noise.with_(
        force=np.clip(noise.force * np.sqrt(grown[:3]), least_force(noise, data, typical), MOST * typical.force),
        white=np.maximum(noise.white * np.sqrt(scattered), LEAST * typical.white),
        coloured=np.where(noise.coloured > 0, np.maximum(colours, LEAST * typical.white), 0.0),
        gust=gust,
    )

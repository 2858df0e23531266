"""Sizes of what is random: where a fit begins, and how they follow from what it left."""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import KNOWN, Adjoint, NoiseModel
from mmg.motion.froude import force_scale, length_scale, state_scale, time_scale
from mmg.ship import Ship


def initial_noise(ship: Ship, data: GriddedTrials) -> NoiseModel:
    """Sizes to start from, by Froude's law from those of a 3 m model."""
    length = float(ship.particulars["L"])
    force = np.array([0.2, 0.3, 0.2 * length_scale(length)]) * force_scale(length)
    white = np.array([0.02, 0.02, 0.003, 0.006, 0.006, 0.001]) * state_scale(length)
    return NoiseModel(force, 6.0 * time_scale(length), white, np.zeros(6), 4.0 * time_scale(length))


def updated_noise(
    noise: NoiseModel, data: GriddedTrials, found: Adjoint, r: np.ndarray, u: np.ndarray, A: int, floor: NoiseModel
) -> NoiseModel:
    """Sizes by one step of the fixed point q <- q sum r^2 / sum N (force, colours) and R <- R sum u^2 / sum D.

    Usual sizes count as KNOWN more samples of each.
    """

    usual = noise.usual
    pull = KNOWN if usual is not None else 0.0
    force, white = (noise.force, noise.white) if usual is None else (usual.force, usual.white)
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
    colours[noise.coloured > 0] *= np.sqrt(grown[3:])
    return noise.with_(
        force=np.maximum(noise.force * np.sqrt(grown[:3]), floor.force),
        white=np.maximum(noise.white * np.sqrt(scattered), floor.white),
        coloured=np.where(noise.coloured > 0, np.maximum(colours, floor.coloured), 0.0),
    )

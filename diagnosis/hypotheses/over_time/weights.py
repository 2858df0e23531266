"""How much each error of a stretch counts: a robust covariance, and estimates of the candidates in short spells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.prediction.innovations import Innovations, scatter

UNEXPLAINED = 8.0
"""A stretch whose squared distance is so many times the usual one was moved by something that the log does not hold."""

SPELL, PARTS = 0.25, 100
"""Longest spell [days]; one of a log shorter than 25 days is this part of it."""

DAY = 86400.0


@dataclass(frozen=True)
class Spells:
    """Estimates of J candidates in B spells.

    day: mean time of each since the log began (B,); information: (B, J, J) and score: (B, J) of the candidates, whose
    estimates one by one are score / information; unexplained: share of the stretches that were moved by something
    else and count no more; distance: squared, of each stretch over the median (S,).
    """

    day: np.ndarray
    information: np.ndarray
    score: np.ndarray
    unexplained: float
    distance: np.ndarray


def spells(found: Innovations, begin: float, end: float, explained: np.ndarray | None = None) -> Spells:
    """Estimates in spells of at most SPELL days from innovations ``found``; ``begin`` and ``end`` of the log [s].

    explained: errors (S, F) that a change is known to make; they do not count for the weights of their stretches.
    """
    length = min(SPELL * DAY, (end - begin) / PARTS)
    cov, distance = scatter(found.errors if explained is None else found.errors - explained)
    usual = float(np.median(distance))
    weight = (distance < UNEXPLAINED * usual).astype(float)
    size = np.sqrt(np.diag(cov))
    inverse = np.linalg.inv(cov / np.outer(size, size) + 1e-9 * np.eye(len(cov)))
    e = found.errors / size
    g = found.gains / size[None, :, None]
    pulled = np.einsum("sfj,fk->skj", g, inverse) * weight[:, None, None]
    information, score = np.einsum("skj,ski->sji", pulled, g), np.einsum("skj,sk->sj", pulled, e)
    number = np.floor((found.t - begin) / length).astype(int)
    kinds, position = np.unique(number, return_inverse=True)
    J = g.shape[2]
    A, b, day, count = (
        np.zeros((len(kinds), J, J)),
        np.zeros((len(kinds), J)),
        np.zeros(len(kinds)),
        np.zeros(len(kinds)),
    )
    np.add.at(A, position, information)
    np.add.at(b, position, score)
    np.add.at(day, position, (found.t - begin) / DAY)
    np.add.at(count, position, 1.0)
    return Spells(day / count, A, b, float(np.mean(weight == 0)), distance / usual)

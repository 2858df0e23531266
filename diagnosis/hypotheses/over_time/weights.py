"""How much each error of a stretch counts: a robust covariance, and estimates of the candidates in short spells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.hypotheses.over_time.innovations import Innovations

FREEDOM = 4.0
"""Degrees of freedom of Student's t that the errors of stretches are taken to follow."""

PASSES = 20
UNEXPLAINED = 8.0
"""A stretch whose squared distance is so many times the usual one was moved by something that the log does not hold."""

SPELL = 0.25
"""Length of a spell [days]."""

DAY = 86400.0


@dataclass(frozen=True)
class Spells:
    """Estimates of J candidates in B spells.

    day: mean time of each since the log began (B,); information: (B, J, J) and score: (B, J) of the candidates, whose
    estimates one by one are score / information; unexplained: share of the stretches that were moved by something
    else; weight, distance: of each stretch (S,), squared distance over its mean.
    """

    day: np.ndarray
    information: np.ndarray
    score: np.ndarray
    unexplained: float
    weight: np.ndarray
    distance: np.ndarray


def scatter(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance (F, F), weights (S,) and squared distances (S,) of ``errors`` (S, F) under Student's t about their
    median (Lange, Little and Taylor 1989, J Am Stat Assoc 84:881-896)."""
    centred = errors - np.median(errors, axis=0)
    size = 1.4826 * np.median(np.abs(centred), axis=0) + 1e-300
    z, F = centred / size, errors.shape[1]
    cov = np.eye(F)
    for _ in range(PASSES):
        distance = np.einsum("sf,sf->s", z @ np.linalg.inv(cov + 1e-9 * np.eye(F)), z)
        weight = (FREEDOM + F) / (FREEDOM + distance)
        cov = (z * weight[:, None]).T @ z / len(z)
    return cov * np.outer(size, size), weight, distance


def spells(found: Innovations, begin: float) -> Spells:
    """Estimates in spells of SPELL days from innovations; ``begin`` of the log [s]."""
    cov, weight, distance = scatter(found.errors)
    size = np.sqrt(np.diag(cov))
    inverse = np.linalg.inv(cov / np.outer(size, size) + 1e-9 * np.eye(len(cov)))
    e = (found.errors - np.median(found.errors, axis=0)) / size
    g = found.gains / size[None, :, None]
    pulled = np.einsum("sfj,fk->skj", g, inverse) * weight[:, None, None]
    information, score = np.einsum("skj,ski->sji", pulled, g), np.einsum("skj,sk->sj", pulled, e)
    number = np.floor((found.t - begin) / (SPELL * DAY)).astype(int)
    kinds, position = np.unique(number, return_inverse=True)
    J = g.shape[2]
    A, b, day, count = np.zeros((len(kinds), J, J)), np.zeros((len(kinds), J)), np.zeros(len(kinds)), np.zeros(len(kinds))
    np.add.at(A, position, information)
    np.add.at(b, position, score)
    np.add.at(day, position, (found.t - begin) / DAY)
    np.add.at(count, position, 1.0)
    usual = float(np.median(distance))
    return Spells(day / count, A, b, float(np.mean(distance > UNEXPLAINED * usual)), weight, distance / usual)

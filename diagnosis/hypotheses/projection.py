"""Slopes of a likelihood along columns that are not in a hypothesis, with what is free in it projected out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Projected:
    """C columns with P free parameters projected out: slopes g (C,) of the log likelihood, their information S (C, C),
    and the multiples (P, C) of the free parameters' columns that were taken off."""

    g: np.ndarray
    S: np.ndarray
    taken: np.ndarray


def projected(gram: np.ndarray, logdet: np.ndarray, p: np.ndarray, known: np.ndarray | None = None) -> Projected:
    """The columns after the first P of a linearisation without what these could imitate.

    gram: (P + C + 1, P + C + 1) products of the whitened columns, the negative residual last; logdet: (P + C,) slopes
    of half the log determinant; p: (P,) free parameters, in prior standard deviations; known: (P, P) inverse covariance
    of the prior (default: one of each).
    """
    P = len(p)
    prior = np.eye(P) if known is None else known
    slope = -(gram[:-1, -1] + logdet)
    slope[:P] -= prior @ p
    taken = np.linalg.solve(gram[:P, :P] + prior, gram[:P, P:-1])
    return Projected(slope[P:] - taken.T @ slope[:P], gram[P:-1, P:-1] - gram[P:-1, :P] @ taken, taken)

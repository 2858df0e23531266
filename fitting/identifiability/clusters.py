"""Coefficients that go together: clusters of correlated ones, directions that trials do not see, an order for plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CORRELATED = 0.9
"""Absolute posterior correlation from which two coefficients belong to one cluster."""


@dataclass(frozen=True)
class Cluster:
    """Coefficients linked by posterior correlations of at least ``CORRELATED``; strongest: the largest of these."""

    symbols: tuple[str, ...]
    strongest: float


@dataclass(frozen=True)
class Direction:
    """A direction on which the data hold less information than the prior although each of its coefficients is excited.

    information: of the data, in units of the prior's; weights: of ``symbols`` in prior standard deviations.
    """

    information: float
    symbols: tuple[str, ...]
    weights: tuple[float, ...]


def clusters(symbols: tuple[str, ...], correlation: np.ndarray) -> tuple[Cluster, ...]:
    """Connected groups of the coefficients ``symbols`` whose ``correlation`` (P, P) is strong, strongest first."""
    off = np.abs(correlation) - np.eye(len(symbols))
    near = off >= CORRELATED
    found, seen = [], np.zeros(len(symbols), dtype=bool)
    for first in range(len(symbols)):
        if seen[first]:
            continue
        group = np.arange(len(symbols)) == first
        while (more := near[group].any(axis=0) & ~group).any():
            group |= more
        seen |= group
        members = np.flatnonzero(group)
        if len(members) > 1:
            strongest = float(off[np.ix_(members, members)].max())
            found.append(Cluster(tuple(symbols[k] for k in members), strongest))
    return tuple(sorted(found, key=lambda c: -c.strongest))


def directions(
    symbols: tuple[str, ...], values: np.ndarray, vectors: np.ndarray, excited: np.ndarray, most: int = 4
) -> tuple[Direction, ...]:
    """Eigen-directions with less information than the prior's, of coefficients of which each alone has more.

    values (P,), vectors (P, P): of the data's information, in rising order; excited: its diagonal (P,); most: symbols
    named in each.
    """
    found = []
    for value, v in zip(values, vectors.T, strict=True):
        if value >= 1.0:
            break
        members = np.argsort(-np.abs(v))[: max(2, int(np.sum(v**2 > 0.05)))][:most]
        if (excited[members] > 1.0).all() and float((v[members] ** 2).sum()) > 0.8:
            v = v * np.sign(v[members[0]])
            weights = tuple(float(round(v[k], 3)) for k in members)
            found.append(Direction(float(max(value, 0.0)), tuple(symbols[k] for k in members), weights))
    return tuple(found)


def order(correlation: np.ndarray) -> np.ndarray:
    """Coefficients (P,) in the order of the leaves of average linkage on 1 - abs(``correlation``), (P, P)."""
    if len(correlation) < 3:
        return np.arange(len(correlation))
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    distance = np.clip(1 - np.abs(correlation), 0, None)
    np.fill_diagonal(distance, 0)
    distance = 0.5 * (distance + distance.T)
    return np.asarray(leaves_list(linkage(squareform(distance, checks=False), "average", optimal_ordering=True)))

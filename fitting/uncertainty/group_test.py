"""Test of values by run for different means in groups of runs, such as two campaigns.

What the values scatter between the runs of a group is estimated (random effects, DerSimonian & Laird 1986), so that a
difference between groups must be larger than that between runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.evidence.tails import f_tail

LEAST = 0.1  # Least standard deviation of a parameter between runs [typical sizes]. Set by hand.
ROUNDS = 30  # Rounds of expectation-maximisation. Set by hand.
# Prior standard deviations of a difference between groups, in typical sizes. A grid set by hand.
SIZES = (0.3, 1.0, 3.0)
# Information on a difference [typical sizes^-2] below which trials do not show it. Set by hand: it bounds a division.
SEEN = 1e-3
FLAT = 1e-6  # Precision of a prior that says nothing. It keeps a matrix regular. Set by hand.


@dataclass(frozen=True)
class GroupTest:
    """A test of p parameters for different values in G groups.

    statistic: chi-squared with ``degrees``; p_single: its probability by chance; log_bayes: log Bayes factor for
    different values; values: (G p,) of each group off those of the fit, with covariance (G p, G p); scatter: (p,)
    standard deviation between the runs of a group. All in typical sizes.
    """

    statistic: float
    degrees: int
    p_single: float
    log_bayes: float
    values: np.ndarray
    covariance: np.ndarray
    scatter: np.ndarray


def members_of(group: np.ndarray, p: int) -> np.ndarray:
    """Which values by run (n p) are of which values by group (G p): (n p, G p) of 0 and 1.

    group: (n,) number of each run's group; p: number of parameters.
    """
    return np.kron((group[:, None] == np.unique(group)).astype(float), np.eye(p))


def scatter_between(g: np.ndarray, S: np.ndarray, members: np.ndarray, p: int) -> np.ndarray:
    """Standard deviation (p,) of values by run about those of their group, by expectation-maximisation.

    g: (n p,) slopes and S: (n p, n p) information of the values of p parameters; members: as of ``members_of``.
    """
    n, q = len(g) // p, members.shape[1]
    both = np.hstack([members, np.eye(n * p)])
    info, slope, std = both.T @ S @ both, both.T @ g, np.ones(p)
    for _ in range(ROUNDS):
        # group means are free
        C = np.linalg.inv(info + np.diag(np.concatenate([np.full(q, FLAT), np.tile(std**-2.0, n)])))
        square = (C @ slope)[q:] ** 2 + np.diag(C)[q:]  # expected square of each run's value off its group
        std = np.maximum(np.sqrt(square.reshape(n, p).mean(axis=0)), LEAST)
    return std


def by_group(g: np.ndarray, S: np.ndarray, members: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope and information of values by group, about which those by run scatter by ``std`` (p,).

    g: (n p,) slopes and S: (n p, n p) information of the values by run; members: as of ``members_of``.
    """
    precision = np.diag(np.tile(std**-2.0, len(g) // len(std)))
    take = np.linalg.solve(S + precision, np.column_stack([S, g]))  # runs' own values, eliminated
    return members.T @ (g - S @ take[:, -1]), members.T @ (S - S @ take[:, :-1]) @ members


def contrasts(slope: np.ndarray, info: np.ndarray, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Slope and information of the differences between groups, the mean being free.

    slope: (G p,) and info: (G p, G p) of values of p parameters by group.
    """
    G = len(slope) // p
    each = np.linalg.svd(np.ones((G, 1)))[0]  # first the mean of all groups, then G - 1 directions across it
    even, basis = (np.kron(x, np.eye(p)) for x in (each[:, :1], each[:, 1:]))
    part = np.linalg.solve(even.T @ info @ even + FLAT * np.eye(p), even.T @ np.column_stack([info, slope]))
    J = basis.T @ (info - info @ even @ part[:, :-1]) @ basis
    return basis.T @ (slope - info @ even @ part[:, -1]), 0.5 * (J + J.T)


def group_test(g: np.ndarray, S: np.ndarray, group: np.ndarray, p: int) -> GroupTest | None:
    """Test values by run for different means in their groups.

    g: (n p,) slopes and S: (n p, n p) information of the values of p parameters in n runs; group: (n,) number of each
    run's group; p: number of parameters. Returns None where nothing is seen of a difference.

    With few runs, scatter between them is not known well: the probability is that of Fisher's F with the degrees of
    freedom of Satterthwaite (1946), by the share of the variance that the scatter makes.
    """
    members = members_of(group, p)
    std = scatter_between(g, S, members, p)
    slope, info = by_group(g, S, members, std)
    score, J = contrasts(slope, info, p)
    values, vectors = np.linalg.eigh(J)
    seen = values > max(SEEN, 1e-8 * values.max(initial=0.0))
    if not seen.any():
        return None
    values, vectors, degrees = values[seen], vectors[:, seen], int(seen.sum())
    along = vectors.T @ score
    statistic = float((along**2 / values).sum())
    without = np.linalg.pinv(contrasts(*by_group(g, S, members, np.full(p, LEAST)), p)[1], rcond=1e-9)  # least scatter
    share = 1 - float(np.mean(np.diag(vectors.T @ without @ vectors) * values))
    spare = max(len(group) - len(np.unique(group)), 1)
    # all scatter: as many degrees as runs to spare
    p_value = f_tail(statistic / degrees, degrees, spare / max(share, 1e-3) ** 2)
    # Bayes factor of a normal prior of each size, and their mean
    logs = [0.5 * float((along**2 / (values + a**-2)).sum() - np.log1p(a**2 * values).sum()) for a in SIZES]
    log_bayes = float(np.logaddexp.reduce(logs) - np.log(len(logs)))
    covariance = np.linalg.inv(info + FLAT * np.eye(len(info)))
    return GroupTest(statistic, degrees, p_value, log_bayes, covariance @ slope, covariance, std)


def holm(p: Sequence[float]) -> np.ndarray:
    """The m probabilities ``p`` corrected for their number (Holm 1979), in the same order, (m,)."""
    order, corrected = np.argsort(p), np.empty(len(p))
    # never below a smaller p
    raised = np.maximum.accumulate(np.array(p, dtype=float)[order] * np.arange(len(p), 0, -1))
    corrected[order] = np.minimum(raised, 1.0)
    return corrected

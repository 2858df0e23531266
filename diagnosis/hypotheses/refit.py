"""Candidates refitted: coefficients, effect, latent force and noise together, compared by the same measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cases.evidence.tails import chi2_tail, f_tail
from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.candidates import Candidate, Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.parameters import Priors, active_states, get_values, priors_of_effects, set_values
from diagnosis.estimation.transition_model import TransitionModel
from mmg.errors import UserError
from mmg.motion.froude import time_scale

SHARES = (1.0, 0.3, 0.0)
"""Shares of the first values of new effects that a fit is begun from, one after the other while the ship explodes."""


def gained(fewer: Estimate, kept: int, more: Estimate, every: int) -> float:
    """Log likelihood that the fit ``more`` gains over ``fewer``, without the priors of their last ``kept`` and
    ``every`` columns, which are of effects."""
    of_effects = [found.p[len(found.p) - own :] for found, own in ((fewer, kept), (more, every))]
    return fewer.nll - more.nll - 0.5 * float(of_effects[0] @ of_effects[0] - of_effects[1] @ of_effects[1])


def refit(
    steps: TransitionModel,
    data: GriddedTrials,
    base: Priors,
    before: Estimate,
    effects: Sequence[Candidate],
    start: Mapping[Column, float],
    iterations: int = 8,
    is_rough: bool = False,
) -> Estimate:
    """Fit with these ``effects``, from the fit ``before`` with fewer.

    steps: the transition model; data: the trials; base: priors of the coefficients; start: first values of the effects'
    parameters, and of those coefficients that do not begin where they are; iterations: linearisations at most;
    is_rough: as of ``estimate``. Returns the fit.

    Where an effect has a prior among those of ``base``, as known from other trials, that is set aside. Where the ship
    explodes at the first values of new effects, these are moved towards neutral.
    """
    more = priors_of_effects(effects)
    free = base.only([s not in more.symbols for s in base.symbols]) + more
    first = np.array([start.get(c, m) for c, m in zip(more.columns, more.mean, strict=True)])
    new = np.array([c not in before.free.columns for c in more.columns])
    moved = [c for c in free.columns if c in start and c not in more.columns]
    here, there = get_values(steps.ship, data, before.theta, moved), np.array([start[c] for c in moved])
    for share in SHARES:
        begin = np.where(new, more.mean + share * (first - more.mean), first)
        begin = np.concatenate([begin, here + share * (there - here)])
        try:
            start_at = _start(steps, data, free, before, [*more.columns, *moved], begin)
            return estimate(steps, data, start_at, iterations, is_rough=is_rough)
        except UserError:
            if share == SHARES[-1]:
                raise
    raise AssertionError("the last share returns or raises")


def _start(
    steps: TransitionModel,
    data: GriddedTrials,
    free: Priors,
    before: Estimate,
    columns: Sequence[Column],
    first: np.ndarray,
) -> Point:
    """Where the fit of ``free`` starts: from the fit ``before``, with first values of these columns."""
    theta = set_values(steps.ship, data, before.theta, columns, first)
    p = (get_values(steps.ship, data, theta, free.columns) - free.mean) / free.std
    active = active_states(steps, free.symbols, theta)
    asleep = np.setdiff1d(active, active_states(steps, before.free.symbols, before.theta))
    path = before.path
    if len(asleep):
        controls = acting(steps, data, theta).controls
        path = path.along(steps.with_passive_states(path.z, controls, theta, path.push, asleep))
    return Point(theta, free, p, path, before.noise)


def followed_without(found: Estimate, effect: Candidate) -> dict[Column, float]:
    """Values of the other free parameters of the fit ``found`` where an ``effect`` is neutral, to first order:
    their means given that."""
    free = found.free
    own = np.array([free.columns.index(c) for c in effect.columns])
    rest = np.setdiff1d(np.arange(len(found.p)), own)
    away = (effect.neutral - free.mean[own]) / free.std[own] - found.p[own]
    moved = found.covariance[np.ix_(rest, own)] @ np.linalg.solve(found.covariance[np.ix_(own, own)], away)
    low, high = (bound[rest] for bound in free.scaled_bounds)
    p = np.clip(found.p[rest] + moved, low, high)
    values = free.mean[rest] + free.std[rest] * p
    return {free.columns[i]: float(value) for i, value in zip(rest, values, strict=True)}


def wald_p(found: Estimate, effect: Candidate) -> float:
    """Probability that an ``effect`` is as far from neutral by chance, by the standard errors of the fit ``found``."""
    own = np.array([found.free.columns.index(c) for c in effect.columns])
    move = found.p[own] - (effect.neutral - found.free.mean[own]) / found.free.std[own]
    return chi2_tail(float(move @ np.linalg.solve(found.covariance[np.ix_(own, own)], move)), len(own))


BLOCK, SPARE = 20.0, 4
"""Runs are clusters if they are at least SPARE more than parameters; else blocks of BLOCK seconds [of a 3 m model]."""


def clusters(data: GriddedTrials, parameters: int, length: float) -> np.ndarray:
    """Cluster of each grid time of each window of ``data``, (K + 1, R): its run or, with few runs, a block of it.

    parameters: how many are tested; length: of the ship [m].
    """
    runs = np.broadcast_to(data.run, data.good.shape[:2])
    if len(np.unique(data.run)) >= parameters + SPARE:
        return runs
    block = max(1, round(BLOCK * time_scale(length) / data.h))
    within = np.arange(len(data.good))[:, None] // block + np.zeros_like(runs)
    return np.arange(runs.shape[1]) * (within.max() + 1) + within


def robust_p(steps: TransitionModel, data: GriddedTrials, found: Estimate, effect: Candidate) -> float:
    """Probability of an ``effect`` by how well the runs agree on it (cluster-robust Wald test, ``clusters``).

    steps: the transition model; data: the trials; found: the fit.

    The covariance of the estimate is taken from the scatter of the clusters' slopes about the fit instead of from the
    model of the noise (Liang & Zeger 1986). An effect that one run alone shows is not doubted by this.
    """
    linearised = linearise_and_filter(steps, data, found)
    own = np.array([found.free.columns.index(c) for c in effect.columns])
    rest = np.setdiff1d(np.arange(len(found.p)), own)
    white = linearised.white.reshape(*linearised.white.shape[:2], 6, -1)
    gram = np.einsum("krca,krcb->ab", white, white, optimize=True)
    A = gram[:-1, :-1] + np.eye(len(found.p))
    project = np.linalg.solve(A[np.ix_(rest, rest)], A[np.ix_(rest, own)])
    S = A[np.ix_(own, own)] - A[np.ix_(own, rest)] @ project
    there = data.good.any(axis=2)
    slope = -np.einsum("krca,krc->kra", white[..., :-1], white[..., -1])
    slope -= (
        np.where(there, 1.0, 0.0)[..., None] / np.maximum(there.sum(axis=0), 1)[:, None] * linearised.logdet_gradient
    )
    each = slope[..., own] - slope[..., rest] @ project
    names, number = np.unique(clusters(data, len(own), float(steps.ship.particulars["L"])), return_inverse=True)
    sums = np.zeros((len(names), len(own)))
    np.add.at(sums, number.reshape(there.shape), each)
    sums = sums[np.bincount(number.ravel(), there.ravel(), len(names)) > 0]
    R, q = len(sums), len(own)
    if q + 2 > R:
        return 0.0
    sums -= sums.mean(axis=0)
    V = sums.T @ sums * R / (R - 1)
    move = S @ (found.p[own] - (effect.neutral - found.free.mean[own]) / found.free.std[own])
    T = float(move @ np.linalg.pinv(V, rcond=1e-9, hermitian=True) @ move)
    return f_tail(T * (R - q) / (q * (R - 1)), q, R - q)

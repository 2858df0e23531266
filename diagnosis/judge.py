"""Candidates refitted: coefficients, effect, latent force and noise together, compared by the same measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import f as f_law

from diagnosis.data import Data
from diagnosis.latent import Estimate, Path, Priors, active_states, estimate, look_around
from diagnosis.steps import Steps
from diagnosis.wide import WIDE, Candidate


def priors_of_effects(candidates: Sequence[Candidate]) -> Priors:
    """Wide priors about the neutral values."""
    join = {k: np.concatenate([getattr(c, k) for c in candidates]) for k in ("neutral", "typical", "lower", "upper")}
    symbols = tuple(s for c in candidates for s in c.symbols)
    return Priors(symbols, join["neutral"], WIDE * join["typical"], join["lower"], join["upper"])


def likelihood(found: Estimate, own: int) -> float:
    """Negative log likelihood without the prior of the last ``own`` columns, the effects'."""
    return found.nll - 0.5 * float(found.p[len(found.p) - own :] @ found.p[len(found.p) - own :])


def refit(
    steps: Steps,
    data: Data,
    base: Priors,
    before: Estimate,
    effects: Sequence[Candidate],
    start: Mapping[str, float],
    iterations: int = 8,
) -> Estimate:
    """The fit with these effects, from a fit with fewer; start: values of their parameters to begin with."""
    more = priors_of_effects(effects)
    free = base + more
    P = len(base.symbols)
    own = np.array([start.get(s, m) for s, m in zip(more.symbols, more.mean, strict=True)])
    p = np.concatenate([before.p[:P], (own - more.mean) / more.std])
    theta = before.theta.copy()
    at = [steps.ship.symbols.index(s) for s in more.symbols]
    theta[at] = own
    active = active_states(steps, free.symbols, theta)
    asleep = np.setdiff1d(active, active_states(steps, before.free.symbols, before.theta))
    path = before.path
    if len(asleep):
        path = Path(steps.remembered(path.z, data.inputs, theta, path.force, asleep), path.force)
    return estimate(steps, data, theta, free, before.noise, path, p, iterations)


def robust_p(steps: Steps, data: Data, found: Estimate, effect: Candidate) -> float:
    """Probability of an effect by how well the runs agree on it (cluster-robust Wald test, runs as clusters).

    The covariance of the estimate is taken from the scatter of the runs' slopes about the fit instead of from the model
    of the noise (Liang & Zeger 1986). An effect that one run alone shows is not doubted by this.
    """
    active = active_states(steps, found.free.symbols, found.theta)
    around = look_around(steps, data, found.theta, found.path, found.noise, found.free, found.p, active)
    own = np.array([found.free.symbols.index(s) for s in effect.symbols])
    rest = np.setdiff1d(np.arange(len(found.p)), own)
    grams = np.einsum("krca,krcb->rab", around.white, around.white, optimize=True)
    gram = grams.sum(axis=0)
    A = gram[:-1, :-1] + np.eye(len(found.p))
    project = np.linalg.solve(A[np.ix_(rest, rest)], A[np.ix_(rest, own)])
    S = A[np.ix_(own, own)] - A[np.ix_(own, rest)] @ project
    slope = -(grams[:, :-1, -1] + around.bend)
    by_window = slope[:, own] - slope[:, rest] @ project
    runs = np.unique(data.run)
    by_run = np.array([by_window[data.run == r].sum(axis=0) for r in runs])
    by_run -= by_run.mean(axis=0)
    R, q = len(runs), len(own)
    if q + 2 > R:
        return 0.0
    V = by_run.T @ by_run * R / (R - 1)
    move = S @ (found.p[own] - (effect.neutral - found.free.mean[own]) / found.free.std[own])
    T = float(move @ np.linalg.pinv(V, rcond=1e-9, hermitian=True) @ move)
    return float(f_law.sf(T * (R - q) / (q * (R - 1)), q, R - q))

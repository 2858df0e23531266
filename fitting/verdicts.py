"""What became of the coefficients, in numbers for the ship file and in words for a person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.ipopt import Solution
from fitting.problem import Prior, Problem
from fitting.settings import Start
from mmg.ship import Ship

DETERMINED, PARTLY = 0.1, 0.7
"""Prior's share of the posterior variance below which the data determine a coefficient, or have a say in it."""


def at_bound(p: float, lower: float, upper: float) -> str:
    """ "lower", "upper" or "" for a scaled coefficient against its scaled bounds."""
    if p <= lower + 1e-4:
        return "lower"
    return "upper" if p >= upper - 1e-4 else ""


def verdict(share: float, where: str) -> str:
    """A sentence on what decided a coefficient; share: posterior over prior variance (1: the data said nothing)."""
    if where:
        return f"at its {where} bound: the data ask for a value outside the range given"
    if not np.isfinite(share):
        return "its uncertainty could not be computed"
    if share < DETERMINED:
        return f"determined by the data (the prior's share of the variance is {share:.0%})"
    if share < PARTLY:
        return f"partly determined by the data (the prior's share of the variance is {share:.0%})"
    return f"decided by the prior (its share of the variance is {min(share, 1):.0%})"


def calibrated_ship(ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, converged: bool) -> Ship:
    """The ship with estimates, standard errors, priors and verdicts.

    p: scaled estimate (P,); covariance: (P, P) in prior standard deviations. An estimate that did not converge says so.
    """
    changed = {}
    for i, symbol in enumerate(prior.symbols):
        c = ship.coefficients[symbol]
        share = float(covariance[i, i])
        where = at_bound(
            p[i], (prior.lower[i] - prior.mean[i]) / prior.std[i], (prior.upper[i] - prior.mean[i]) / prior.std[i]
        )
        words = verdict(share, where)
        value = float(np.clip(prior.mean[i] + prior.std[i] * p[i], prior.lower[i], prior.upper[i]))
        std = float(np.sqrt(share) * prior.std[i]) if np.isfinite(share) else c.std
        changed[symbol] = c.with_(
            value=value,
            std=std,
            prior_value=float(prior.mean[i]),
            prior_std=float(prior.std[i]),
            verdict=words if converged else f"NOT CONVERGED; {words}",
            source="calibrated by mmg fit" if "calibrated by mmg fit" in c.source or not c.source
            else f"calibrated by mmg fit; prior: {c.source}",
        )  # fmt: skip
    return replace(ship.with_coefficients(changed), notices=())


def warnings_of(problem: Problem, best: Solution, p: np.ndarray, starts: list[Start]) -> list[str]:
    """Sentences on what a user must know before using the estimates; p: scaled estimate (P,)."""
    words = []
    if not best.converged:
        words.append(f"not converged ({best.status}): {best.advice or 'the best iterate is kept'}")
    lower, upper = problem.p_bounds()
    hit = [
        f"{s} ({where})"
        for s, value, lo, hi in zip(problem.prior.symbols, p, lower, upper, strict=True)
        if (where := at_bound(value, lo, hi))
    ]
    if hit:
        words.append(f"at a bound: {', '.join(hit)}")
    away = [s for s, value in zip(problem.prior.symbols, p, strict=True) if abs(value) > 3]
    if away:
        words.append(f"more than three prior standard deviations from the prior: {', '.join(away)}")
    other = [s for s in starts if s.converged and s.objective > best.objective * (1 + 1e-5) + 1e-6]
    if other:
        words.append(f"{len(other)} of {len(starts)} starts ended in another optimum; the lowest objective is kept")
    return words

"""What became of the coefficients, in numbers for the ship file and in words for a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.identifiability.analysis import DETERMINED, WORSE, CoefficientFinding, Identifiability, at_bound
from fitting.identifiability.plausibility import implausible
from fitting.nlp.problem import Prior, Problem
from fitting.settings import Start
from fitting.solvers.ipopt import Solution
from fitting.solvers.multistart import disagreement
from mmg.messages import Message
from mmg.ship import Ship


def cause(finding: CoefficientFinding, missing: str = "") -> str:
    """What decided a coefficient, in words, from its ``finding``; missing: what trials that excite it have and these
    have not."""
    names = listed(finding.partners)
    if finding.kind == "bound":
        return f"at its {finding.bound} bound: the data ask for a value outside the range given"
    if finding.kind == "unknown":
        return "its uncertainty could not be computed"
    if finding.kind == "determined":
        return "determined by the data"
    if finding.kind == "partly":
        return "partly determined by the data" + (f", what is missing is shared with {names}" if names else "")
    if finding.kind == "silent":
        return "not excited by these trials" + (f", which have no {missing}" if missing else "")
    if finding.kind == "prior" and finding.share > WORSE:
        return "no better known than by its prior: correlated residuals made it worse; fix it or narrow its prior"
    if finding.kind == "prior":
        return "decided by the prior" + (f", what the data say is shared with {names}" if names else "")
    if not names:
        return "shared with many coefficients: only combinations of them are determined"
    if finding.together >= DETERMINED:
        return f"shared with {', '.join(finding.partners)} and others: only combinations of them are determined"
    return f"shared with {names}: the data determine only {finding.combination or 'their combination'}"


def verdict(finding: CoefficientFinding, missing: str = "") -> str:
    """A sentence on what decided a coefficient, with the prior's share; finding, missing: see ``cause``."""
    words = cause(finding, missing)
    if finding.kind in ("bound", "unknown"):
        return words
    known = "it were known" if len(finding.partners) == 1 else "they were known"
    tied = f", {finding.together:.0%} if {known}" if finding.kind == "shared" and finding.partners else ""
    if finding.share > WORSE:
        return f"{words} (its variance is {finding.share:.2g} times the prior's{tied})"
    return f"{words} (the prior's share of the variance is {min(finding.share, 1):.0%}{tied})"


def listed(names: Sequence[str]) -> str:
    """ "a", "a and b" or "a, b and c" of ``names``."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def calibrated_ship(
    ship: Ship,
    prior: Prior,
    p: np.ndarray,
    covariance: np.ndarray,
    found: Identifiability,
    converged: bool,
) -> Ship:
    """The ``ship`` with estimates, standard errors, priors and verdicts.

    prior: of the P free coefficients; p: scaled estimate (P,); covariance: (P, P) in prior standard deviations;
    found: what decided each coefficient; converged: an estimate that did not says so.
    """
    changed = {}
    for i, finding in enumerate(found.findings):
        symbol, words = finding.symbol, verdict(finding)
        c, share = ship.coefficients[symbol], float(covariance[i, i])
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


def estimate_warnings(problem: Problem, best: Solution, p: np.ndarray, starts: list[Start]) -> list[Message]:
    """Warnings before the estimates are used: convergence, bounds, plausibility, agreement of the starts.

    problem: as solved; best: the best of its solutions, from ``starts``; p: scaled estimate (P,).
    """
    found = []
    if not best.converged:
        words = f"not converged ({best.status}): {best.advice or 'the best iterate is kept'}"
        found.append(Message(words, "not_converged"))
    lower, upper = problem.p_bounds()
    hit = [
        f"{s} ({where})"
        for s, value, lo, hi in zip(problem.prior.symbols, p, lower, upper, strict=True)
        if (where := at_bound(value, lo, hi))
    ]
    if hit:
        found.append(Message(f"at a bound: {', '.join(hit)}", "at_bound"))
    away = [s for s, value in zip(problem.prior.symbols, p, strict=True) if abs(value) > 3]
    if away:
        words = f"more than three prior standard deviations from the prior: {', '.join(away)}"
        found.append(Message(words, "far_from_prior"))
    values = problem.prior.mean + problem.prior.std * p
    found += implausible(problem.prior, dict(zip(problem.prior.symbols, values.tolist(), strict=True)))
    return [*found, *disagreement(starts, best.objective)]

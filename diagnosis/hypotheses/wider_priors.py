"""The hypothesis that the coefficients of the ship are less well known than their priors state.

All widths are multiplied by one factor, the likeliest one (MacKay 1992, Bayesian interpolation, Neural Computation 4,
section 3): where a rule of thumb is off, many coefficients are. An effect that moves several of them together then
brings them all back to their priors, though the trials say nothing of it: of tankers made from particulars whose force
models were others, two of three had half their draught for a cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.first_fit import MAX_FITS
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.forward_selection import ODDS, Selection
from diagnosis.hypotheses.refit import SearchProblem, refit

ROUNDS = 4  # Of the fixed point at most. Set by hand: it settles in two or three.
SETTLED = 0.1  # Change of the factor in a round, of its logarithm, below which it has settled. Set by hand.


@dataclass(frozen=True)
class WiderPriors:
    """A ``problem`` whose priors are ``factor`` times as wide, its ``fit``, and the evidence for them in log units
    against the priors as they were."""

    problem: SearchProblem
    fit: Estimate
    factor: float
    evidence: float


def wider_priors(problem: SearchProblem, before: Estimate, named: Sequence[Candidate]) -> WiderPriors | None:
    """The likeliest widths of the priors of coefficients, or None where they are not wider than stated.

    problem: with the priors as stated; before: its fit with the effects ``named``.
    """
    start = {x: before.value(*x) for c in named for x in c.columns}
    own = np.array(["." not in s for s in problem.base.symbols])  # of the ship herself
    wider, fit, factor = problem, before, 1.0
    for _ in range(ROUNDS):
        at = np.array(["." not in s for s in fit.free.symbols])
        told = at.sum() - np.trace(fit.covariance[np.ix_(at, at)])  # how many coefficients the trials tell
        change = float(np.sqrt(fit.p[at] @ fit.p[at] / max(told, 1.0)))
        if factor * change <= 1 or abs(np.log(change)) < SETTLED:
            break
        factor *= change
        base = problem.base
        wider = replace(problem, base=replace(base, std=np.where(own, factor, 1.0) * base.std))
        fit = refit(wider, fit, named, start, MAX_FITS)
    return None if wider is problem else WiderPriors(wider, fit, factor, _evidence(fit) - _evidence(before))


def _evidence(fit: Estimate) -> float:
    """Logarithm of the marginal likelihood of a ``fit`` by Laplace's approximation, less a constant."""
    return 0.5 * float(np.linalg.slogdet(fit.covariance)[1]) - fit.nll


def likely_widths(problem: SearchProblem, found: Selection) -> WiderPriors | None:
    """Wider priors with the fit without effects, by which all is to be asked anew, or None where those stated do.

    problem: in which the effects ``found`` were selected. They do not where wider ones alone have as much evidence as
    all effects, to within ODDS, and where they have more than ODDS beside these.
    """
    least = max(ODDS, sum(found.evidence) - ODDS)
    alone = wider_priors(problem, found.null, ())
    if alone and alone.evidence > least:
        return alone
    beside = wider_priors(problem, found.final, found.effects) if found.effects else None
    if beside and beside.evidence > ODDS:
        return replace(beside, fit=refit(beside.problem, found.null, (), {}, MAX_FITS))
    return None

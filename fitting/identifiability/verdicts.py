"""What became of the coefficients, in numbers for the ship file and in words for a person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.identifiability.analysis import DETERMINED, WORSE, CoefficientFinding, Identifiability, at_bound
from fitting.nlp.problem import Prior, Problem
from fitting.settings import Start
from fitting.solvers.solve import Solution, disagreement
from mmg.messages import Message
from mmg.ship import Ship

PHYSICAL: dict[str, tuple[float, float]] = {
    "t_P": (0.0, 0.4), "w_P0": (0.0, 0.8), "x_P": (-0.7, -0.3), "t_R": (0.0, 0.6), "a_H": (0.0, 1.0),
    "x_H": (-0.6, -0.3), "epsilon": (0.7, 1.6), "ell_R": (-1.2, -0.5), "gamma_P": (0.2, 0.8), "gamma_N": (0.2, 0.8),
    "gamma_R_plus": (0.2, 0.8), "gamma_R_minus": (0.2, 0.8), "X_0F": (-math.inf, 0.0), "X_0A": (-math.inf, 0.0),
    "R_0": (0.0, math.inf), "Y_v": (-math.inf, 0.0), "N_v": (-math.inf, 0.0), "N_r": (-math.inf, 0.0),
    "C_D": (0.0, math.inf), "k_0": (0.0, math.inf),
}  # fmt: skip
"""Ranges outside which a coefficient is no longer physical: it stands in for something that the model lacks.

Engineering judgement for merchant ships; public fits of the ESSO OSAKA records leave most of them.
"""
ADDED_MASSES = ("m_x", "m_y", "I_J_z")
WITHIN_PRIOR = 2.0
"""Prior standard deviations within which the estimate of an added mass must lie: 95 % of the prior."""
HIDDEN = (
    "see what the trials may hide: an antenna off midship, a current, inputs logged at samples but taken as held "
    "(mmg diagnose)"
)
"""Where a coefficient that left its prior sends the reader: never to the prior, which is what knows of the ship."""
REMEDIES = (
    f"{HIDDEN}; reference_point and inputs in trials.toml say what is known, --with antenna_offset and --with current "
    "fit what is not"
)
"""The same with what to do, for a warning."""


def cause(finding: CoefficientFinding, missing: str = "") -> str:
    """What decided a coefficient, in words, from its ``finding``; missing: what trials that excite it have and these
    have not."""
    names, kind = listed(finding.partners), finding.kind
    if kind == "strained":
        return (
            f"in conflict with the prior: {abs(finding.shift):.1f} prior standard deviations away although the trials "
            f"hardly tell it; {HIDDEN}"
        )
    if kind == "prior" and finding.share > WORSE:
        return "no better known than by its prior: windows, runs or estimators disagree on it by more than that leaves"
    if kind == "shared":
        if not names:
            return "shared with many coefficients: only combinations of them are determined"
        if finding.together >= DETERMINED:
            return f"shared with {', '.join(finding.partners)} and others: only combinations of them are determined"
        return f"shared with {names}: the data determine only {finding.combination or 'their combination'}"
    return {
        "bound": f"at its {finding.bound} bound: the data ask for a value outside the range given",
        "unknown": "its uncertainty could not be computed",
        "determined": "determined by the data",
        "partly": "partly determined by the data" + (f", what is missing is shared with {names}" if names else ""),
        "silent": "not excited by these trials" + (f", which have no {missing}" if missing else ""),
        "prior": "decided by the prior" + (f", what the data say is shared with {names}" if names else ""),
    }[kind]


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


def listed(names: Sequence[str], last: str = " and ") -> str:
    """ "a", "a and b" or "a, b and c" of ``names``; last: what stands before the last one."""
    return last.join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def calibrated_ship(
    ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, found: Identifiability, converged: bool
) -> Ship:
    """The ``ship`` with estimates, standard errors, priors and verdicts.

    prior: of the P free coefficients; p: scaled estimate (P,); covariance: (P, P) in prior standard deviations;
    found: what decided each coefficient; converged: an estimate that did not says so.
    """
    own, changed = "calibrated by mmg fit", {}
    for symbol, mean, std in zip(prior.symbols, prior.mean.tolist(), prior.std.tolist(), strict=True):
        source = ship.coefficients[symbol].source
        source = own if own in source or not source else f"{own}; prior: {source}"
        changed[symbol] = ship.coefficients[symbol].with_(prior_value=mean, prior_std=std, source=source)
    known = replace(ship.with_coefficients(changed), notices=())
    return with_estimates(known, prior, p, covariance, found, converged)


def with_estimates(
    ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, found: Identifiability, converged: bool
) -> Ship:
    """A calibrated ``ship`` with other estimates, standard errors and verdicts.

    prior, p (P,), covariance (P, P), found, converged: as of ``calibrated_ship``.
    """
    changed = {}
    for i, finding in enumerate(found.findings):
        words = verdict(finding)
        c, share = ship.coefficients[finding.symbol], float(covariance[i, i])
        changed[c.symbol] = c.with_(
            value=float(np.clip(prior.mean[i] + prior.std[i] * p[i], prior.lower[i], prior.upper[i])),
            std=float(np.sqrt(share) * prior.std[i]) if np.isfinite(share) else c.std,
            verdict=words if converged else f"NOT CONVERGED; {words}",
        )
    return ship.with_coefficients(changed)


def estimate_warnings(problem: Problem, best: Solution, p: np.ndarray, starts: list[Start]) -> list[Message]:
    """Warnings before the estimates are used: convergence, bounds, plausibility, agreement of the starts.

    problem: as solved; best: the best of its solutions, from ``starts``; p: scaled estimate (P,).
    """
    found = []
    if not best.converged:
        words = f"not converged ({best.status}): {best.advice or 'the best iterate is kept'}"
        found.append(Message(words, "not_converged"))
    prior = problem.prior
    ends = [at_bound(*scaled) for scaled in zip(p, *prior.scaled_bounds, strict=True)]
    hit = [f"{s} ({end})" for s, end in zip(prior.symbols, ends, strict=True) if end]
    if hit:
        found.append(Message(f"at a bound: {', '.join(hit)}", "at_bound"))
    away = [s for s, value in zip(prior.symbols, p, strict=True) if abs(value) > 3]
    if away:
        words = f"more than three prior standard deviations from the prior: {', '.join(away)}; {REMEDIES}"
        found.append(Message(words, "far_from_prior"))
    found += implausible(prior, dict(zip(prior.symbols, (prior.mean + prior.std * p).tolist(), strict=True)))
    return [*found, *disagreement(starts, best.objective)]


def implausible(prior: Prior, values: dict[str, float]) -> list[Message]:
    """Warnings on ``values`` (symbol -> estimate) outside their physical range; on added masses far from ``prior``."""
    outside, far = [], []
    for symbol, value in values.items():
        low, high = PHYSICAL.get(symbol, (-math.inf, math.inf))
        if low <= value <= high:
            continue
        limits = f"{low:g} to {high:g}"
        if math.inf in (-low, high):
            limits = f"at most {high:g}" if math.isfinite(high) else f"at least {low:g}"
        outside.append(f"{symbol} = {value:.3g} is outside its physical range ({limits})")
    for symbol, mean, std in zip(prior.symbols, prior.mean, prior.std, strict=True):
        shift = (values.get(symbol, mean) - mean) / std
        if symbol in ADDED_MASSES and abs(shift) > WITHIN_PRIOR:
            far.append(f"{symbol} = {values[symbol]:.3g} is {abs(shift):.1f} prior standard deviations from its prior")
    found = [Message(f"{', '.join(outside)}: {REMEDIES}", "implausible")] if outside else []
    if far:
        words = f"{', '.join(far)}, though trials hardly determine added masses: {REMEDIES}"
        found.append(Message(words, "added_mass_far_from_prior"))
    return found

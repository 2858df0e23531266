"""What trials say about each coefficient: prior's share, partners it is confounded with, clusters.

Everything follows from the posterior covariance C in prior standard deviations, in which the prior is the identity:
C_ii is the prior's share of the variance, 1 / (C^-1)_ii what would be left of it if all other coefficients were known.
A coefficient whose C_ii is large although that remainder is small is not badly excited but shared: the trials see a
combination of it and its partners (practical non-identifiability, Raue et al. 2009).

Shares are those of a robust covariance if there is one. Which coefficients go together is taken from the information of
the model, discounted by one factor: correlations estimated from a few tens of windows would be mostly chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.nlp.problem import Prior, Problem
from fitting.settings import Start
from fitting.solvers.solve import Solution, disagreement
from mmg.messages import Message
from mmg.ship import Ship

# Prior's share of the posterior variance below which the data determine a coefficient.
DETERMINED = 0.1  # set by hand: it names a class and changes no estimate
PARTLY = 0.7  # The same below which they have a say in it. Set by hand: a class.
# Ratio of posterior to prior variance above which correlated residuals made the estimate worse.
WORSE = 1.2  # set by hand: a class
# Prior standard deviations from the prior beyond which an estimate that the trials hardly tell contradicts it. A share
# of PARTLY leaves the estimate sqrt(1 - PARTLY) = 0.55 prior standard deviations of chance. Set by hand.
STRAINED = 2.0
# Information of the data, by the prior's, below which a coefficient is not excited at all. Set by hand: a class.
SILENT = 0.1
MOST_PARTNERS = 4  # Partners named at most. Set by hand: a sentence.
LEAST_GAIN = 0.1  # Part of the variance that knowing one more partner must remove. Set by hand.
# Absolute posterior correlation from which two coefficients belong to one cluster. Set by hand: it names a class.
CORRELATED = 0.9
# Scaled distance [-] from a bound up to which an estimate is at it, as solvers end inside. Set by hand.
AT_BOUND = 1e-4
# Kinds of findings in words.
KINDS = {
    "determined": "determined by the data",
    "partly": "partly determined",
    "shared": "shared with others",
    "prior": "decided by the prior",
    "silent": "not excited",
    "strained": "in conflict with the prior",
    "bound": "at a bound",
    "unknown": "unknown",
}


@dataclass(frozen=True)
class Cluster:
    """Coefficients linked by posterior correlations of at least ``CORRELATED``; strongest: the largest of these."""

    symbols: tuple[str, ...]
    strongest: float


@dataclass(frozen=True)
class CoefficientFinding:
    """What decided one coefficient.

    symbol: the coefficient. kind: "determined", "partly", "shared", "prior", "silent" (not excited), "strained" (hardly
    told by the trials, and still far from its prior), "bound" or "unknown".
    share: prior's share of the posterior variance. alone: the share that would be left if all others were known.
    partners: coefficients it is confounded with, the most important first; together: the share that would be left
    if these were known. bound: "lower", "upper" or "". shift: of the estimate from the prior, in prior standard
    deviations.
    """

    symbol: str
    kind: str
    share: float
    alone: float
    partners: tuple[str, ...] = ()
    together: float = float("nan")
    bound: str = ""
    shift: float = float("nan")


@dataclass(frozen=True)
class Identifiability:
    """Findings by coefficient and clusters of a calibration.

    findings: one per free coefficient, in the prior's order. clusters: see there, strongest first.
    condition_number: of the data's information in prior standard deviations, infinite when it is singular.
    correlation: (P, P).
    """

    findings: tuple[CoefficientFinding, ...]
    clusters: tuple[Cluster, ...]
    condition_number: float
    correlation: np.ndarray

    def to_dict(self) -> dict[str, Any]:
        """Plain values for result.json; counts: of the coefficients of each kind."""
        kinds = [f.kind for f in self.findings]
        return {
            "counts": {kind: kinds.count(kind) for kind in KINDS if kind in kinds},
            "coefficients": {
                f.symbol: {
                    "kind": f.kind,
                    "prior_share": f.share,
                    "share_if_all_others_were_known": f.alone,
                    "share_if_partners_were_known": f.together,
                    "partners": list(f.partners),
                    "cause": cause(f),
                }
                for f in self.findings
            },
            "clusters": [{"symbols": list(c.symbols), "correlation": c.strongest} for c in self.clusters],
            "condition_number": self.condition_number,
        }


def at_bound(p: float, lower: float, upper: float) -> str:
    """ "lower", "upper" or "" for a scaled coefficient ``p`` against its scaled bounds ``lower`` and ``upper``."""
    if p <= lower + AT_BOUND:
        return "lower"
    return "upper" if p >= upper - AT_BOUND else ""


def precision(covariance: np.ndarray) -> np.ndarray:
    """Inverse (P, P) of a covariance, symmetric, with its eigenvalues kept positive."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    values = np.maximum(values, 1e-12 * max(values[-1], 1e-300))  # rounding
    return (vectors / values) @ vectors.T


def analyse(
    prior: Prior, p: np.ndarray, covariance: np.ndarray, information: np.ndarray | None = None
) -> Identifiability:
    """What the trials say about each coefficient.

    prior: of the P free coefficients; p: scaled estimate (P,); covariance: (P, P) in prior standard deviations.
    information: of the data, (P, P), for the condition number; default what the covariance
    implies. A covariance that is not finite gives findings of kind "unknown".
    """
    P, nan = len(prior.symbols), float("nan")
    bounds = [at_bound(*z) for z in zip(p, *prior.scaled_bounds, strict=True)]
    if not np.isfinite(covariance).all() or (np.diag(covariance) <= 0).any():
        unknown = tuple(
            CoefficientFinding(s, "bound" if bound else "unknown", nan, nan, bound=bound)
            for s, bound in zip(prior.symbols, bounds, strict=True)
        )
        return Identifiability(unknown, (), nan, np.full((P, P), nan))
    data = precision(covariance) - np.eye(P) if information is None else information
    worth = 1.0 if information is None else information_discount(data, covariance)
    inverse = worth * data + np.eye(P)
    C = precision(inverse)  # correlations by the model, sizes by the robust covariance (head of this file)
    std, own = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(C))
    correlation = C / np.outer(own, own)
    C = correlation * np.outer(std, std)
    alone, excited = ((std / own) ** 2 / np.diag(inverse)).tolist(), (np.diag(data) >= SILENT).tolist()
    values = np.linalg.eigvalsh(0.5 * (data + data.T))
    return Identifiability(
        tuple(_finding(i, prior, p, C, alone[i], excited[i], bounds[i]) for i in range(P)),
        clusters(prior.symbols, correlation),
        float(values[-1] / values[0]) if values[0] > 1e-14 * values[-1] else float("inf"),  # else rounding: singular
        correlation,
    )


def information_discount(data: np.ndarray, covariance: np.ndarray) -> float:
    """Factor from 0 to 1 on the information of the ``data`` (P, P): one over the dispersion of the scores.

    The dispersion D is the median over well excited directions, covariance = (data + I)^-1 (D data + I) (data + I)^-1:
    1 for the covariance that the noise model implies, more for a cluster-robust one.
    """
    values, vectors = np.linalg.eigh(0.5 * (data + data.T))
    for least in (10.0, 1.0):  # by the prior's information
        strong = values > least
        if strong.any():
            value = values[strong]
            variance = np.einsum("ji,jk,ki->i", vectors[:, strong], covariance, vectors[:, strong])
            dispersion = float(np.median((variance * (value + 1) ** 2 - 1) / value))  # solved for D
            return float(np.clip(1 / max(dispersion, 1e-3), 1e-3, 1.0))
    return 1.0


def _finding(
    i: int, prior: Prior, p: np.ndarray, covariance: np.ndarray, alone: float, excited: bool, where: str
) -> CoefficientFinding:
    share = float(covariance[i, i])
    partners, together = _partners(i, covariance) if share >= DETERMINED else ([], share)
    resolved = together < DETERMINED and together < 0.5 * share
    shared = bool(partners) and (resolved or (share >= 0.5 * PARTLY and alone < DETERMINED))
    if where:
        kind = "bound"
    elif share < DETERMINED:
        kind = "determined"
    elif shared:
        kind = "shared"
    elif not excited:
        kind = "silent"
    else:
        kind = "partly" if share < PARTLY else "prior"
    if kind in ("prior", "silent") and abs(float(p[i])) > STRAINED:
        kind = "strained"
    if kind == "silent" or (not shared and together > 0.67 * share):  # a third at least is worth a name
        partners, together = [], share
    names = tuple(prior.symbols[j] for j in partners)
    return CoefficientFinding(prior.symbols[i], kind, share, alone, names, together, where, float(p[i]))


def _partners(i: int, covariance: np.ndarray) -> tuple[list[int], float]:
    """Coefficients whose knowledge would help most with i, chosen one after another, and the variance then left."""
    chosen: list[int] = []
    left, C = float(covariance[i, i]), covariance.copy()
    for _ in range(MOST_PARTNERS):
        spread = np.where(np.diag(C) > 1e-10, np.diag(C), np.inf)  # those chosen are known: no variance left
        gain = C[i] ** 2 / spread  # variance of i that knowing j removes
        gain[[i, *chosen]] = 0.0
        j = int(np.argmax(gain))
        if left < DETERMINED or gain[j] < LEAST_GAIN * left:
            break
        chosen.append(j)
        C = C - np.outer(C[:, j], C[j]) / C[j, j]  # conditioned on j
        left = float(max(C[i, i], 0.0))
    return chosen, left


def clusters(symbols: tuple[str, ...], correlation: np.ndarray) -> tuple[Cluster, ...]:
    """Connected groups of the coefficients ``symbols`` whose ``correlation`` (P, P) is strong, strongest first."""
    from scipy.sparse.csgraph import connected_components  # late: slow to import

    off = np.abs(correlation) - np.eye(len(symbols))
    count, label = connected_components(off >= CORRELATED, directed=False)
    found = []
    for members in (np.flatnonzero(label == k) for k in range(count)):
        if len(members) > 1:
            strongest = float(off[np.ix_(members, members)].max())
            found.append(Cluster(tuple(symbols[k] for k in members), strongest))
    return tuple(sorted(found, key=lambda c: -c.strongest))


# Ranges outside which a coefficient is no longer physical: it stands in for something that the model lacks. Engineering
# judgement for merchant ships; public fits of the ESSO OSAKA records leave most of them.
PHYSICAL: dict[str, tuple[float, float]] = {
    "t_P": (0.0, 0.4), "w_P0": (0.0, 0.8), "x_P": (-0.7, -0.3), "t_R": (0.0, 0.6), "a_H": (0.0, 1.0),
    "x_H": (-0.6, -0.3), "epsilon": (0.7, 1.6), "ell_R": (-1.2, -0.5), "gamma_P": (0.2, 0.8), "gamma_N": (0.2, 0.8),
    "gamma_R_plus": (0.2, 0.8), "gamma_R_minus": (0.2, 0.8), "X_0F": (-math.inf, 0.0), "X_0A": (-math.inf, 0.0),
    "R_0": (0.0, math.inf), "Y_v": (-math.inf, 0.0), "N_v": (-math.inf, 0.0), "N_r": (-math.inf, 0.0),
    "C_D": (0.0, math.inf), "k_0": (0.0, math.inf),
}  # fmt: skip
ADDED_MASSES = ("m_x", "m_y", "I_J_z")
# Prior standard deviations within which the estimate of an added mass must lie: 95 % of the prior. Set by hand.
WITHIN_PRIOR = 2.0
# What trials may hide: effect that fits it, in words, and how it is said or fitted.
HIDDEN = {
    "antenna_offset": ("an antenna off midship", "reference_point in trials.toml, or --with antenna_offset"),
    "current": ("a current", "--with current"),
    "": ("inputs logged at samples but taken as held", "inputs in trials.toml"),
}


def remedies(symbols: Sequence[str]) -> str:
    """Where a coefficient that left its prior sends the reader: never to the prior, which is what knows of the ship.
    symbols: that are fitted; what is fitted along hides nothing."""
    fitted = {symbol.partition(".")[0] for symbol in symbols}
    rest = [words for effect, words in HIDDEN.items() if effect not in fitted]
    return f"see what the trials may hide: {'; '.join(f'{what} ({how})' for what, how in rest)}; mmg diagnose tells"


def cause(finding: CoefficientFinding) -> str:
    """What decided a coefficient, in words, from its ``finding``."""
    names, kind = listed(finding.partners), finding.kind
    if kind == "strained":
        return (
            f"in conflict with the prior: {abs(finding.shift):.1f} prior standard deviations away although the trials "
            "hardly tell it; see what they may hide (mmg diagnose)"
        )
    if kind == "prior" and finding.share > WORSE:
        return "no better known than by its prior: windows, runs or estimators disagree on it by more than that leaves"
    if kind == "shared":
        if not names:
            return "shared with many coefficients: only combinations of them are determined"
        if finding.together >= DETERMINED:
            return f"shared with {', '.join(finding.partners)} and others: only combinations of them are determined"
        return f"shared with {names}: the data determine only their combination"
    return {
        "bound": f"at its {finding.bound} bound: the data ask for a value outside the range given",
        "unknown": "its uncertainty could not be computed",
        "determined": "determined by the data",
        "partly": "partly determined by the data" + (f", what is missing is shared with {names}" if names else ""),
        "silent": "not excited by these trials",
        "prior": "decided by the prior" + (f", what the data say is shared with {names}" if names else ""),
    }[kind]


def verdict(finding: CoefficientFinding) -> str:
    """A sentence on what decided a coefficient, with the prior's share, from its ``finding``."""
    words = cause(finding)
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
    ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, identifiability: Identifiability, converged: bool
) -> Ship:
    """The ``ship`` with estimates, standard errors, priors and verdicts.

    prior: of the P free coefficients; p: scaled estimate (P,); covariance: (P, P) in prior standard deviations;
    identifiability: what decided each coefficient; converged: an estimate that did not says so.
    """
    own, changed = "calibrated by mmg fit", {}
    for symbol, mean, std in zip(prior.symbols, prior.mean.tolist(), prior.std.tolist(), strict=True):
        source = ship.coefficients[symbol].source
        source = own if own in source or not source else f"{own}; prior: {source}"  # refits do not pile up
        changed[symbol] = ship.coefficients[symbol].with_(prior_value=mean, prior_std=std, source=source)
    ship = replace(ship.with_coefficients(changed), notices=())  # those of the start were said by the fit
    return with_estimates(ship, prior, p, covariance, identifiability, converged)


def with_estimates(
    ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, identifiability: Identifiability, converged: bool
) -> Ship:
    """A calibrated ``ship`` with other estimates, standard errors and verdicts.

    prior, p (P,), covariance (P, P), identifiability, converged: as of ``calibrated_ship``.
    """
    changed = {}
    for i, finding in enumerate(identifiability.findings):
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
    prior, found = problem.prior, list[Message]()
    if not best.converged:
        words = f"not converged ({best.status}): {best.advice or 'the best iterate is kept'}"
        found.append(Message(words, "not_converged"))
    ends = [at_bound(*scaled) for scaled in zip(p, *prior.scaled_bounds, strict=True)]
    hit = [f"{s} ({end})" for s, end in zip(prior.symbols, ends, strict=True) if end]
    if hit:
        found.append(Message(f"at a bound: {', '.join(hit)}", "at_bound"))
    # three by the sentence, set by hand; a suspect that is fitted along is said by itself
    away = [s for s, value in zip(prior.symbols, p, strict=True) if abs(value) > 3 and "." not in s]
    if away:
        words = f"more than three prior standard deviations from the prior: {', '.join(away)}; "
        words += remedies(prior.symbols)
        found.append(Message(words, "far_from_prior"))
    found += implausible(prior, dict(zip(prior.symbols, (prior.mean + prior.std * p).tolist(), strict=True)))
    return [*found, *disagreement(starts, best.objective)]


def implausible(prior: Prior, values: dict[str, float]) -> list[Message]:
    """Warnings on ``values`` (symbol -> estimate) outside their physical range; on added masses far from ``prior``."""
    outside, far, advice = [], [], remedies(prior.symbols)
    for symbol, value in values.items():
        low, high = PHYSICAL.get(symbol, (-math.inf, math.inf))
        if low <= value <= high:
            continue
        limits = f"{low:g} to {high:g}"
        if math.inf in (-low, high):  # open on one side
            limits = f"at most {high:g}" if math.isfinite(high) else f"at least {low:g}"
        outside.append(f"{symbol} = {value:.3g} is outside its physical range ({limits})")
    for symbol, mean, std in zip(prior.symbols, prior.mean, prior.std, strict=True):
        shift = (values.get(symbol, mean) - mean) / std
        if symbol in ADDED_MASSES and abs(shift) > WITHIN_PRIOR:
            far.append(f"{symbol} = {values[symbol]:.3g} is {abs(shift):.1f} prior standard deviations from its prior")
    found = [Message(f"{', '.join(outside)}: {advice}", "implausible")] if outside else []
    if far:
        words = f"{', '.join(far)}, though trials hardly determine added masses: {advice}"
        found.append(Message(words, "added_mass_far_from_prior"))
    return found

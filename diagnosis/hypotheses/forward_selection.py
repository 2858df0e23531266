"""From the fit without any effect to the effects that the trials name: screen, refit, step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.refit import likelihood, refit, robust_p, wald_p
from diagnosis.hypotheses.score_test import Scored, scored, slopes
from diagnosis.hypotheses.unnamed import unnamed
from fitting.parallel import run_all

SHORT = 6
"""Candidates refitted, the best by the score test; those in CURVED are refitted whatever it says."""
CURVED = ("rudder_backlash",)
"""Effects whose slope at the neutral value says little: a dead band moves nothing until it is as wide as the motion."""
LEVEL = 0.03
"""Probability of a false alarm in one search over all candidates."""
SAME = 6.0
"""Candidates within this of the best in BIC cannot be told from it (odds of 20 : 1)."""
CLEAR = 12.0
"""Gain in BIC from which a refit says which candidate is the best. Below it, how far each refit went decides as much as
the data do, and BIC asks too much of effects with several parameters: the probabilities of the score test order them
(of 102 weak effects of benchmarks.blind 80 % come first so, by BIC 72 %)."""
FURTHER = 9.0
"""Gain in BIC that every effect after the first must bring: where the first is not quite as the library has it, small
others seem to help."""
ODDS = float(np.log(3.0))
"""Log Bayes factor from which something without a name is there."""
NEUTRAL = 0.05
"""Probability of an effect by its own standard errors from which it counts as neutral, whatever else it helped."""
AGREE = 0.05
"""Probability by the agreement of the runs up to which an effect is named."""
MOST = 3
"""Effects named at the most."""


@dataclass(frozen=True)
class Problem:
    """What all hypotheses share: the steps of the wide ship, the data, priors of its own coefficients, candidates.

    usual: log Bayes factor of effects without a name that the trials of the calibration would have, were they as many;
    usual_before: the same where no effect is fitted that is strong in them.
    """

    steps: TransitionModel
    data: GriddedTrials
    base: Priors
    candidates: tuple[Candidate, ...]
    usual: float = 0.0
    usual_before: float = 0.0

    @property
    def cost(self) -> float:
        """ln N of the BIC."""
        return float(np.log(self.data.samples))


@dataclass(frozen=True)
class Tried:
    """A candidate added to a hypothesis and refitted: the fit, the drop of the negative log likelihood, the gain in
    BIC, the probability of such a drop by chance anywhere among the candidates."""

    candidate: Candidate
    found: Estimate
    drop: float
    delta_bic: float
    p_value: float


@dataclass(frozen=True)
class Search:
    """One search: scores of all candidates at a hypothesis, those refitted (best first), those that data cannot tell
    apart (``same``: best first, all within SAME of it)."""

    scores: tuple[Scored, ...]
    tried: tuple[Tried, ...]
    before: Estimate

    @property
    def best(self) -> Tried | None:
        return self.tried[0] if self.tried else None

    @property
    def same(self) -> tuple[Candidate, ...]:
        """Candidates that the data cannot tell from the best, which comes first."""
        return tuple(t.candidate for t in self.tried if t.delta_bic > self.tried[0].delta_bic - SAME)

    @property
    def significant(self) -> bool:
        """Whether the best is more than chance."""
        return bool(self.tried) and self.tried[0].p_value < LEVEL and self.tried[0].delta_bic > 0

    def score(self, candidate: Candidate) -> Scored:
        """The test of a ``candidate``."""
        return next(s for s in self.scores if s.candidate == candidate)


@dataclass(frozen=True)
class Found:
    """Where the search ended: the effects named, in the order found, the fit with them, and the searches.

    robust: of each effect named, its probability by how well the runs agree on it."""

    effects: tuple[Candidate, ...]
    null: Estimate
    final: Estimate
    searches: tuple[Search, ...]
    robust: Mapping[Candidate, float] = field(default_factory=dict)


def search(
    problem: Problem, before: Estimate, named: Sequence[Candidate], short: int = SHORT, seed: int = 0, workers: int = 1
) -> Search:
    """Screen all candidates that are not named yet, refit the short list with those named.

    workers: processes over which the refits are spread.
    """
    p = problem
    known = {c.effect for c in named}
    rest = [c for c in p.candidates if c.effect not in known]
    scores = scored(slopes(p.steps, p.data, before, rest), rest, seed)
    excited = [s for s in scores if s.excited]
    by_bic = sorted(excited, key=lambda s: s.degrees * p.cost - s.T)[:short]
    by_p = [s for s in excited if not s.candidate.by_run]
    local = [s for s in by_bic if s.candidate.by_run]
    chosen = by_p[:short] + local + [s for s in by_p[short:] if s.candidate.effect in CURVED]
    tried = run_all(_try, [(p, before, tuple(named), s, len(excited)) for s in chosen], workers)
    return Search(tuple(scores), tuple(_ordered(tried, {s.candidate: s for s in scores})), before)


def _ordered(tried: Sequence[Tried], scores: Mapping[Candidate, Scored]) -> list[Tried]:
    """Refitted candidates, the best first: by their gain in BIC, or where none is CLEAR by their own probability."""
    by_bic = sorted(tried, key=lambda t: -t.delta_bic)
    if not by_bic or by_bic[0].delta_bic > CLEAR:
        return by_bic

    def chance(t: Tried) -> float:
        s = scores[t.candidate]
        return float(chi2.sf(max(2 * t.drop, 0.0), s.degrees)) if t.candidate.effect in CURVED else s.p_single

    return sorted(by_bic, key=lambda t: (t.candidate.by_run, chance(t)))


def _try(task: tuple[Problem, Estimate, tuple[Candidate, ...], Scored, int]) -> Tried:
    return try_one(*task)


def try_one(problem: Problem, before: Estimate, named: Sequence[Candidate], score: Scored, count: int) -> Tried:
    """Refit with one more effect, from its first-order estimate."""
    c = score.candidate
    start = {x: before.value(*x) for e in named for x in e.columns}
    first = np.clip(c.neutral + score.phi * c.typical, c.lower, c.upper)
    if c.start is not None:
        first = c.start
    elif c.effect in CURVED:
        first = np.clip(c.neutral + c.typical, c.lower, c.upper)
    start |= dict(zip(c.columns, first, strict=True))
    found = refit(problem.steps, problem.data, problem.base, before, [*named, c], start)
    kept = sum(len(e.columns) for e in named)
    drop = likelihood(before, kept) - likelihood(found, kept + len(c.columns))
    by_chance = min(1.0, count * float(chi2.sf(max(2 * drop, 0.0), score.degrees)))
    p_value = min(score.p_value, by_chance) if c.effect not in CURVED else by_chance
    return Tried(c, found, drop, 2 * drop - score.degrees * problem.cost, p_value)


def explain(problem: Problem, null: Estimate, seed: int = 0, workers: int = 1) -> Found:
    """Name effects one after the other while the best of the rest is more than chance.

    A later effect may make an earlier one superfluous: it is left out again (``_pruned``).
    """
    named: list[Candidate] = []
    now, searches = null, []
    for _ in range(MOST + 2):
        s = search(problem, now, named, seed=seed, workers=workers)
        searches.append(s)
        if s.best is None or not s.significant or (named and not s.best.delta_bic > FURTHER):
            break
        if named and _doubtful(problem, s.best):
            break
        named, now = _pruned(problem, [*named, s.best.candidate], s.best.found)
        if not named:
            null = now
        if len(named) >= MOST:
            break
    robust = {c: robust_p(problem.steps, problem.data, now, c) for c in named}
    return Found(tuple(named), null, now, tuple(searches), robust)


def _doubtful(problem: Problem, best: Tried) -> bool:
    """Whether the runs do not agree on a further effect, or effects without a name explain more than it does."""
    if robust_p(problem.steps, problem.data, best.found, best.candidate) > AGREE:
        return True
    rest = unnamed(problem.steps, problem.data, best.found).log_bayes - problem.usual
    return rest > max(ODDS, best.drop)


def _pruned(problem: Problem, named: list[Candidate], now: Estimate) -> tuple[list[Candidate], Estimate]:
    """Without those effects that the others have made superfluous, the newest included.

    Each is left out in turn, and the rest is fitted again from where the fit with it ended: a new effect may have
    helped the fit to a better place that needs no such effect.
    """
    for c in named:
        rest = [e for e in named if e != c]
        start = {x: now.value(*x) for e in rest for x in e.columns}
        without = refit(problem.steps, problem.data, problem.base, now_without(now, problem, rest), rest, start)
        every, kept = (sum(len(e.columns) for e in some) for some in (named, rest))
        lost = 2 * (likelihood(without, kept) - likelihood(now, every))
        if lost < (every - kept) * problem.cost or wald_p(now, c) > NEUTRAL:
            return _pruned(problem, rest, without) if rest else (rest, without)
    return named, now


def now_without(now: Estimate, problem: Problem, kept: Sequence[Candidate]) -> Estimate:
    """A fit as a start of one with fewer effects: the others at their neutral values."""
    theta, remains = now.theta.copy(), {c.effect for c in kept}
    for c in problem.candidates:
        if c.effect not in remains:
            for s, value in zip(c.symbols, c.neutral, strict=True):
                theta[problem.steps.ship.symbols.index(s)] = value
    if theta.ndim > 1 and np.ptp(theta, axis=1).max() == 0:
        theta = theta[:, 0].copy()
    return replace(now, theta=theta)

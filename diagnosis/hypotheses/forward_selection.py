"""Forward selection of effects: score tests of all, refits of the best, one more effect while it is significant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cases.evidence.tails import chi2_tail
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate, estimate
from diagnosis.estimation.residual_checks import WORTH, with_correlation_time
from diagnosis.hypotheses.found_again import (
    CERTAIN,
    EXCESS,
    NOTHING,
    FoundAgain,
    both_by_weight,
    other_trials,
    same_trials,
)
from diagnosis.hypotheses.refit import followed_without, gained, refit, robust_p, wald_p
from diagnosis.hypotheses.score_test import ScoreTest, followed, score_tests, slopes
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.unnamed import unnamed_forms
from fitting.parallel import run_all
from mmg.progress import OnProgress, Progress

SHORT = 6
"""Candidates refitted, the best by the score test; those in CURVED are refitted whatever it says."""
CURVED = ("rudder_backlash",)
"""Effects whose slope at the neutral value says little: a dead band acts only when it is as large as the motion."""
LEVEL = 0.03
"""Probability of a false alarm in one search over all candidates."""
SURE = 0.005
"""Probability by the trials alone below which those that took no part do not speak against an effect."""
IMMATERIAL = 0.15
"""Share of its typical size up to which an uncertain fault of an instrument is none: every log is off by .15 %."""
SAME_CLASS = 6.0
"""Candidates within this of the best in BIC cannot be told from it (odds of 20 : 1)."""
CLEAR = 12.0
"""Gain in BIC from which the refits decide which candidate is the best. Below it the score test does, as BIC penalises
parameters too much (of 102 weak effects 80 % come first, by BIC 72)."""
FURTHER, FURTHER_LEVEL = 5.0, 0.01
"""Minimum gain in BIC of every effect after the first, and largest probability of it by chance. Where the first differs
somewhat from its model in the library, small further effects seem to help."""
NEUTRAL, AGREE = 0.05, 0.05
"""Probability of an effect by its own standard errors above which it counts as neutral, and largest probability, by the
agreement of the runs, with which it is named."""
MOST = 3
"""Effects named at the most."""
MAX_FITS = 12
"""Further linearisations of the fit with the effects selected, where it has not converged."""


@dataclass(frozen=True)
class RefittedEffect:
    """A candidate added to a hypothesis and refitted.

    gain: of log likelihood, over the dispersion of its slopes; delta_bic: gain in BIC; p_value: probability that chance
    gives such a gain to any of the candidates, by the score test or by the refit; again: what
    trials that took no part say of it.
    """

    candidate: Candidate
    fit: Estimate
    gain: float
    delta_bic: float
    p_value: float
    again: FoundAgain = NOTHING

    @property
    def size(self) -> np.ndarray:
        """By how much its parameters differ from neutral, in typical sizes (p,)."""
        values = np.array([self.fit.value(*x) for x in self.candidate.columns])
        return np.asarray((values - self.candidate.neutral) / self.candidate.typical)

    @property
    def is_material(self) -> bool:
        """Whether it is certain, or more than what every instrument is off, where it is a fault of one."""
        small = self.candidate.measures and np.abs(self.size).max(initial=0.0) <= IMMATERIAL
        return not small or self.p_value < CERTAIN

    @property
    def p_both(self) -> float:
        """Probability by chance of what it gains in the trials and those that took no part. Where the trials are SURE,
        twice that or by the trials alone, the smaller one: what the others would show of a large effect is not linear
        in its size, so that there they may help a name only."""
        both = both_by_weight(self.p_value, self.gain, self.by_others)
        return both if self.p_value >= SURE else min(self.p_value, 2 * both)

    @property
    def bic_of_both(self) -> float:
        """Gain in BIC in the trials, or in them and those that took no part if that is more."""
        return self.delta_bic + max(2 * self.by_others.gain, 0.0)

    @property
    def by_others(self) -> FoundAgain:
        """What trials that took no part tell, where the response on which that hangs can be believed."""
        return self.again if self.again.expected < EXCESS * np.sqrt(max(2 * self.gain, 0.0)) else NOTHING


@dataclass(frozen=True)
class Search:
    """One search: score tests of all candidates at the fit ``before``, and those refitted, best first."""

    scores: tuple[ScoreTest, ...]
    refitted: tuple[RefittedEffect, ...]
    before: Estimate

    @property
    def best(self) -> RefittedEffect | None:
        return self.refitted[0] if self.refitted else None

    @property
    def indistinguishable(self) -> tuple[Candidate, ...]:
        """Candidates that the data cannot tell from the best, which comes first."""
        return tuple(t.candidate for t in self.refitted if t.delta_bic > self.refitted[0].delta_bic - SAME_CLASS)

    @property
    def significant(self) -> bool:
        """Whether the best is more than chance, by the trials and those that took no part together, and is not a small
        one that these exclude."""
        best = self.best
        if best is None or not (best.p_both < LEVEL and best.bic_of_both > 0):
            return False
        return best.p_value < SURE or not best.by_others.denies(best.gain)

    def score(self, candidate: Candidate) -> ScoreTest:
        """The test of a ``candidate``."""
        return next(s for s in self.scores if s.candidate == candidate)


@dataclass(frozen=True)
class Selection:
    """The effects selected, in the order found, the fits without and with them, and the searches.

    robust: of each effect, its probability by how well the runs agree on it."""

    effects: tuple[Candidate, ...]
    null: Estimate
    final: Estimate
    searches: tuple[Search, ...]
    robust: Mapping[Candidate, float] = field(default_factory=dict)

    def without_last(self, problem: SearchProblem) -> Selection:
        """The selection without the effect found last, the others refitted to ``problem``."""
        kept, start = self.effects[:-1], followed_without(self.final, self.effects[-1])
        before = problem.without(self.final, kept)
        final = refit(problem.steps, problem.data, problem.base, before, list(kept), start)
        robust = {c: robust_p(problem.steps, problem.data, final, c) for c in kept}
        return Selection(kept, self.null, final, self.searches, robust)


def search(
    problem: SearchProblem,
    before: Estimate,
    named: Sequence[Candidate],
    seed: int = 0,
    workers: int = 1,
    progress: OnProgress | None = None,
) -> Search:
    """Test all candidates of ``problem`` that are not ``named`` yet at the fit ``before``, and refit the best.

    seed: of the drawn law of the largest score; workers: processes over which the refits are spread; progress: called
    after each refit. Returns the tests and the refits; the best is looked for in the problem's tests as well.
    """
    p = problem
    rest = [c for c in p.candidates if c.effect not in {e.effect for e in named}]
    scores = score_tests(slopes(p.steps, p.data, before, rest), rest, seed)
    excited = [s for s in scores if s.excited]
    chosen = excited[:SHORT] + [s for s in excited[SHORT:] if s.candidate.effect in CURVED]
    done: list[RefittedEffect] = []

    def note(one: RefittedEffect) -> None:
        done.append(one)
        if progress:
            task = f"refits of search {len(named) + 1}"
            progress(Progress(task, len(done), len(chosen), {"gain in BIC": one.delta_bic}))

    alone = replace(p, tests=None)  # processes need no other trials
    tasks = [(alone, before, tuple(named), s, len(excited)) for s in chosen]
    refitted = run_all(refit_task, tasks, workers, note)
    ordered = in_order([one for one in refitted if one.is_material], {s.candidate: s for s in scores})
    if ordered:
        ordered[0] = replace(ordered[0], again=_found_again(p, before, ordered[0]))
    return Search(tuple(scores), tuple(ordered), before)


def _found_again(p: SearchProblem, before: Estimate, best: RefittedEffect) -> FoundAgain:
    """What the test trials say of the ``best`` candidate, of the size that its refit gives it."""
    c = best.candidate
    if p.tests is None or c.effect in CURVED:
        return NOTHING
    with_it = dict(zip(best.fit.free.columns, best.fit.p, strict=True))
    kept = dict(zip(before.free.columns, before.p, strict=True))
    shift = np.array([with_it.get(column, value) - value for column, value in kept.items()])
    try:
        own = same_trials(p.steps, p.data, before).effect(c, best.size, shift)
        return other_trials(p.steps, p.tests, before).effect(c, best.size, shift).scaled(own)
    except (BrokenModelError, np.linalg.LinAlgError):
        return NOTHING


def in_order(refitted: Sequence[RefittedEffect], scores: Mapping[Candidate, ScoreTest]) -> list[RefittedEffect]:
    """The ``refitted`` candidates, best first: by gain in BIC or, where none is CLEAR, by probability in ``scores``."""
    by_bic = sorted(refitted, key=lambda t: -t.delta_bic)
    if not by_bic or by_bic[0].delta_bic > CLEAR:
        return by_bic

    def chance(r: RefittedEffect) -> float:
        s = scores[r.candidate]
        return chi2_tail(2 * r.gain, s.degrees) if r.candidate.effect in CURVED else s.p_single

    return sorted(by_bic, key=chance)


def refit_task(task: tuple[SearchProblem, Estimate, tuple[Candidate, ...], ScoreTest, int]) -> RefittedEffect:
    """``refit_candidate`` of the arguments in ``task``, as processes take them."""
    return refit_candidate(*task)


def refit_candidate(
    problem: SearchProblem, before: Estimate, named: Sequence[Candidate], score: ScoreTest, count: int
) -> RefittedEffect:
    """Refit ``problem`` from the fit ``before`` with the effects ``named`` and one more.

    score: the test of the candidate, whose first-order estimate is the first value; count: candidates that were tested,
    by which the probability is corrected. Returns the fit with its gain.
    """
    c = score.candidate
    start = {x: before.value(*x) for e in named for x in e.columns}
    if c.start is not None:
        first = c.start
    elif c.effect in CURVED:
        first = np.clip(c.neutral + c.typical, c.lower, c.upper)
    else:
        first = np.clip(c.neutral + score.phi * c.typical, c.lower, c.upper)
        start |= followed(before, score, first)
    start |= dict(zip(c.columns, first, strict=True))
    fit = refit(problem.steps, problem.data, problem.base, before, [*named, c], start, is_rough=True)
    kept = sum(len(e.columns) for e in named)
    gain = gained(before, kept, fit, kept + len(c.columns)) / score.dispersion
    by_chance = min(1.0, count * chi2_tail(2 * gain, score.degrees))
    p_value = by_chance if c.effect in CURVED else min(score.p_value, by_chance)
    return RefittedEffect(c, fit, gain, 2 * gain - score.degrees * problem.cost, p_value)


def select_effects(
    problem: SearchProblem, null: Estimate, seed: int = 0, workers: int = 1, progress: OnProgress | None = None
) -> Selection:
    """Select effects of ``problem`` one after the other while the best of the rest is more than chance.

    null: the fit without effects; seed, workers, progress: as of ``search``. A later effect may make an earlier one
    superfluous, which is then left out again. Returns the effects and the fits.
    """
    named, now, searches, again = list[Candidate](), null, list[Search](), dict[Candidate, float]()
    for _ in range(MOST + 2):
        s = search(problem, now, named, seed=seed, workers=workers, progress=progress)
        searches.append(s)
        if s.best is None or not s.significant:
            break
        is_further = s.best.bic_of_both > FURTHER and s.best.p_both < FURTHER_LEVEL
        if named and (not is_further or _doubtful(problem, s.best)):
            break
        again[s.best.candidate] = max(2 * s.best.by_others.gain, 0.0)
        named, now = pruned(problem, [*named, s.best.candidate], s.best.fit, again)
        if named and now.noise.prior is None:  # the effect that was missing had lengthened the memory of the force
            now = with_correlation_time(problem.steps, problem.data, now, WORTH)
        if not now.converged:  # else the next effect gains what this one's fit had left
            now = estimate(problem.steps, problem.data, now, MAX_FITS)
        if not named:
            null = now
        if len(named) >= MOST:
            break
    robust = {c: robust_p(problem.steps, problem.data, now, c) for c in named}
    return Selection(tuple(named), null, now, tuple(searches), robust)


def _doubtful(problem: SearchProblem, best: RefittedEffect) -> bool:
    """Whether the runs do not agree on the ``best`` effect, or unnamed forms explain more than it does."""
    if robust_p(problem.steps, problem.data, best.fit, best.candidate) > AGREE:
        return True
    left = unnamed_forms(problem.steps, problem.data, best.fit)
    return left.log_bayes - problem.expected_unnamed > max(left.limit, best.gain)


def pruned(
    problem: SearchProblem, named: list[Candidate], now: Estimate, again: Mapping[Candidate, float]
) -> tuple[list[Candidate], Estimate]:
    """The effects ``named`` in ``problem`` without those that the others have made superfluous; now: the fit with all;
    again: twice the log likelihood that trials which took no part gained by an effect when it was found.

    Each is left out in turn, and the rest is fitted again from where the fit with it ended: a new effect may have
    helped the fit to a better place that needs no such effect.
    """
    for c in named:
        rest = [e for e in named if e != c]
        start = followed_without(now, c)
        without = refit(problem.steps, problem.data, problem.base, problem.without(now, rest), rest, start)
        every, kept = (sum(len(e.columns) for e in some) for some in (named, rest))
        lost = 2 * gained(without, kept, now, every)
        if lost + again.get(c, 0.0) < (every - kept) * problem.cost or wald_p(now, c) > NEUTRAL:
            return pruned(problem, rest, without, again) if rest else (rest, without)
    return named, now

"""Forward selection of effects: score tests of all, refits of the best, one more effect while its evidence is enough.

Every hypothesis has one number, its evidence in log units against the one without it: that of the training trials is
the gain of the marginal likelihood less 1/2 ln N for each parameter (BIC, Schwarz 1978), that of the test trials their
predictive likelihood one step ahead (prequential, Dawid 1984), in which no parameter was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.tails import chi2_tail
from diagnosis.estimation.candidates import Candidate, Column
from diagnosis.estimation.first_fit import MAX_FITS
from diagnosis.estimation.linearisation import Linearisation
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.residual_checks import WORTH, with_correlation_time
from diagnosis.hypotheses.refit import SearchProblem, gained, refit
from diagnosis.hypotheses.score_test import ScoreTest, followed, score_tests, slopes
from fitting.parallel import run_all
from mmg.messages import OnProgress, Progress

# Candidates refitted, the best by the score test: twice the three that held 93 % of the true effects of a prototype. So
# it was measured.
SHORT = 6
# Probability by chance from which the score test shows none (row ``refits of what the score test shows`` of
# benchmarks/ablation.md).
SCREEN = 0.05
# Effects whose slope at the neutral value says little: a dead band acts only when it is as large as the motion.
CURVED = ("rudder_backlash",)
# The one threshold of the verdict, in log units: odds of 20 to 1 (strong evidence, Kass & Raftery 1995).
ODDS = float(np.log(20.0))
# Effects named at the most. Four together are found with their sizes in the trials of a 7 m KVLCC2. Set by hand; with
# one at most 2 of 400 answers change (row ``further effects`` of benchmarks/ablation.md).
MOST = 6
# Better places without a new effect from which a search begins anew, before one more effect is selected.
TRIES = 3  # set by hand
IsPossible = Callable[[Estimate, Candidate], bool]  # Whether a candidate has a size in a fit which it can have


@dataclass(frozen=True)
class RefittedEffect:
    """A candidate added to a hypothesis and refitted.

    gain: of log likelihood, over the dispersion of its slopes; delta_bic: gain in BIC; p_value: probability that chance
    gives such a gain to any of the candidates, by the score test or by the refit; predictive: log likelihood that the
    test trials gain one step ahead, 0 without any; is_possible: whether its size can be.
    """

    candidate: Candidate
    fit: Estimate
    gain: float
    delta_bic: float
    p_value: float
    predictive: float = 0.0
    is_possible: bool = True

    @property
    def evidence(self) -> float:
        """For it, in log units, by the trials and those that took no part."""
        return 0.5 * self.delta_bic + self.predictive


@dataclass(frozen=True)
class Search:
    """One search: score tests of all candidates at the fit ``before``, and those refitted, most evidence first;
    converged: the best of them where its fit went on."""

    scores: tuple[ScoreTest, ...]
    refitted: tuple[RefittedEffect, ...]
    before: Estimate
    converged: RefittedEffect | None = None

    @property
    def best(self) -> RefittedEffect | None:
        """The candidate of a possible size with most evidence."""
        return next((r for r in self.refitted if r.is_possible), None)

    @property
    def indistinguishable(self) -> tuple[Candidate, ...]:
        """Candidates of a possible size that the data cannot tell from the best, which comes first."""
        possible = [r for r in self.refitted if r.is_possible]
        return tuple(r.candidate for r in possible if r.evidence > possible[0].evidence - ODDS)

    def score(self, candidate: Candidate) -> ScoreTest:
        """The test of a ``candidate``."""
        return next(s for s in self.scores if s.candidate == candidate)


@dataclass(frozen=True)
class Selection:
    """The effects selected, in the order found, the fits without and with them, and the searches, which may go on."""

    effects: tuple[Candidate, ...]
    null: Estimate
    final: Estimate
    searches: tuple[Search, ...]

    @property
    def evidence(self) -> tuple[float, ...]:
        """For each of the effects beside those before it, in log units."""
        found = (s.converged or s.best for s in self.searches[: len(self.effects)])
        return tuple(best.evidence for best in found if best is not None)

    def first(self, count: int) -> Selection:
        """The selection with the first ``count`` of the effects alone."""
        return replace(self, effects=self.effects[:count], final=self.fits[count])

    @property
    def fits(self) -> tuple[Estimate, ...]:
        """The fits with none of the effects, with the first, and so on to all of them."""
        return (*(s.before for s in self.searches[: len(self.effects)]), self.final)


def search(
    problem: SearchProblem,
    before: Estimate,
    named: Sequence[Candidate],
    seed: int = 0,
    workers: int = 1,
    progress: OnProgress | None = None,
    is_possible: IsPossible = lambda *_: True,
) -> Search:
    """Test all candidates of ``problem`` that are not ``named`` yet at the fit ``before``, and refit the best.

    seed: of the drawn law of the largest score; workers: processes over which the refits are spread; progress: called
    after each; is_possible: as of ``IsPossible``. Returns tests and refits, judged by the problem's tests as well.
    """
    p = problem
    rest = [c for c in p.candidates if c.effect not in {e.effect for e in named}]
    scores = score_tests(slopes(p.steps, p.data, before, rest), rest, seed)
    excited = [s for s in scores if s.excited]
    shown = [s for s in excited if s.p_single < SCREEN][:SHORT]
    chosen = shown + [s for s in excited if s.candidate.effect in CURVED and s not in shown]
    done: list[RefittedEffect] = []

    def note(one: RefittedEffect) -> None:
        done.append(one)
        if progress:
            task = f"refits of search {len(named) + 1}"
            progress(Progress(task, len(done), len(chosen), {"gain in BIC": one.delta_bic}))

    alone = replace(p, tests=None)  # processes need no other trials
    tasks = [(alone, before, tuple(named), s, len(excited)) for s in chosen]
    refitted = run_all(refit_task, tasks, workers, note)
    is_supported = any(r.delta_bic > 0 for r in refitted)  # of the others no test makes a name
    nothing = None
    if p.tests is not None and is_supported:
        from diagnosis.validation.held_out import filtered_along  # late: a fit's trials have no tests

        nothing = filtered_along(p.steps, p.tests, before)
    judged = [
        replace(
            r,
            predictive=_predictive(p, nothing, r.fit) if r.delta_bic > 0 else 0.0,
            is_possible=is_possible(r.fit, r.candidate),
        )
        for r in refitted
    ]
    return Search(tuple(scores), tuple(sorted(judged, key=lambda r: -r.evidence)), before)


def _predictive(p: SearchProblem, nothing: Linearisation | None, fit: Estimate) -> float:
    """Log likelihood that the problem's tests gain one step ahead by a ``fit``, over that along which they were
    followed with ``nothing`` more; 0 without any, and where the ship explodes."""
    if p.tests is None or nothing is None:
        return 0.0
    from diagnosis.validation.held_out import filtered_along, likelihood_of

    there = filtered_along(p.steps, p.tests, fit, nothing)
    return float((likelihood_of(nothing) - likelihood_of(there)).sum()) if there else 0.0


def refit_task(task: tuple[SearchProblem, Estimate, tuple[Candidate, ...], ScoreTest, int]) -> RefittedEffect:
    """Refit with one effect more; one argument, as processes take it.

    task: the problem; the fit before, from which it starts; the effects named so far; the test of the candidate, whose
    estimate is the first value; how many were tested, which corrects the probability. Returns the fit and its gain.
    """
    problem, before, named, score, count = task
    c = score.candidate
    start, moved = {x: before.value(*x) for e in named for x in e.columns}, dict[Column, float]()
    if c.start is not None:
        first = c.start
    elif c.effect in CURVED:
        first = np.clip(c.neutral + c.typical, c.lower, c.upper)  # its slope at the neutral value says nothing
    else:
        first = np.clip(c.neutral + score.phi * c.typical, c.lower, c.upper)
        moved = followed(before, score, first)
    start |= dict(zip(c.columns, first, strict=True))
    fit = refit(problem, before, [*named, c], start | moved, is_rough=True)
    if moved and fit.nll > before.nll:  # neutral values would be better: to first order is too far for coefficients
        fit = refit(problem, before, [*named, c], start, is_rough=True)
    kept = sum(len(e.columns) for e in named)
    gain = gained(before, kept, fit, kept + len(c.columns)) / score.dispersion
    by_chance = min(1.0, count * chi2_tail(2 * gain, score.degrees))  # likelihood ratio, Bonferroni
    p_value = by_chance if c.effect in CURVED else min(score.p_value, by_chance)
    return RefittedEffect(c, fit, gain, 2 * gain - score.degrees * problem.cost, p_value)  # BIC (Schwarz 1978)


def _converged(
    problem: SearchProblem, rough: RefittedEffect, score: ScoreTest, named: Sequence[Candidate]
) -> RefittedEffect:
    """The ``rough`` refit of a candidate beside the effects ``named`` gone on to the end, with all that it gains.

    score: the test of the candidate. Without it an antenna of 0.3 L had 33 of 355 units, fewer than a free force.
    """
    fit = estimate(problem.steps, problem.data, rough.fit, MAX_FITS)
    every = sum(len(e.columns) for e in (*named, rough.candidate))
    more = gained(rough.fit, every, fit, every) / score.dispersion
    return replace(rough, fit=fit, gain=rough.gain + more, delta_bic=rough.delta_bic + 2 * more)


def refitted_without(problem: SearchProblem, best: RefittedEffect, named: Sequence[Candidate]) -> Estimate:
    """The fit of ``problem`` with the effects ``named`` alone, from where that with the ``best`` of the rest ended."""
    c, theta = best.candidate, best.fit.theta.copy()
    # (p,) or by window (p, R); of one that differs by run each row is set once for each run
    theta[[problem.steps.ship.symbols.index(s) for s in c.symbols]] = c.neutral.reshape(-1, *[1] * (theta.ndim - 1))
    start = {x: best.fit.value(*x) for e in named for x in e.columns}
    begin = replace(best.fit, theta=theta)
    return refit(problem, begin, list(named), start, MAX_FITS)


def select_effects(
    problem: SearchProblem,
    null: Estimate,
    seed: int = 0,
    workers: int = 1,
    progress: OnProgress | None = None,
    is_possible: IsPossible = lambda *_: True,
) -> Selection:
    """Select effects of ``problem`` one after the other while the evidence for the best of the rest exceeds ODDS.

    null: the fit without effects; seed, workers, progress, is_possible: as of ``search``. Returns effects and fits.
    """
    named, now, searches, tries = list[Candidate](), null, list[Search](), TRIES
    while len(named) < MOST:
        found = search(problem, now, named, seed, workers, progress, is_possible)
        best = found.best
        if best is None or best.evidence <= ODDS:
            searches.append(found)
            break
        # a new effect may only have helped the fit to a better place, which needs none
        without = refitted_without(problem, best, named)
        if tries and without.nll < now.nll - WORTH:
            now, null, tries = without, null if named else without, tries - 1
            continue
        if not best.fit.converged:  # else the next effect gains what this one's fit had left
            best = _converged(problem, best, found.score(best.candidate), named)
            found = replace(found, converged=best)
        searches.append(found)
        tries = TRIES
        named.append(best.candidate)
        now = best.fit
    if named:  # what was missing had lengthened the memory of the force
        now = with_correlation_time(problem.steps, problem.data, now, WORTH)
    return Selection(tuple(named), null, now, tuple(searches))

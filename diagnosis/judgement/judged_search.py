"""Effects selected and judged: search, tests of what is left, check on test trials, chance, verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import LEVEL, Selection, select_effects
from diagnosis.hypotheses.left_findings import Chance
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.second_sample import CERTAIN, both_by_weight
from diagnosis.hypotheses.simulated_chance import SimulatedChance, simulated_chance
from diagnosis.hypotheses.unnamed import UnnamedForms
from diagnosis.inputs import DiagnosisOptions
from diagnosis.judgement.on_test_trials import OnTestTrials
from diagnosis.judgement.possible_size import impossible_size
from diagnosis.judgement.verdict import confirms, contradicts, decide
from diagnosis.prepare import Prepared
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress

OTHERS = 2
"""Searches without the effects whose names were withdrawn."""


@dataclass(frozen=True)
class JudgedSearch:
    """Of a search: the selection, tests of unnamed forces without and with it, the check on test trials, the verdict,
    and why a name was withdrawn. withdrawn: the search before, whose names were withdrawn, where another came of it;
    beside: sentences on effects that were left out beside others, for a size that they cannot have."""

    found: Selection
    before: UnnamedForms
    after: UnnamedForms
    held: HeldOut | None
    verdict: str
    reasons: tuple[Message, ...]
    simulated: SimulatedChance | None
    withdrawn: Selection | None = None
    beside: tuple[Message, ...] = ()

    @property
    def chance(self) -> Chance:
        """What chance gives."""
        scores = self.found.searches[0].scores if self.found.searches else ()
        least = min(scores, key=lambda s: s.p_single, default=None)
        if self.simulated is None or least is None:
            p_value = min((s.p_value for s in scores), default=None)
        else:
            p_value = self.simulated.of_smallest(least.p_single)
        by = "law" if self.simulated is None else "simulation"
        return Chance(by, len(self.before.chance), self.before.p_value, p_value)


def judged_search(
    ready: Prepared, tests: GriddedTrials | None, options: DiagnosisOptions, progress: OnProgress | None
) -> JudgedSearch:
    """Select effects and judge them. Where a name is withdrawn and something is left, search without it for one that
    test trials confirm.

    ready: the problem and its fit without effects; tests: trials to check on; options: of the diagnosis; progress:
    called as the work goes on. Returns the selection with its verdict.
    """
    p = replace(ready.problem, tests=tests)
    on_tests = OnTestTrials(p.steps, tests, options.seed) if tests is not None else None
    before, simulated = p.unnamed(ready.null), None
    if options.bootstrap:
        LOGGER.info(f"simulating {options.bootstrap} campaigns in which nothing is missing")
        store = options.store.part("campaigns") if options.store is not None else None
        simulated = simulated_chance(p, ready.null, options.bootstrap, options.seed, options.workers, progress, store)
        before = replace(before, chance=simulated.unnamed)
    result = _judged(ready, p, before, simulated, on_tests, options, progress)
    other = result
    for _ in range(OTHERS):
        withdrawn = {c.effect for c in other.found.effects}
        if other.verdict != "unknown" or not withdrawn or tests is None:
            break
        LOGGER.info(f"searching without {' and '.join(sorted(withdrawn))}")
        p = replace(p, candidates=tuple(c for c in p.candidates if c.effect not in withdrawn))
        other = _judged(ready, p, before, simulated, on_tests, options, progress)
        if other.verdict == "named" and other.held is not None and confirms(other.held):
            return replace(other, reasons=(*result.reasons, *other.reasons), withdrawn=result.found)
    return result


def _judged(
    ready: Prepared,
    p: SearchProblem,
    before: UnnamedForms,
    simulated: SimulatedChance | None,
    tests: OnTestTrials | None,
    options: DiagnosisOptions,
    progress: OnProgress | None,
) -> JudgedSearch:
    """One search and its verdict. Beside a name that the ``tests`` contradict it does not matter what else is left."""
    found, beside = select_effects(p, ready.null, options.seed, options.workers, progress), list[Message]()
    while len(found.effects) > 1 and (impossible := impossible_size(ready.full, found.final, found.effects[-1])):
        beside.append(Message(f"what is left beside the name acts like {impossible}", "impossible_size"))
        found = found.without_last(p)
    held = tests.compare(found.null, found.final) if tests is not None else None
    stands = bool(found.effects) and not (held is not None and contradicts(found, held))
    after = p.unnamed(found.final) if stands else before
    result = _answer(found, (before, after), held, p, simulated)
    return replace(result, beside=tuple(beside))


def _answer(
    found: Selection,
    left: tuple[UnnamedForms, UnnamedForms],
    held: HeldOut | None,
    p: SearchProblem,
    simulated: SimulatedChance | None,
) -> JudgedSearch:
    """The verdict on what was ``found``; left: what unnamed forms explain before and after it; held: the check on test
    trials; p, simulated: of the search."""
    before, after = left
    beyond = before.beyond_chance - p.expected_unnamed_null
    verdict, reasons = decide(found, beyond, after.log_bayes - p.expected_unnamed, after.limit, held)
    result = JudgedSearch(found, before, after, held, verdict, tuple(reasons), simulated)
    rarest = _rarest(result)
    if verdict == "none" and not found.effects and rarest < CERTAIN:
        words = (
            f"one of the known effects fits better than chance (p = {rarest:.1g}), but does not pay for its parameters"
        )
        return replace(result, verdict="unknown", reasons=(*reasons, Message(words, "more_than_chance")))
    if verdict == "named" and simulated is not None and _by_simulation(result) > LEVEL:
        share = f"{_by_simulation(result):.2g}"
        words = f"simulated campaigns without any effect give a candidate as good with probability {share}"
        reason = Message(f"{words}: the name is withdrawn", "name_withdrawn")
        return replace(result, verdict="unknown" if beyond > 0 else "none", reasons=(*reasons, reason))
    return result


def _by_simulation(result: JudgedSearch) -> float:
    """Probability that chance gives a candidate as good, by simulated campaigns and the test trials."""
    best, share = result.found.searches[0].best, result.chance.largest_candidate or 0.0
    return min(share, 2 * both_by_weight(share, best.gain, best.again)) if best is not None else share


def _rarest(result: JudgedSearch) -> float:
    """Probability that chance gives any candidate what the best has after its refit.

    A score to first order alone does not count: that of an effect with a memory promises gains that no refit finds.
    """
    refitted = result.found.searches[0].refitted if result.found.searches else ()
    by_refit = min((r.p_refit for r in refitted), default=1.0)
    by_simulation = result.chance.largest_candidate if result.simulated is not None else None
    return max(by_refit, by_simulation or 0.0)

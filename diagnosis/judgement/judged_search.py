"""Effects selected and judged: search, tests of what is left, check on test trials, chance, verdict."""

from __future__ import annotations

from dataclasses import dataclass, replace

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import LEVEL, Selection, select_effects
from diagnosis.hypotheses.left_findings import Chance
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.second_sample import both_by_weight
from diagnosis.hypotheses.simulated_chance import SimulatedChance, simulated_chance
from diagnosis.hypotheses.unnamed import UnnamedForms, unnamed_forms
from diagnosis.inputs import DiagnosisOptions
from diagnosis.judgement.possible_size import impossible_size
from diagnosis.judgement.verdict import contradicts, decide
from diagnosis.prepare import Prepared
from diagnosis.validation.held_out import compare, prediction_errors
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress


@dataclass(frozen=True)
class JudgedSearch:
    """Of a search: the selection, tests of unnamed forces without and with it, the check on test trials, the verdict,
    and why a name was withdrawn. beside: sentences on effects that were left out beside others, for a size that they
    cannot have."""

    found: Selection
    before: UnnamedForms
    after: UnnamedForms
    held: HeldOut | None
    verdict: str
    reasons: tuple[Message, ...]
    simulated: SimulatedChance | None
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
    """Select effects and judge them. Beside a name that the ``tests`` contradict it does not matter what else is left.

    ready: the problem and its fit without effects; tests: trials to check on; options: of the diagnosis; progress:
    called as the work goes on. Returns the selection with its verdict.
    """
    p = replace(ready.problem, tests=tests)
    before, simulated = unnamed_forms(p.steps, p.data, ready.null), None
    if options.bootstrap:
        LOGGER.info(f"simulating {options.bootstrap} campaigns in which nothing is missing")
        store = options.store.part("campaigns") if options.store is not None else None
        simulated = simulated_chance(p, ready.null, options.bootstrap, options.seed, options.workers, progress, store)
        before = replace(before, chance=simulated.unnamed)
    found, beside = select_effects(p, ready.null, options.seed, options.workers, progress), list[Message]()
    while len(found.effects) > 1 and (impossible := impossible_size(ready.full, found.final, found.effects[-1])):
        beside.append(Message(f"what is left beside the name acts like {impossible}", "impossible_size"))
        found = found.without_last(p)
    held = None
    if tests is not None:
        without, with_it = (prediction_errors(p.steps, tests, fit) for fit in (found.null, found.final))
        held = compare(tests, without, with_it, options.seed)
    stands = bool(found.effects) and not (held is not None and contradicts(found, held))
    after = unnamed_forms(p.steps, p.data, found.final) if stands else before
    return replace(_answer(found, (before, after), held, p, simulated), beside=tuple(beside))


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

"""What a diagnosis' rules are worth: answers to cases whose key is open, with each rule switched off.

Cases are those of ``benchmarks/blind``: of every world nothing hidden, an effect of the library, a cause that the
library does not hold. A case is diagnosed once; what its fits and tests gave is remembered, so that a rule that is
switched off is judged by a replay of the decision, with new fits only where the other decision asks for them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ablation.switches import Memo, Switch, constantly, replaced
from benchmarks.blind.cases import Case, answer, dealt, opened, question
from benchmarks.blind.generator.world import WORLDS
from diagnosis.hypotheses.unnamed import FORCES, UnnamedSlopes

KINDS = {"null": 8, "library": 20, "strangers": 12}
"""Cases of each kind in each world."""
SEED = 4902
"""Of the cases; it was never used before."""

SEARCH, JUDGE = "diagnosis.hypotheses.forward_selection", "diagnosis.judgement"
FORMS = "diagnosis.hypotheses.unnamed:UnnamedSlopes.statistics"
REMEMBERED = (
    "diagnosis.prepare:prepare",
    "diagnosis.prepare:TransitionModel",
    "diagnosis.estimation.candidates:ship_with_all_effects",
    "diagnosis.estimation.first_fit:fit_without_effects",
    "diagnosis.estimation.map_estimate:estimate",
    "diagnosis.estimation.residual_checks:with_correlation_time",
    "diagnosis.estimation.force_order:force_order",
    "diagnosis.estimation.gusts:trials_in_gusts",
    "diagnosis.hypotheses.refit:refit",
    "diagnosis.hypotheses.score_test:score_tests",
    "diagnosis.hypotheses.score_test:slopes",
    "diagnosis.hypotheses.unnamed:unnamed_forms",
    "diagnosis.hypotheses.unnamed:unnamed_slopes",
    FORMS,
    "diagnosis.judgement.budget:budget_of",
    "diagnosis.validation.held_out:compare",
    "diagnosis.validation.held_out:filtered_along",
)
"""Functions whose results are remembered: what takes time, and what a decision takes from it."""
TOLD_ONLY = {
    "diagnosis.location.where:where": constantly({}),
    "diagnosis.hypotheses.next_test:next_test": constantly(""),
    "diagnosis.hypotheses.next_test:telling_test": constantly(""),
    "diagnosis.hypotheses.unexplained_force:unexplained_force": constantly(None),
}
"""What is told beside the answer and does not change it."""


def without_kinds(is_left_out: Callable[[str], bool]) -> Mapping[str, Any]:
    """The unnamed forms without those kinds for which ``is_left_out``."""

    def statistics(self: UnnamedSlopes, g: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        _, single, logs = WHOLE(self, g)
        kept = {name: log for name, log in logs.items() if not is_left_out(name)}
        return np.logaddexp.reduce(np.stack(list(kept.values())), axis=0) - np.log(len(kept)), single, kept

    return {FORMS: statistics}


def of_all_kinds(self: UnnamedSlopes, g: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """The unnamed forms without the test of the best force alone."""
    mixture, single, logs = WHOLE(self, g)
    return mixture, np.full_like(single, -1e6), logs


WHOLE: Callable[..., Any] = UnnamedSlopes.statistics
"""The statistics of the unnamed forms as they are; remembered while cases are replayed."""
ONCE = ("unnamed_forms",)
FIRST = ("prepare",)

RULES = (
    Switch("as it is", "nothing"),
    Switch("test trials", "test trials say nothing of candidates",
           {f"{SEARCH}:_predictive": constantly(0.0)}),
    Switch("possible sizes", "effects of an impossible size are named",
           {f"{JUDGE}.verdict:impossible_size": constantly("")}),
    Switch("not random", "neither test of what is left", {f"{JUDGE}.verdict:not_random": constantly([])}),
    Switch("line", "no test of lines in the spectrum", {f"{JUDGE}.verdict:LINE_PROBABILITY": 0.0}),
    Switch("force order", "no test of forces that follow each other",
           {"diagnosis.estimation.force_order:ForceOrder.is_random": property(constantly(True))}),
    Switch("matters", "a remainder counts whatever its size",
           {"diagnosis.findings:Budget.matters": property(constantly(True))}),
    Switch("best force alone", "no test of the best force alone", {FORMS: of_all_kinds}, inside=ONCE),
    *(Switch(f"forms: {name}", words, without_kinds(is_left_out), inside=ONCE) for name, words, is_left_out in (
        ("sensors", "no unnamed errors of sensors", lambda k: k.startswith("sensor of ")),
        ("at times", "no unnamed events", lambda k: k.endswith(" at times")),
        ("swinging", "no forces that swing", lambda k: k.startswith("force that swings")),
        ("inputs", "no unnamed action or delay of an input", lambda k: k.startswith(("action of ", "delay of "))),
        ("all but forces", "products of velocities and inputs as forces, and nothing else", lambda k: k not in FORCES),
    )),
    Switch("further effects", "one effect at most is named", {f"{SEARCH}:MOST": 1}),
    Switch("memory refitted", "the force's memory stays as without effects",
           {f"{SEARCH}:with_correlation_time": lambda steps, data, found, least=0.0: found}),
)  # fmt: skip
"""Each is replayed on the evidence of the first."""
SOME = 4
"""Of so many cases one is also replayed with RARE, which change all fits."""
RARE = (
    Switch("correlated samples", "neighbouring samples are compared though their errors are correlated",
           {"diagnosis.estimation.first_fit:CORRELATED": 9.0}, inside=(*FIRST, "fit_without_effects")),
    Switch("sensor faults", "faults of sensors that the columns show are not modelled",
           {"diagnosis.prepare:with_sensor_faults": lambda case: (case, [])}),
    Switch("dispersion", "residuals count as independent",
           {"diagnosis.hypotheses.score_test:dispersion": constantly(1.0)}, inside=("slopes", *ONCE, "unnamed_slopes")),
)  # fmt: skip


def cases(work: Path) -> list[Case]:
    """All cases, in an order in which any first part of them holds all worlds and kinds; those that are not there are
    generated in ``work``."""
    parts = []
    for number, world in enumerate(WORLDS):
        for kind, count in KINDS.items():
            folder = work / "diagnoses" / f"{world}_{kind}"
            parts.append(opened(folder, dealt(folder, world, kind, count, SEED + number)))
    placed = [((i + 0.5) / len(part), n, case) for n, part in enumerate(parts) for i, case in enumerate(part)]
    return [case for *_, case in sorted(placed, key=lambda row: row[:2])]


def answers(case: Case, rules: tuple[Switch, ...] = RULES) -> dict[str, Any]:
    """The answer to a case as it is, the evidence behind it, and the answer without each of the ``rules``: verdict,
    names, whether something is left over."""
    global WHOLE
    used, memo, seconds = time.process_time(), Memo(), {}
    ask = question(case.folder)
    found: dict[str, Any] = {}
    whole, remembered = WHOLE, {target: memo.of(target) for target in REMEMBERED}
    with replaced(remembered | TOLD_ONLY):
        WHOLE = UnnamedSlopes.statistics
        try:
            for rule in rules:
                began, memo.switch = time.process_time(), rule
                with replaced(rule.replaced):
                    found[rule.name] = answer(ask)
                seconds[rule.name] = round(time.process_time() - began, 2)
        finally:
            WHOLE = whole
    first = found.pop("as it is")
    kept = {rule: answer[:3] for rule, answer in found.items()}
    return {
        "truth": list(case.truth), "strength": case.strength, "answer": first[:3], "evidence": first[3],
        "without": kept, "processor": round(time.process_time() - used, 1), "each": seconds,
    }  # fmt: skip

"""When nothing is named: "none" only if no effect fits better than chance after its refit."""

from __future__ import annotations

import pytest

from diagnosis.hypotheses.forward_selection import RefittedEffect, Search, Selection
from diagnosis.hypotheses.second_sample import CERTAIN
from diagnosis.inputs import DiagnosisOptions
from diagnosis.judgement import judged_search
from tests.diagnosis.judgement.test_verdict import ready
from tests.support.diagnosis_cases import candidate

CASES = {
    "chance": (0.3, "none"),
    "hardly chance": (2 * CERTAIN, "none"),
    "more than chance": (0.5 * CERTAIN, "unknown"),
    "a score that no refit bears out": (1.0, "none"),
}
"""What is found -> probability by its refit, verdict."""


@pytest.mark.parametrize("case", CASES)
def test_a_candidate_beyond_chance_that_does_not_pay_is_unknown(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    p_refit, verdict = CASES[case]
    prepared = ready()
    one = candidate("current")
    refitted = RefittedEffect(one, prepared.null, 3.0, -4.0, 1e-4, p_refit)
    found = Selection((), prepared.null, prepared.null, (Search((), (refitted,), prepared.null),))
    monkeypatch.setattr(judged_search, "select_effects", lambda *_: found)
    result = judged_search.judged_search(prepared, None, DiagnosisOptions(), None)
    assert result.verdict == verdict
    assert [m.code for m in result.reasons] == (["more_than_chance"] if verdict == "unknown" else [])

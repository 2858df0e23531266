"""A search that is repeated with fewer candidates finds what one from the start would, without its work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.hypotheses import forward_selection, search_problem
from diagnosis.hypotheses.forward_selection import refit_candidate, search
from diagnosis.hypotheses.known_results import KnownResults
from tests.support.diagnosis_cases import candidate, problem_of, pushed_trials

NAMES = ("current", "rudder_offset", "hull_memory", "tow")


def test_a_search_without_some_candidates_repeats_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, null = problem_of(pushed_trials(1, ["current:x=0.03"]))
    problem = replace(problem, candidates=tuple(candidate(name) for name in NAMES))
    fewer = replace(problem, candidates=problem.candidates[1:])
    anew = search(replace(fewer, known=KnownResults()), null, [])
    search(problem, null, [])
    monkeypatch.setattr(forward_selection, "slopes", lambda *given: pytest.fail("tested again"))
    monkeypatch.setattr(forward_selection, "refit_task", lambda task: pytest.fail("refitted again"))
    again = search(fewer, null, [])
    assert [one.candidate for one in again.refitted] == [one.candidate for one in anew.refitted]
    for one, other in zip(again.refitted, anew.refitted, strict=True):
        np.testing.assert_allclose(one.fit.p, other.fit.p, atol=1e-6)
        assert one.delta_bic == pytest.approx(other.delta_bic, abs=1e-6)
        assert one.p_value == pytest.approx(other.p_value, rel=1e-6)
    for test in anew.scores:
        same = again.score(test.candidate)
        np.testing.assert_allclose((same.T, same.p_value), (test.T, test.p_value), rtol=1e-6, atol=1e-9)


def test_what_was_found_at_another_fit_or_beside_other_effects_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, null = problem_of(pushed_trials(1))
    first, second = candidate("rudder_offset"), candidate("hull_memory")
    problem = replace(problem, candidates=(first, second))
    found = search(problem, null, [])
    refitted: list[str] = []

    def counted(task: tuple) -> forward_selection.RefittedEffect:
        refitted.append(task[3].candidate.effect)
        return refit_candidate(*task)

    monkeypatch.setattr(forward_selection, "refit_task", counted)
    search(problem, replace(null, p=null.p.copy()), [])
    assert sorted(refitted) == ["hull_memory", "rudder_offset"]
    fit = next(one.fit for one in found.refitted if one.candidate == first)
    search(problem, fit, [first])
    assert refitted[2:] == ["hull_memory"]


def test_trials_that_took_no_part_are_followed_once_by_each_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, null = problem_of(pushed_trials(1))
    followed: list[object] = []
    monkeypatch.setattr(search_problem, "other_trials", lambda *given: followed.append(given) or len(followed))
    other = replace(null, p=null.p.copy())
    found = [problem.followed(fit, problem.data) for fit in (null, other, null, other)]
    assert found == [1, 2, 1, 2] and [given[2] for given in followed] == [null, other]  # type: ignore[index]

"""Which candidates are refitted, and which of them comes first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import diagnosis.hypotheses.forward_selection as hypotheses
from diagnosis.estimation.candidates import Candidate
from diagnosis.hypotheses.forward_selection import CLEAR, CURVED, SHORT, RefittedEffect, ScoreTest, search
from diagnosis.hypotheses.score_test import Slopes
from tests.support.diagnosis_cases import problem_of, pushed_trials


def candidate(name: str) -> Candidate:
    return Candidate(name, "", (), *4 * [np.zeros(0)])


def row(name: str, p: float, degrees: int = 1, T: float = 10.0) -> ScoreTest:
    return ScoreTest(candidate(name), T, degrees, p, min(1.0, 20 * p), np.ones(degrees), 0.0, True, np.ones(degrees))


def tried(name: str, delta_bic: float, drop: float = 5.0) -> RefittedEffect:
    return RefittedEffect(candidate(name), None, drop, delta_bic, 0.01)  # type: ignore[arg-type]


def names(rows: list[RefittedEffect], scores: list[ScoreTest]) -> list[str]:
    return [t.candidate.label for t in hypotheses.in_order(rows, {s.candidate: s for s in scores})]


SCORES = [row("tow", 1e-4, 3), row("draft", 4e-3), row(CURVED[0], 0.9)]


def test_where_one_gains_clearly_the_refits_decide() -> None:
    assert names([tried("tow", 2.0), tried("draft", CLEAR + 1)], SCORES) == ["draft", "tow"]


def test_where_none_does_the_probabilities_of_the_score_test_decide() -> None:
    """An effect with three parameters pays three times in BIC."""
    assert names([tried("draft", CLEAR - 1), tried("tow", -2.0)], SCORES) == ["tow", "draft"]


@pytest.mark.parametrize(("drop", "place"), [(12.0, 0), (0.1, 2)])
def test_of_a_dead_band_the_refit_says_how_probable_it_is(drop: float, place: int) -> None:
    rows = [tried("draft", 4.0), tried("tow", -2.0), tried(CURVED[0], 3.0, drop)]
    assert names(rows, SCORES).index(CURVED[0]) == place


def test_nothing_is_put_in_order_of_nothing() -> None:
    assert names([], SCORES) == []


def test_the_most_probable_are_refitted(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, null = problem_of(pushed_trials(1))
    scores = [row(f"e{i}", 10.0 ** (i - 9), 3, T=9.0 - i) for i in range(8)]  # three parameters each: none pays by BIC
    monkeypatch.setattr(hypotheses, "slopes", lambda *args: Slopes((), np.zeros(0), np.zeros((0, 0)), np.zeros(0)))
    monkeypatch.setattr(hypotheses, "score_tests", lambda *args: [*scores, row(CURVED[0], 0.9, T=0.1)])
    monkeypatch.setattr(hypotheses, "refit_task", lambda task: RefittedEffect(task[3].candidate, None, 5.0, 0.0, 0.01))
    monkeypatch.setattr(hypotheses, "run_all", lambda f, tasks, *more: [f(t) for t in tasks])
    asked = {t.candidate.label for t in search(replace(problem, candidates=()), null, []).refitted}
    assert asked >= {CURVED[0], *(f"e{i}" for i in range(SHORT))}
    assert not asked & {f"e{i}" for i in range(SHORT, 8)}

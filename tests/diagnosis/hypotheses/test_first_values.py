"""Refits begin where coefficients go, to first order, when an effect comes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.refit import refit
from diagnosis.hypotheses.score_test import followed, score_tests, slopes
from diagnosis.hypotheses.search_problem import SearchProblem
from tests.support.diagnosis_cases import candidate, pushed_problem


@pytest.fixture(scope="module")
def case() -> tuple[SearchProblem, Estimate]:
    return pushed_problem(1, "draft:share=0.1")


def first_point(problem: SearchProblem, before: Estimate, effects: list, start: dict) -> Estimate:
    return refit(problem.steps, problem.data, problem.base, before, effects, start, iterations=1)


def test_with_an_effect_more_the_first_point_is_likelier_than_with_coefficients_that_stay(case: tuple) -> None:
    problem, null = case
    effect = candidate("draft")
    score = score_tests(slopes(problem.steps, problem.data, null, [effect]), [effect])[0]
    size = effect.neutral + score.phi * effect.typical
    start = dict(zip(effect.columns, size, strict=True))
    moved = followed(null, score, size)
    assert set(moved) == set(null.free.columns) and not followed(null, replace(score, taken=np.zeros((0, 0))), size)
    stay, goes = (first_point(problem, null, [effect], values) for values in (start, moved | start))
    end = refit(problem.steps, problem.data, problem.base, null, [effect], start, iterations=12)
    assert end.nll - 0.1 < goes.nll < stay.nll - 0.5 and goes.nll - end.nll < 0.5 * (stay.nll - end.nll)

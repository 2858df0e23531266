"""Trials that took no part show an effect again, with its size, where it is there; and not where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.forward_selection import search
from diagnosis.hypotheses.found_again import NOTHING, other_trials, same_trials
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.hypotheses.search_problem import SearchProblem
from tests.support.diagnosis_cases import candidate, problem_of, pushed_trials
from tests.support.quick import first_quick

DRIFT = "wave_drift:x=0.45,y=-0.35"


def gridded(effects: list[str], seed: int, like: SearchProblem) -> GriddedTrials:
    """Trials with these effects on the grid of a problem."""
    return grid_trials(pushed_trials(seed, effects), like.steps.ship.inputs, 3.0, like.data.h)


@pytest.fixture(scope="module")
def drifting() -> tuple[SearchProblem, Estimate]:
    return problem_of(pushed_trials(1, [DRIFT]))


@pytest.fixture(scope="module")
def alike(drifting: tuple[SearchProblem, Estimate]) -> GriddedTrials:
    return gridded([DRIFT], 2, drifting[0])


def test_an_effect_is_found_again_where_it_is_there(
    drifting: tuple[SearchProblem, Estimate], alike: GriddedTrials
) -> None:
    (problem, null), effect = drifting, candidate("wave_drift")
    (found,) = score_tests(slopes(problem.steps, problem.data, null, [effect]), [effect])
    shift = np.zeros(len(null.p))
    same = other_trials(problem.steps, alike, null).effect(effect, found.phi, shift)
    gone = other_trials(problem.steps, gridded([], 2, problem), null).effect(effect, found.phi, shift)
    assert same.expected > 4 and abs(same.z - same.expected) < 0.5 * same.expected and same.gain > 0
    assert abs(gone.z) < 3 and gone.expected == pytest.approx(same.expected, rel=1.0) and gone.gain < 0
    assert other_trials(problem.steps, alike, null).effect(effect, np.zeros(2), np.zeros(len(null.p))) == NOTHING


@pytest.mark.parametrize(("text", "linear"), first_quick([(DRIFT, True), ("hull_memory:T=2.0", False)]))
def test_the_trials_themselves_show_what_is_expected_of_a_linear_effect_and_less_of_a_long_memory(
    text: str, linear: bool
) -> None:
    """So that other trials show about as much as is then expected of them."""
    problem, null = problem_of(pushed_trials(1, [text]))
    effect = candidate(text.partition(":")[0])
    best = search(replace(problem, candidates=(effect,), tests=gridded([text], 2, problem)), null, []).best
    assert best is not None and best.gain > 8
    phi = (np.array([best.fit.value(*x) for x in effect.columns]) - effect.neutral) / effect.typical
    shift = best.fit.p[: len(null.p)] - null.p
    own = same_trials(problem.steps, problem.data, null).effect(effect, phi, shift)
    assert own.z / own.expected == pytest.approx(1.0, abs=0.25) if linear else own.z < 0.7 * own.expected
    there = other_trials(problem.steps, gridded([text], 2, problem), null).effect(effect, phi, shift)
    assert best.again == there.scaled(own) and abs(best.again.z - best.again.expected) < 3
    assert linear or best.again.expected < 0.7 * there.expected


def test_the_best_of_a_search_is_looked_for_in_the_test_trials(
    drifting: tuple[SearchProblem, Estimate], alike: GriddedTrials
) -> None:
    problem, null = drifting
    few = replace(problem, candidates=(candidate("wave_drift"), candidate("rudder_offset")), tests=alike)
    best = search(few, null, []).best
    assert best is not None and best.candidate.effect == "wave_drift"
    assert best.again.z > 3 and best.p_both < best.p_value and best.bic_of_both > best.delta_bic
    alone = search(replace(few, tests=None), null, []).best
    assert alone is not None and alone.again == NOTHING and alone.p_both == alone.p_value


def test_what_coefficients_make_up_for_is_expected_nowhere() -> None:
    problem, null = problem_of(pushed_trials(1))
    effect = candidate("fouling")  # one with the resistance
    others = other_trials(problem.steps, gridded([], 2, problem), null)
    phi = np.array([0.5])
    alone = others.effect(effect, phi, np.zeros(len(null.p)))
    resistance = np.array([c.symbol == "X_0F" for c in null.free.columns])
    column = 0.5 * effect.typical[0] * null.free.mean[resistance] / null.free.std[resistance]
    made_up = others.effect(effect, phi, np.where(resistance, -float(column[0]), 0.0))
    assert made_up.expected < 0.3 * alone.expected

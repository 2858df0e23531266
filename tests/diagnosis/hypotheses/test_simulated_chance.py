"""Chance by simulation: the campaigns are those of the model, and their tests follow the law to first order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.simulated_chance import SimulatedChance, simulated_chance, simulated_trials
from diagnosis.hypotheses.unnamed import unnamed_forms
from fitting.report.parts import Store
from mmg.errors import UserError
from tests.support.diagnosis_cases import candidate, problem_of, pushed_trials


@pytest.fixture(scope="module")
def fitted() -> tuple[SearchProblem, Estimate]:
    return problem_of(pushed_trials(1, runs=(("zigzag:20/20", 60.0), ("random:11", 60.0))), 1.0)


def test_simulated_trials_have_the_noise_of_the_model(fitted: tuple[SearchProblem, Estimate]) -> None:
    problem, null = fitted
    seen, path = simulated_trials(problem.steps, problem.data, null, np.random.default_rng(0))
    off = (seen.y - problem.steps.logged(path.z, null.theta))[problem.data.good.all(axis=2)]
    np.testing.assert_allclose(off.std(axis=0), null.noise.white, rtol=0.35)
    assert np.array_equal(seen.inputs, problem.data.inputs) and np.array_equal(seen.good, problem.data.good)
    again, _ = simulated_trials(problem.steps, problem.data, null, np.random.default_rng(0))
    assert np.array_equal(seen.y, again.y)


@pytest.mark.slow
def test_the_tests_of_simulated_campaigns_follow_their_law(fitted: tuple[SearchProblem, Estimate]) -> None:
    """Few campaigns, so only the gross agreement of the median and of the upper end."""
    problem, null = fitted
    few = SearchProblem(problem.steps, problem.data, problem.base, (candidate("current"), candidate("rudder_offset")))
    found = simulated_chance(few, null, 12, seed=3)
    law = unnamed_forms(problem.steps, problem.data, null)
    assert found.unnamed.shape == (12, 2) and found.smallest.shape == (12,)
    assert (found.unnamed[:, 0] > law.limit).sum() <= 2 and (found.unnamed[:, 1] > law.single_limit).sum() <= 2
    low, high = np.quantile(law.chance[:, 0], [0.02, 0.9])
    assert low < np.median(found.unnamed[:, 0]) < high
    assert 0.02 < np.median(found.smallest) < 0.8


def test_a_campaign_that_was_kept_is_not_simulated_again(
    fitted: tuple[SearchProblem, Estimate], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, null = fitted
    few = SearchProblem(problem.steps, problem.data, problem.base, (candidate("current"),))
    found = simulated_chance(few, null, 2, seed=4, store=Store(tmp_path / "parts", {"seed": 4}))

    def none(_: object) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr("diagnosis.hypotheses.simulated_chance.simulated_tests", none)
    again = simulated_chance(few, null, 2, seed=4, store=Store(tmp_path / "parts", {"seed": 4}, resume=True))
    assert np.array_equal(again.unnamed, found.unnamed) and np.array_equal(again.smallest, found.smallest)
    with pytest.raises(UserError, match=r"--resume.*seed"):
        simulated_chance(few, null, 2, seed=5, store=Store(tmp_path / "parts", {"seed": 5}, resume=True))


def test_a_probability_counts_the_campaigns_that_go_as_far() -> None:
    some = SimulatedChance(np.zeros((4, 2)), np.array([0.001, 0.2, 0.3, 0.4]))
    assert some.of_smallest(0.01) == pytest.approx(2 / 5) and some.of_smallest(1e-9) == pytest.approx(1 / 5)

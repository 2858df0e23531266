"""What a diagnosis says of its own limits: coefficients far off, records without noise, runs that are too short."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.noise_sizes import least_noise
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.refit import refit
from diagnosis.judgement.judged_search import limits
from diagnosis.prepare import InputReading, Prepared
from tests.support.diagnosis_cases import candidate, full_model, problem_of, pushed_trials

RUNS = (("zigzag:20/20", 40.0), ("turning:-20", 40.0))


@cache
def ready() -> Prepared:
    problem, null = problem_of(pushed_trials(1, runs=RUNS), 1.0)
    return Prepared(problem, full_model(), null, InputReading(False, None, 0.1, 3.0), 1, (), (1.0, float("inf")))


def said(null: Estimate, held: object = True) -> dict[str, str]:
    """Sentences on what these trials cannot tell, by code, with this fit without effects."""
    trials = pushed_trials(1, runs=RUNS)
    found = SimpleNamespace(searches=[SimpleNamespace(scores=())])
    rows = limits(replace(ready(), null=null), found, trials, trials, held)  # type: ignore[arg-type]
    return {row.code: str(row) for row in rows}


def test_a_fit_as_it_should_be_is_not_doubted() -> None:
    noise = ready().null.noise.with_(tau=5.0)
    assert said(replace(ready().null, noise=noise)) == {}
    assert list(said(replace(ready().null, noise=noise), None)) == ["tests_too_short"]


def test_a_coefficient_far_from_its_prior_is_named() -> None:
    null = ready().null
    p = null.p.copy()
    p[1] = -4.2
    words = said(replace(null, p=p))["far_from_prior"]
    assert f"{null.free.symbols[1]} (-4.2)" in words and null.free.symbols[0] not in words


def test_sensors_at_the_least_noise_are_named() -> None:
    null, least = ready().null, least_noise(ready().full.ship)
    white = null.noise.white.copy()
    white[[2, 5]] = least.white[[2, 5]]
    assert " psi, r, " in said(replace(null, noise=null.noise.with_(white=white)))["no_noise"]


def test_runs_hardly_longer_than_the_memory_of_the_force_are_doubted() -> None:
    words = said(replace(ready().null, noise=ready().null.noise.with_(tau=20.0)))["short_trials"]
    assert "40" in words and "remembers 20 s" in words


def test_a_refit_whose_first_values_make_the_ship_explode_begins_nearer_to_neutral(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    p, null, effect = ready().problem, ready().null, candidate("current")
    begun: list[float] = []
    advance = TransitionModel.linearise

    def exploding(
        self: TransitionModel, z: np.ndarray, inputs: np.ndarray, theta: np.ndarray, *rest: np.ndarray
    ) -> object:
        begun.append(float(theta[self.ship.symbols.index("current.x")]))
        if begun[-1] > 0.1:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return advance(self, z, inputs, theta, *rest)

    monkeypatch.setattr(TransitionModel, "linearise", exploding)
    found = refit(p.steps, p.data, p.base, null, [effect], {effect.columns[0]: 0.3, effect.columns[1]: 0.0})
    assert begun[:2] == pytest.approx([0.3, 0.09]) and abs(found.value("current.x")) < 0.05

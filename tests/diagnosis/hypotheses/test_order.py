"""Which candidates are refitted, which comes first, and when the selection ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import diagnosis.hypotheses.forward_selection as hypotheses
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Trajectory
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.hypotheses.forward_selection import (
    CURVED,
    MOST,
    ODDS,
    SHORT,
    RefittedEffect,
    ScoreTest,
    Search,
    search,
    select_effects,
)
from diagnosis.hypotheses.refit import refit
from diagnosis.hypotheses.score_test import Slopes, followed, score_tests, slopes
from tests.support.diagnosis_cases import candidate, pushed_problem, quiet


def a_fit(nll: float) -> Estimate:
    """A fit of which only the likelihood matters."""
    zero = np.zeros(0)
    noise = NoiseModel(np.ones(3), 5.0, np.ones(6))
    path = Trajectory(np.zeros((2, 1, 6)), np.zeros((2, 1, 3)))
    return Estimate(zero, Priors((), zero, zero, zero, zero), zero, path, noise, np.zeros((0, 0)), nll, 1, True)


def made_up(label: str) -> Candidate:
    """A candidate of this label without parameters."""
    effect, form = (*label.split(" "), "")[:2]
    return Candidate(effect, form, (), *4 * [np.zeros(0)])


def tried(name: str, delta_bic: float, p_value: float = 1e-6) -> RefittedEffect:
    return RefittedEffect(made_up(name), a_fit(0.0), 0.5 * delta_bic, delta_bic, p_value)


def row(name: str, p: float, degrees: int = 1, T: float = 10.0) -> ScoreTest:
    return ScoreTest(made_up(name), T, degrees, p, min(1.0, 20 * p), np.ones(degrees), 0.0, True, np.ones(degrees))


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[Search]:
    """Searches that ``select_effects`` makes, one after the other."""
    made: list[Search] = []
    monkeypatch.setattr(hypotheses, "search", lambda problem, before, named, *more: made[len(named)])
    monkeypatch.setattr(hypotheses, "with_correlation_time", lambda steps, data, found, least: found)
    monkeypatch.setattr(hypotheses, "refitted_without", lambda problem, best, named: a_fit(99.5))
    return made


def found_by(searches: Sequence[Sequence[RefittedEffect]]) -> list[Search]:
    return [Search((), tuple(rows), a_fit(100.0)) for rows in searches]


def test_the_most_probable_are_refitted_and_those_with_most_evidence_come_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, null = pushed_problem(1)
    scores = [row(f"e{i}", 10.0 ** (i - 9), 3, T=9.0 - i) for i in range(8)]
    gains = {"e0": 1.0, "e1": 9.0, "e2": 5.0}
    monkeypatch.setattr(hypotheses, "slopes", lambda *args: Slopes((), np.zeros(0), np.zeros((0, 0)), np.zeros(0)))
    monkeypatch.setattr(hypotheses, "score_tests", lambda *args: [*scores, row(CURVED[0], 0.9, T=0.1)])
    monkeypatch.setattr(
        hypotheses, "refit_task", lambda task: tried(task[3].candidate.label, gains.get(task[3].candidate.label, 0.0))
    )
    monkeypatch.setattr(hypotheses, "run_all", lambda f, tasks, *more: [f(t) for t in tasks])
    found = search(replace(problem, candidates=()), null, [], is_possible=lambda fit, c: c.label != "e1")
    asked = [r.candidate.label for r in found.refitted]
    assert set(asked) == {CURVED[0], *(f"e{i}" for i in range(SHORT))} and asked[:3] == ["e1", "e2", "e0"]
    assert found.best is not None and found.best.candidate.label == "e2"  # e1 has a size that cannot be


def test_selection_goes_on_while_the_evidence_is_enough(searches: list[Search]) -> None:
    problem, null = pushed_problem(1)
    searches += found_by([[tried("a", 2.2 * ODDS)], [tried("b", 2.1 * ODDS)], [tried("c", 1.9 * ODDS)]])
    found = select_effects(problem, null)
    assert [c.label for c in found.effects] == ["a", "b"] and len(found.searches) == 3
    assert found.evidence == pytest.approx((1.1 * ODDS, 1.05 * ODDS))
    assert len(found.fits) == 3 and found.fits[0] is searches[0].before
    one = found.first(1)
    assert [c.label for c in one.effects] == ["a"] and one.fits == found.fits[:2] and one.final is found.fits[1]


@pytest.mark.parametrize("rows", [[], [tried("a", 1.9 * ODDS)], [replace(tried("a", 99.0), is_possible=False)]])
def test_a_search_that_finds_nothing_leaves_the_fit_as_it_is(
    rows: list[RefittedEffect], searches: list[Search]
) -> None:
    problem, null = pushed_problem(1)
    searches += found_by([rows])
    found = select_effects(problem, null)
    assert found.effects == () and found.final is null is found.null and found.evidence == ()


def test_no_more_effects_are_named_than_can_be_believed(searches: list[Search]) -> None:
    problem, null = pushed_problem(1)
    searches += found_by([[tried(f"e{i}", 99.0)] for i in range(MOST + 1)])
    assert len(select_effects(problem, null).effects) == MOST


def test_an_effect_that_only_helped_the_fit_to_a_better_place_is_none(
    searches: list[Search], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search begins anew from there, and what came of it is the fit that all else is compared with."""
    problem, null = pushed_problem(1)
    better, begun = a_fit(null.nll - 40.0), []
    first, nothing = found_by([[tried("a", 80.0)], []])

    def searched(problem: object, before: object, *more: object) -> Search:
        begun.append(before)
        return first if before is null else replace(nothing, before=better)

    monkeypatch.setattr(hypotheses, "search", searched)
    monkeypatch.setattr(hypotheses, "refitted_without", lambda problem, best, named: better)
    found = select_effects(problem, null)
    assert begun == [null, better] and found.effects == () and found.null is better is found.final


def test_a_class_is_what_lies_within_the_odds_of_the_best() -> None:
    rows = (tried("a", 20.0), tried("b", 20.1 - 2 * ODDS), tried("c", 19.9 - 2 * ODDS), tried("d", -3.0))
    (found,) = found_by([rows])
    assert found.indistinguishable == (made_up("a"), made_up("b"))
    larger = (replace(tried("e", 30.0), is_possible=False), *rows)  # of a size that cannot be
    assert replace(found, refitted=larger).indistinguishable == (made_up("a"), made_up("b"))
    assert Search((), (), a_fit(0.0)).indistinguishable == () and Search((), (), a_fit(0.0)).best is None


@pytest.mark.slow
def test_an_effect_that_was_missing_no_longer_lengthens_the_memory_of_the_random_force() -> None:
    truth = quiet(tau=2.0)
    problem, null = pushed_problem(1, "current:x=0.05,y=-0.04", how=truth)
    found = select_effects(problem, null)
    assert [c.effect for c in found.effects] == ["current"]
    before, after = (abs(np.log(fit.noise.tau / truth.tau)) for fit in (null, found.final))
    assert after < 0.5 < 1.5 < before
    size = np.array([truth.X, truth.Y, truth.N])
    assert (null.noise.force > 4 * size).all() and (np.abs(np.log(found.final.noise.force / size)) < 0.6).all()


def test_with_an_effect_more_the_first_point_is_likelier_than_with_coefficients_that_stay() -> None:
    """Coefficients go, to first order, where they go when an effect comes."""
    p, null = pushed_problem(1, "draft:share=0.1")
    effect = candidate("draft")
    score = score_tests(slopes(p.steps, p.data, null, [effect]), [effect])[0]
    size = effect.neutral + score.phi * effect.typical
    start = dict(zip(effect.columns, size, strict=True))
    moved = followed(null, score, size)
    assert set(moved) == set(null.free.columns) and not followed(null, replace(score, taken=np.zeros((0, 0))), size)
    stay, goes, end = (
        refit(p, null, [effect], values, iterations=count)
        for values, count in ((start, 1), (moved | start, 1), (start, 12))
    )
    assert end.nll - 0.1 < goes.nll < stay.nll - 0.5 and goes.nll - end.nll < 0.5 * (stay.nll - end.nll)

"""Effects of the surroundings that differ from run to run: their columns, their naming, and their check elsewhere."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.trial import Trial
from diagnosis import summary
from diagnosis.diagnose import DiagnosisOptions, diagnose
from diagnosis.estimation.candidates import LOCAL, Candidate, Column, find
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors, get_values, mean_over_windows
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import Search, Selection, select_effects
from diagnosis.hypotheses.refit import refit, robust_p
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.prepare import prepare
from diagnosis.validation.held_out import STRIDE, WINDOW, errors, half_times, with_values_by_run
from tests.diagnosis.estimation.test_by_window import short_trials, three_windows
from tests.diagnosis.report.test_report import case
from tests.support.diagnosis_cases import (
    FEW,
    SHIP,
    compared,
    full_model,
    full_steps,
    problem_of,
    pushed_trials,
)

H = 1.0
RUNS = (("zigzag:20/20", 100.0), ("random:11", 100.0), ("turning:-20", 100.0))
TRUTH = ((0.04, 0.0), (-0.03, 0.02), (0.0, -0.04))
"""A current [m/s] of its own in each of the runs, none in their mean."""
ELSEWHERE = ((0.03, 0.03), (-0.04, 0.01), (0.01, -0.04))
OTHERS = (("zigzag:-20/20", 110.0), ("random:5", 120.0), ("turning:25", 130.0))


def in_currents(
    seed: int, runs: tuple[tuple[str, float], ...], currents: tuple[tuple[float, float], ...]
) -> list[Trial]:
    """Runs each in a current of its own."""
    trials = []
    for i, (run, (x, y)) in enumerate(zip(runs, currents, strict=True)):
        trial = pushed_trials(seed + i, [f"current:x={x},y={y}"], (run,))[0]
        trials.append(replace(trial, name=f"run {i}"))
    return trials


def local(problem: SearchProblem) -> SearchProblem:
    """With the candidates that differ by run, as ``prepare`` adds them."""
    runs = np.unique(problem.data.run).tolist()
    own = [c.in_each(runs) for c in problem.candidates if c.effect in LOCAL]
    return replace(problem, candidates=(*problem.candidates, *own))


@pytest.fixture(scope="module")
def fits() -> tuple[SearchProblem, Estimate, Selection]:
    """Runs in currents of their own: the problem, the fit without any effect, and what is found."""
    problem, null = problem_of(in_currents(10, RUNS, TRUTH), H)
    problem = local(problem)
    return problem, null, select_effects(problem, null)


def test_slopes_by_run_add_up_to_those_of_all_runs(fits: tuple[SearchProblem, Estimate, Selection]) -> None:
    problem, null, _ = fits
    both = [c for c in problem.candidates if c.effect in LOCAL]
    s = slopes(problem.steps, problem.data, null, both)
    one, own = ([x for c in both if c.by_run is by_run for x in c.columns] for by_run in (False, True))
    adds = np.array([[x.symbol == y.symbol for x in own] for y in one], dtype=float)
    a, b = (np.array([s.columns.index(x) for x in columns]) for columns in (one, own))
    np.testing.assert_allclose(adds @ s.g[b], s.g[a], rtol=1e-9, atol=1e-9 * np.abs(s.g).max())
    np.testing.assert_allclose(adds @ s.S[np.ix_(b, b)] @ adds.T, s.S[np.ix_(a, a)], rtol=1e-8, atol=1e-9 * s.S.max())
    np.testing.assert_allclose(adds @ s.own[b], s.own[a], rtol=1e-9)
    rows = {row.candidate.label: row for row in score_tests(s, both)}
    for name in LOCAL:
        by_run = rows[f"{name} by run"]
        assert by_run.T >= rows[name].T and by_run.degrees == 3 * rows[name].degrees


def test_information_on_a_run_is_that_where_no_other_run_counts(
    fits: tuple[SearchProblem, Estimate, Selection],
) -> None:
    problem, null, _ = fits
    one, own = ([find(problem.candidates, "current", by_run=by_run)] for by_run in (False, True))
    s = slopes(problem.steps, problem.data, null, own)
    for r in range(3):
        alone = replace(problem.data, good=problem.data.good & (problem.data.run == r)[:, None])
        at = [s.columns.index(Column(f"current.{k}", r)) for k in "xy"]
        np.testing.assert_allclose(s.own[at], slopes(problem.steps, alone, null, one).own, rtol=1e-9)


def test_of_a_single_run_the_candidate_by_run_is_the_candidate_itself() -> None:
    problem, null = problem_of(pushed_trials(1, ["current:x=0.03,y=-0.02"], RUNS[:1]), H)
    current = find(problem.candidates, "current")
    by_run = current.in_each([0])
    a, b = (slopes(problem.steps, problem.data, null, [c]) for c in (current, by_run))
    np.testing.assert_allclose(a.g, b.g, rtol=1e-12)
    np.testing.assert_allclose(a.S, b.S, rtol=1e-12)
    one, own = (
        refit(problem.steps, problem.data, problem.base, null, [c], dict(zip(c.columns, (0.02, -0.01), strict=True)))
        for c in (current, by_run)
    )
    assert own.theta.shape == (len(problem.steps.ship.symbols), 1) and one.theta.ndim == 1
    np.testing.assert_allclose(own.theta[:, 0], one.theta, rtol=1e-9, atol=1e-12)
    assert own.nll == pytest.approx(one.nll, rel=1e-10)


def test_the_score_by_run_points_to_the_size_in_each_run(fits: tuple[SearchProblem, Estimate, Selection]) -> None:
    problem, null, _ = fits
    chosen = [find(problem.candidates, "current", by_run=by_run) for by_run in (False, True)]
    rows = {row.candidate: row for row in score_tests(slopes(problem.steps, problem.data, null, chosen), chosen)}
    one, own = (rows[c] for c in chosen)
    assert own.p_single < 1e-15 and own.T > one.T + 50
    size = (own.phi * chosen[1].typical).reshape(3, 2)
    np.testing.assert_allclose(size, TRUTH, atol=0.015)


def test_a_current_of_its_own_in_each_run_is_named_by_run(fits: tuple[SearchProblem, Estimate, Selection]) -> None:
    problem, _, found = fits
    by_run = find(problem.candidates, "current", by_run=True)
    assert found.effects == (by_run,) and found.robust == {by_run: 0.0}
    assert found.final.theta.shape == (len(problem.steps.ship.symbols), 3)
    for r, pair in enumerate(TRUTH):
        for k, value in zip("xy", pair, strict=True):
            column = Column(f"current.{k}", r)
            assert abs(found.final.value(*column) - value) < 4 * found.final.std(*column) < 0.02, column
            got = get_values(problem.steps.ship, problem.data, found.final.theta, [column])
            assert got[0] == pytest.approx(found.final.value(*column))


def test_a_current_that_is_the_same_in_all_runs_is_not_named_by_run() -> None:
    problem, null = problem_of(in_currents(10, RUNS, 3 * ((0.03, -0.02),)), H)
    problem = local(problem)
    found = select_effects(problem, null)
    current = find(problem.candidates, "current")
    assert found.effects == (current,)
    refitted = [t.candidate for t in found.searches[0].refitted]
    assert any(c.effect == "current" and c.by_run for c in refitted) and found.final.theta.ndim == 1
    assert (found.final.value("current.x"), found.final.value("current.y")) == pytest.approx((0.03, -0.02), abs=0.005)
    row = summary.named_effect(problem, replace(full_model(), candidates=problem.candidates), found, current)
    assert row.by_run == {}


def test_without_the_effect_coefficients_are_those_of_all_runs_again(
    fits: tuple[SearchProblem, Estimate, Selection],
) -> None:
    problem, _, found = fits
    kept = problem.without(found.final, found.effects)
    np.testing.assert_array_equal(kept.theta, found.final.theta)
    none = problem.without(found.final, [])
    assert none.theta.ndim == 1
    current = [problem.steps.ship.symbols.index(s) for s in ("current.x", "current.y")]
    np.testing.assert_array_equal(none.theta[current], 0.0)
    assert none.theta[problem.steps.ship.symbols.index("Y_v")] == pytest.approx(found.final.value("Y_v"))
    assert robust_p(problem.steps, problem.data, found.final, found.effects[0]) == 0.0


def without_current(search: Search) -> Search:
    """The same search as if currents had not been looked for."""
    refitted = tuple(r for r in search.refitted if r.candidate.effect != "current")
    return replace(search, refitted=refitted, scores=tuple(s for s in search.scores if s.candidate.effect != "current"))


def test_what_is_told_has_each_effect_once_and_the_values_of_each_run(
    fits: tuple[SearchProblem, Estimate, Selection],
) -> None:
    problem, _, found = fits
    w = replace(full_model(), candidates=problem.candidates)
    names = [row.name for row in summary.ranking(w, found)]
    fewer = replace(found, searches=(without_current(found.searches[0]), *found.searches[1:]))
    again = [row.name for row in summary.ranking(w, fewer, found)]
    assert "current" not in [row.name for row in summary.ranking(w, fewer)]
    assert sorted(again) == sorted(names) and again[-1] == "current", "a candidate not searched again comes last"
    assert names[0] == "current" and len(names) == len(set(names))
    assert set(names) == {c.effect for c in problem.candidates}
    row = summary.named_effect(problem, w, found, found.effects[0])
    assert row.name == "current" and list(row.by_run) == ["run 0", "run 1", "run 2"]
    for r, values in enumerate(row.by_run.values()):
        assert values == {k: found.final.value(f"current.{k}", r) for k in "xy"}
    for k in "xy":
        assert row.parameters[k].value == pytest.approx(np.mean([v[k] for v in row.by_run.values()]))
        errors_of = [found.final.std(f"current.{k}", r) for r in range(3)]
        assert 0 < row.parameters[k].std < max(errors_of)
    assert "current" not in summary.equivalence_class(found)
    ship = summary.fitted_ship(SHIP, w, found.final, found.effects)
    assert ship.parameters_of("current").x == pytest.approx(row.parameters["x"].value)
    assert ship.coefficients["Y_v"].value == pytest.approx(found.final.value("Y_v"))


def test_the_contract_has_the_values_by_run_where_an_effect_differs(
    fits: tuple[SearchProblem, Estimate, Selection],
) -> None:
    problem, _, found = fits
    row = summary.named_effect(problem, replace(full_model(), candidates=problem.candidates), found, found.effects[0])
    d = case("named")
    written = replace(d, effects=(row, replace(row, by_run={}))).to_dict()["effects"]
    assert written[0]["name"] == "current" and written[0]["by_run"] == row.by_run
    assert "by_run" not in written[1]


@cache
def elsewhere() -> GriddedTrials:
    """Trials that took no part, each in a current of its own."""
    return grid_trials(in_currents(50, OTHERS, ELSEWHERE), full_model().ship.inputs, 3.0, H)


@pytest.fixture(scope="module")
def held(fits: tuple[SearchProblem, Estimate, Selection]) -> tuple[GriddedTrials, HeldOut]:
    problem, null, found = fits
    data = elsewhere()
    result = compared(problem.steps, data, null, found.final)
    assert result is not None
    return data, result


def test_later_windows_lie_in_the_second_halves_alone() -> None:
    steps, data = full_steps(H), elsewhere()
    theta, half = steps.ship.values, half_times(data)
    np.testing.assert_allclose(half, 0.5 * data.steps * H, atol=H)
    _, run = errors(steps, data, theta, WINDOW, second_half=True)
    expected = [int((0.5 * s * H - WINDOW) // STRIDE) + 1 for s in data.steps]
    assert [int((run == r).sum()) for r in range(3)] == expected == [2, 3, 3]
    first = data.t < half
    y = np.where(first[..., None], data.y + 0.3, data.y)
    for length in (WINDOW, 0.0):
        before, _ = errors(steps, data, theta, length, second_half=True)
        np.testing.assert_array_equal(errors(steps, replace(data, y=y), theta, length, second_half=True)[0], before)
        assert np.abs(errors(steps, replace(data, y=y), theta, length)[0].sum() / before.sum()) > 2
    assert len(errors(steps, data, theta, 0.0, second_half=True)[0]) == 3


def test_windows_of_one_run_have_one_middle() -> None:
    data = three_windows()
    t = data.t + np.array([0.0, 40.0, 0.0])
    half = half_times(replace(data, t=t))
    assert half[0] == half[1] == pytest.approx(0.5 * t[data.steps[1], 1]) and half[2] == pytest.approx(20.0, abs=H)


def test_other_runs_own_values_come_from_their_first_halves(fits: tuple[SearchProblem, Estimate, Selection]) -> None:
    problem, _, found = fits
    steps, data = problem.steps, elsewhere()
    theirs = with_values_by_run(steps, data, found.final).theta
    columns = [Column(f"current.{k}", r) for r in range(3) for k in "xy"]
    np.testing.assert_allclose(get_values(steps.ship, data, theirs, columns), np.ravel(ELSEWHERE), atol=0.012)
    y = np.where((data.t >= half_times(data))[..., None], data.y + 0.3, data.y)
    again = with_values_by_run(steps, replace(data, y=y), found.final).theta
    np.testing.assert_allclose(again, theirs, rtol=1e-6, atol=1e-9)
    rest = [i for i, s in enumerate(steps.ship.symbols) if s not in ("current.x", "current.y")]
    np.testing.assert_allclose(theirs[rest], np.repeat(found.final.theta[rest, :1], 3, axis=1), rtol=1e-12)


def test_a_fit_by_run_closes_the_gap_of_other_runs(held: tuple[GriddedTrials, HeldOut]) -> None:
    data, h = held
    assert h.windows == 8 and list(h.by_run) == list(data.trials)
    assert h.reduction > 0.3 and h.interval_90[0] > 0 and h.mse_after < h.mse_before
    assert h.likelihood_gain is not None and h.likelihood_gain > 20
    assert all(after < before for before, after in h.by_run.values())
    assert h.horizons["whole run"][1] < h.horizons["whole run"][0]


def test_the_mean_of_the_runs_alone_would_not_close_it(
    fits: tuple[SearchProblem, Estimate, Selection], held: tuple[GriddedTrials, HeldOut]
) -> None:
    problem, _, found = fits
    data, h = held
    mean = mean_over_windows(found.final.theta)
    errors_of, _ = errors(problem.steps, data, mean, WINDOW, second_half=True)
    assert errors_of.mean() > 1.5 * h.mse_after


def alike(found: Estimate, candidate: Candidate, value: float) -> Estimate:
    """A fit by run with one value in all of its runs."""
    zero = np.zeros(len(candidate.columns))
    free = Priors(candidate.columns, zero, zero + 1.0, zero - np.inf, zero + np.inf)
    return replace(found, free=free, p=zero + value)


def test_runs_that_are_all_alike_leave_nothing_to_find_and_equal_models_close_nothing(
    fits: tuple[SearchProblem, Estimate, Selection], held: tuple[GriddedTrials, HeldOut]
) -> None:
    problem, null, _ = fits
    data, h = held
    same = alike(null, find(problem.candidates, "current", by_run=True), 0.0)
    np.testing.assert_allclose(
        with_values_by_run(problem.steps, data, same).theta, np.repeat(null.theta[:, None], 3, axis=1), atol=1e-6
    )
    equal = compared(problem.steps, data, null, same)
    assert equal is not None and equal.reduction == pytest.approx(0.0, abs=1e-5)
    assert equal.interval_90 == pytest.approx((0.0, 0.0), abs=1e-5)
    assert (equal.windows, equal.mse_before) == (h.windows, h.mse_before)
    assert equal.likelihood_gain == pytest.approx(0.0, abs=1e-2)


def test_either_side_of_a_comparison_may_have_values_by_run(
    fits: tuple[SearchProblem, Estimate, Selection], held: tuple[GriddedTrials, HeldOut]
) -> None:
    """As where a further effect is judged beside a current of each run."""
    problem, null, found = fits
    data, h = held
    both = compared(problem.steps, data, found.final, found.final)
    assert both is not None and both.mse_before == pytest.approx(h.mse_after) and both.reduction == 0.0
    back = compared(problem.steps, data, found.final, null)
    assert back is not None and back.mse_before == pytest.approx(h.mse_after) and back.reduction < 0


def test_effects_of_the_surroundings_differ_by_run_from_three_runs_on() -> None:
    trials = short_trials()
    few, enough = (prepare(FEW, trials[:count], step=H).problem for count in (2, 3))
    assert not any(c.by_run for c in few.candidates)
    more = set(enough.candidates) - set(few.candidates)
    assert {c.effect for c in more} == set(LOCAL) and all(c.by_run for c in more)
    tow = find(enough.candidates, "tow", by_run=True)
    assert tow.columns == tuple((f"tow.{k}", r) for r in range(3) for k in ("X", "Y", "N"))


@pytest.mark.slow
def test_the_whole_diagnosis_names_the_current_once_with_its_value_in_each_run() -> None:
    trials, tests = in_currents(10, RUNS, TRUTH), in_currents(50, OTHERS, ELSEWHERE)
    d = diagnose(FEW, trials, tests, options=DiagnosisOptions(step=H, learn=False))
    content = json.loads(json.dumps(d.to_dict()))
    assert content["verdict"] == "named" and [e["name"] for e in content["effects"]] == ["current"]
    for pair, values in zip(TRUTH, content["effects"][0]["by_run"].values(), strict=True):
        assert (values["x"], values["y"]) == pytest.approx(pair, abs=0.01)
    assert list(content["effects"][0]["by_run"]) == [t.name for t in trials]
    names = [c["name"] for c in content["candidates"]]
    assert names[0] == "current" and len(names) == len(set(names)) and not any("by run" in n for n in names)
    assert "current" in d.sentence and d.next_test
    assert content["held_out"]["reduction"] > 0.3 and set(d.ship.effects) == {"current"}

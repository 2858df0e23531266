"""Score tests of all effects, which are refitted, which come first, when the selection ends, and what is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

import diagnosis.hypotheses.forward_selection as hypotheses
import diagnosis.hypotheses.score_test as module
from diagnosis import summary
from diagnosis.estimation.candidates import Candidate, Column, ship_with_all_effects
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
    Search,
    Selection,
    refit_task,
    search,
    select_effects,
)
from diagnosis.hypotheses.next_test import next_test
from diagnosis.hypotheses.refit import SearchProblem, refit
from diagnosis.hypotheses.score_test import EXCITED, ScoreTest, Slopes, score_tests, slopes
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.summary import estimated, fitted_ship, parameters_of
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import (
    ASTERN,
    FEW,
    RUNS,
    SHIP,
    candidate,
    full_model,
    problem_of,
    pushed_problem,
    pushed_trials,
    quiet,
)
from tests.support.disturbed_trials import drawn_ship
from tests.support.quick import first_quick


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


GOES_ON = [
    ([[2.2], [2.1], [1.9]], 2),
    ([[2.2], []], 1),
    ([[]], 0),
    ([[1.9]], 0),
    ([[99.0]] * (MOST + 1), MOST),  # no more are named than can be believed
]
"""Gains of the candidates in each search, in BIC over ODDS, and how many are named."""


@pytest.mark.parametrize(("gains", "count"), GOES_ON)
def test_selection_goes_on_while_the_evidence_is_enough(
    gains: list[list[float]], count: int, searches: list[Search]
) -> None:
    problem, null = pushed_problem(1)
    searches += found_by([[tried(f"e{i}", gain * ODDS) for gain in rows] for i, rows in enumerate(gains)])
    found = select_effects(problem, null)
    assert [c.label for c in found.effects] == [f"e{i}" for i in range(count)]
    assert found.evidence == pytest.approx([0.5 * rows[0] * ODDS for rows in gains[:count]])
    assert len(found.searches) == min(count + 1, MOST) and len(found.fits) == count + 1
    assert (found.final is null is found.null) == (count == 0)
    for fewer in range(count):
        first = found.first(fewer)
        assert len(first.effects) == fewer and first.fits == found.fits[: fewer + 1] and first.final is first.fits[-1]


def test_evidence_is_that_of_the_fit_that_went_on(searches: list[Search], monkeypatch: pytest.MonkeyPatch) -> None:
    """A refit that was cut off gained 10 units of 60; the scores of its candidate disperse by 2."""
    problem, null = pushed_problem(1)
    rough = replace(tried("a", 20.0), fit=replace(a_fit(90.0), converged=False))
    score = replace(row("a", 1e-9), dispersion=2.0)
    searches += [Search((score,), (rough,), a_fit(100.0)), Search((), (), a_fit(40.0))]
    monkeypatch.setattr(hypotheses, "estimate", lambda *args: a_fit(40.0))
    found = select_effects(problem, null)
    assert found.evidence == pytest.approx([10.0 + 50.0 / 2]) and found.final.nll == 40.0
    assert found.searches[0].best is rough  # its rivals were cut off as well


def test_a_refit_that_is_worse_than_none_begins_again_from_coefficients_as_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, null = pushed_problem(1)
    far, begun = Column("Y_v"), []

    def refitted(
        problem: object, before: Estimate, effects: object, start: dict[Column, float], **_: object
    ) -> Estimate:
        begun.append(start)
        return a_fit(null.nll + (2700.0 if far in start else -500.0))

    monkeypatch.setattr(hypotheses, "followed", lambda *args: {far: -9.0})
    monkeypatch.setattr(hypotheses, "refit", refitted)
    found = refit_task((problem, null, (), row("antenna_offset", 1e-120), 1))
    assert [far in start for start in begun] == [True, False] and found.gain == pytest.approx(500.0)


def test_a_size_that_cannot_be_is_not_selected(searches: list[Search]) -> None:
    problem, null = pushed_problem(1)
    searches += found_by([[replace(tried("a", 99.0), is_possible=False)]])
    assert select_effects(problem, null).effects == ()


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


SEEDS = 8
STRONG = {
    "current": {"x": 0.03, "y": -0.02},
    "rudder_offset": {"delta": 0.1},
    "wind_force": {"X": 1.6, "Y": 1.6, "N": 1.6},
    "antenna_offset": {"x": 0.3, "y": -0.2},
    "heading_bias": {"psi": -0.03},
    "control_delay": {"tau": 0.8},
    "propeller_side_force": {"factor": 3.0},
}


def candidates_and_covariance(count: int = 6, seed: int = 0) -> tuple[list[Candidate], np.ndarray]:
    """Candidates of one to three parameters, the last two one-sided, and a covariance of all their slopes."""
    degrees = [1, 2, 3] + [1] * (count - 3)
    candidates, total = [], sum(degrees)
    for i, d in enumerate(degrees):
        zero, one = np.zeros(d), np.ones(d)
        lower = zero if i >= count - 2 else -5 * one
        columns = tuple(Column(f"e{i}.{j}") for j in range(d))
        candidates.append(Candidate(f"e{i}", "", columns, zero, one, lower, 5 * one))
    A = np.random.default_rng(seed).standard_normal((total, total))
    return candidates, A @ A.T + 0.5 * np.eye(total)


def slopes_of(candidates: list[Candidate], S: np.ndarray, g: np.ndarray) -> Slopes:
    return Slopes(tuple(x for c in candidates for x in c.columns), g, S, 2.0 * np.diag(S))


def rows_of(problem: SearchProblem, null: Estimate) -> dict[str, ScoreTest]:
    """All rows by name, the most telling first."""
    candidates = problem.candidates
    return {
        row.candidate.label: row
        for row in score_tests(slopes(problem.steps, problem.data, null, candidates), candidates)
    }


@pytest.mark.slow
def test_p_values_of_slopes_drawn_from_their_law_are_uniform() -> None:
    """That of the largest of all, and that of each by itself (a one-sided one is 1 every other time)."""
    candidates, S = candidates_and_covariance()
    rng, draws = np.random.default_rng(1), 100
    root = np.linalg.cholesky(S)
    least, single = [], []
    for k in range(draws):
        rows = score_tests(slopes_of(candidates, S, root @ rng.standard_normal(len(S))), candidates, seed=k)
        assert [r.p_single for r in rows] == sorted(r.p_single for r in rows)
        assert all(r.p_single <= r.p_value for r in rows)
        least.append(rows[0].p_value)
        single.append({r.candidate: r.p_single for r in rows})
    assert kstest(least, "uniform").pvalue > 1e-3
    for c in candidates:
        p = np.array([row[c] for row in single])
        one_sided = c.lower[0] == 0
        if one_sided:
            assert 0.4 < (p == 1.0).mean() < 0.6
        assert kstest(2 * p[p < 1] if one_sided else p, "uniform").pvalue > 1e-3, c.label


def test_the_first_order_estimate_is_the_solution_of_the_slopes() -> None:
    candidates, S = candidates_and_covariance()
    phi = np.linspace(0.5, 2.0, len(S))
    block = np.zeros_like(S)
    at = 0
    for c in candidates:
        s = slice(at, at + len(c.symbols))
        block[s, s], at = S[s, s], s.stop
    rows = {r.candidate: r for r in score_tests(slopes_of(candidates, block, block @ phi), candidates)}
    np.testing.assert_allclose(np.concatenate([rows[c].phi for c in candidates]), phi, rtol=1e-8)
    for c in candidates:
        assert rows[c].degrees == len(c.columns) and rows[c].absorbed == pytest.approx(0.5)
    errors = np.concatenate([rows[c].errors for c in candidates])
    np.testing.assert_allclose(errors, np.sqrt(np.diag(np.linalg.inv(block))), rtol=1e-8)


def test_an_effect_that_can_only_be_positive_is_not_seen_in_a_negative_slope() -> None:
    candidates, S = candidates_and_covariance()
    rows = {r.candidate.label: r for r in score_tests(slopes_of(candidates, S, -8.0 * np.sqrt(np.diag(S))), candidates)}
    assert next(iter(rows.values())).p_value < 1e-10  # beyond the draws by Bonferroni
    for name in ("e4", "e5"):
        assert (rows[name].T, rows[name].p_single, rows[name].p_value) == (0.0, 1.0, 1.0) and rows[name].phi[0] == 0
    assert rows["e0"].p_single < 1e-10 and rows["e0"].phi[0] < 0


def test_what_moves_nothing_is_not_excited_and_what_is_imitated_entirely_is_absorbed() -> None:
    candidates, S = candidates_and_covariance()
    own = 2.0 * np.diag(S)
    quiet, hidden = 0, 6  # e0 and e3
    own[quiet] = 0.1 * EXCITED
    S[quiet], S[:, quiet] = 0.0, 0.0
    S[hidden], S[:, hidden] = 0.0, 0.0
    columns = tuple(x for c in candidates for x in c.columns)
    rows = {r.candidate.label: r for r in score_tests(Slopes(columns, 3.0 * np.sqrt(np.diag(S)), S, own), candidates)}
    assert not rows["e0"].excited and rows["e0"].absorbed == 0.0
    assert rows["e3"].excited and rows["e3"].absorbed == 1.0
    assert rows["e0"].p_value == rows["e3"].p_value == 1.0
    assert rows["e1"].excited and rows["e1"].p_single < 0.1


@pytest.mark.slow
def test_slopes_by_chance_have_the_spread_that_is_stated_and_no_trend_and_show_no_effect() -> None:
    """Of ships drawn from the prior, pushed by random forces, without any effect."""
    found, least = list[Slopes](), list[float]()
    for seed in range(SEEDS):
        p, null = problem_of(pushed_trials(seed, ship=drawn_ship(FEW, seed)), 1.0)
        found.append(slopes(p.steps, p.data, null, p.candidates))
        least.append(min(row.p_value for row in score_tests(found[-1], p.candidates)))
    g, S = np.array([s.g for s in found]), np.array([np.diag(s.S) for s in found])
    assert 0.85 < np.sqrt((g**2 / S).mean()) < 1.15
    pooled = dict(zip(found[0].columns, g.sum(axis=0) / np.sqrt(S.sum(axis=0)), strict=True))
    assert {s: round(v, 1) for s, v in pooled.items() if abs(v) > 3.5} == {}  # 31 parameters
    assert min(least) > 1e-3 and 0.1 < np.median(least) < 0.9


@pytest.mark.parametrize("name", first_quick(STRONG))
def test_a_strong_effect_has_the_highest_score_and_about_its_size(name: str) -> None:
    truth = STRONG[name]
    text = f"{name}:" + ",".join(f"{k}={v}" for k, v in truth.items())
    runs = ASTERN if name == "propeller_side_force" else RUNS
    p, null = pushed_problem(1, text, runs=runs)
    rows = rows_of(p, null)
    assert next(iter(rows)) == name and rows[name].excited
    assert rows[name].p_single <= rows[name].p_value < 1e-6
    c = candidate(name)
    wanted = (np.array([truth[s.split(".")[1]] for s in c.symbols]) - c.neutral) / c.typical
    share = rows[name].phi / wanted
    assert (share > 0.6).all() and (share < 1.6).all(), share
    assert all(0.0 <= r.absorbed <= 1.0 for r in rows.values())


def test_slopes_are_the_same_a_little_beside_the_best_coefficients() -> None:
    """What the coefficients could still explain is taken off."""
    p, null = pushed_problem(1, f"current:x={STRONG['current']['x']}")
    moved = null.p + np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0]) * np.sqrt(np.diag(null.covariance))
    theta = null.theta.copy()
    theta[[p.steps.ship.symbols.index(s) for s in null.free.symbols]] = null.free.mean + null.free.std * moved
    a, b = (slopes(p.steps, p.data, f, p.candidates) for f in (null, replace(null, p=moved, theta=theta)))
    np.testing.assert_allclose(b.g / np.sqrt(a.own), a.g / np.sqrt(a.own), atol=0.35)
    assert np.abs(a.g / np.sqrt(a.own)).max() > 5


def test_effects_that_nothing_is_known_of_are_left_out_with_a_reason() -> None:
    trials = pushed_trials(1, runs=RUNS[:1])
    assert (
        set(ship_with_all_effects(SHIP, trials).left_out) == {"bank"}
        and "site.toml" in ship_with_all_effects(SHIP, trials).left_out["bank"]
    )
    calm = [replace(t, columns={k: v for k, v in t.columns.items() if not k.startswith("wind")}) for t in trials]
    without = ship_with_all_effects(SHIP, calm)
    assert set(without.left_out) == {"bank", "wind_force", "wind_sensor_bias"}
    assert not set(without.left_out) & {c.effect for c in without.candidates}
    known = ship_with_all_effects(SHIP, trials, {"bank": {"distance": 4.0, "bearing": 1.0}})
    assert not known.left_out and {c.effect for c in known.candidates} == set(EFFECTS)
    values = known.ship.parameters_of("bank")
    assert (values.distance, values.bearing) == (4.0, 1.0)
    # a parameter that is held is no column, and an effect that the ship has already is no candidate
    assert candidate("bank").symbols == ("bank.suction", "bank.moment")
    with_current = ship_with_all_effects(SHIP.with_effect("current", {"x": 0.01}))
    assert "current" not in {c.effect for c in with_current.candidates}


def test_a_candidate_whose_response_explodes_is_not_tested_and_the_others_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """At a long step the memory of a candidate may be unstable along a trial."""
    problem, null = pushed_problem(1, runs=(("zigzag:20/20", 60.0),), h=1.0)
    both = [candidate("current"), candidate("rudder_lag")]
    alone = {r.candidate: r for r in score_tests(slopes(problem.steps, problem.data, null, both[1:]), both[1:])}
    whole = module.linearise_and_filter

    def explodes(*given: Any, **more: Any) -> Any:
        found = whole(*given, **more)
        first = len(null.free.symbols)
        found.white[..., first : first + 2] = np.nan  # both parameters of the current
        return found

    monkeypatch.setattr(module, "linearise_and_filter", explodes)
    rows = {r.candidate: r for r in score_tests(slopes(problem.steps, problem.data, null, both), both)}
    assert not rows[both[0]].excited and pytest.approx(alone[both[1]].T) == rows[both[1]].T


FORMS = {
    "heading_bias alone": {"alone": 0.05},
    "antenna_offset alone": {"alone_x": 0.4, "alone_y": -0.3},
    "gnss_delay alone": {"alone": 1.0},
    "gnss_delay finished": {"finished": 1.2},
}


def candidate_of(form: str) -> Candidate:
    """The candidate of a label."""
    return next(c for c in full_model().candidates if c.label == form)


def spec(form: str) -> str:
    return f"{candidate_of(form).effect}:" + ",".join(f"{k}={v}" for k, v in FORMS[form].items())


@cache
def searched(form: str) -> tuple[SearchProblem, Selection]:
    """Trials with a fault of this form as a problem, and what is found."""
    problem, null = pushed_problem(4, spec(form))
    return problem, select_effects(problem, null)


@pytest.mark.slow
@pytest.mark.parametrize("form", first_quick(FORMS))
def test_it_is_named_with_its_own_parameters(form: str) -> None:
    (problem, found), c = searched(form), candidate_of(form)
    assert found.effects == (c,)
    row = summary.named_effect(full_model(), found, c)
    assert row.name == c.effect and set(row.parameters) == set(FORMS[form])
    for k, size in FORMS[form].items():
        got = row.parameters[k]
        assert abs(got.value - size) < 3.5 * got.std + 0.06 * abs(size)
    assert unnamed_forms(problem.steps, problem.data, found.final).mixture < 3.0
    after = summary.fitted_ship(problem.steps.ship, full_model(), found.final, found.effects)
    assert after.coefficients[f"{c.effect}.{next(iter(FORMS[form]))}"].value != 0.0


@pytest.mark.slow
def test_the_ranking_has_each_effect_once() -> None:
    ranked = summary.ranking(full_model(), searched("heading_bias alone")[1].searches[0])
    assert set(ranked[0].visible_from) == {"psi", "alone"} and ranked[0].visible_from["alone"] < 0.05
    rows = [row.name for row in ranked]
    assert len(rows) == len(set(rows)) and rows[0] == "heading_bias"
    assert set(rows) == {c.effect for c in full_model().candidates}


@pytest.mark.slow
def test_what_to_test_next_is_asked_of_the_form_and_told_of_the_effect() -> None:
    problem, found = searched("heading_bias alone")
    form = found.effects[0]
    ship = summary.fitted_ship(FEW, full_model(), found.final, found.effects)
    words = next_test(problem, summary.fit_with(found, form), [form], ship)
    assert "heading_bias" in words
    percent = float(words.split("measure it to ")[1].split(" %")[0])
    assert 0 < percent < 5  # 0.05 rad of a compass that is good to 0.0015


@pytest.mark.slow
@pytest.mark.parametrize("truth", first_quick(["rudder_lag:T=0.4", "control_delay:tau=0.4"]))
def test_what_looks_alike_is_in_one_class(truth: str) -> None:
    """A rudder behind its record and a delay of both actuators, here hardly to be told apart."""
    problem, null = pushed_problem(2, truth, runs=(("zigzag:20/20", 60.0), ("turning:-20", 60.0)))
    s = select_effects(problem, null).searches[0]
    assert s.best and s.best.evidence > ODDS
    assert {"rudder_lag", "control_delay"} <= {c.label for c in s.indistinguishable}
    assert s.indistinguishable[0] == s.refitted[0].candidate and candidate("current") not in s.indistinguishable


@pytest.mark.slow
def test_the_uncertainty_of_a_formula_is_in_the_standard_errors_of_its_sizes() -> None:
    problem, null = pushed_problem(1, "wave_drift:x=0.45,y=-0.35")
    drift, offset = candidate("wave_drift"), candidate("rudder_offset")
    assert EFFECTS["wave_drift"].form_error > 0 and EFFECTS["rudder_offset"].form_error == 0
    effects = [drift, offset]
    start = {c: v for e in effects for c, v in zip(e.columns, e.neutral, strict=True)}
    fit = refit(problem, null, effects, start)
    sizes = parameters_of(full_model(), fit, drift)
    for symbol in ("x", "y"):
        by_trials = estimated(fit, f"wave_drift.{symbol}")
        assert sizes[symbol].value == by_trials.value
        form = EFFECTS["wave_drift"].form_error * abs(by_trials.value)
        assert sizes[symbol].std == pytest.approx(np.hypot(by_trials.std, form))
        ship = fitted_ship(SHIP, full_model(), fit, effects)
        assert ship.coefficients[f"wave_drift.{symbol}"].std == sizes[symbol].std
    assert parameters_of(full_model(), fit, offset)["delta"].std == estimated(fit, "rudder_offset.delta").std
    lag = candidate("rudder_lag")
    late = refit(problem, null, [lag], {lag.columns[0]: 0.2})
    (sure,), (doubtful,) = (parameters_of(full_model(), late, lag, error).values() for error in (0.0, 0.3))
    assert doubtful.std == pytest.approx(np.hypot(sure.std, 0.3))
    assert parameters_of(full_model(), fit, drift, 0.3) == sizes

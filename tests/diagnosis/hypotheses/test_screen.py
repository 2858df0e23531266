"""Score tests of all effects at once: calibrated under chance, and first to point at what is really there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

import diagnosis.hypotheses.score_test as module
from diagnosis.estimation.candidates import Candidate, Column, ship_with_all_effects
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.score_test import EXCITED, ScoreTest, Slopes, score_tests, slopes
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import ASTERN, FEW, RUNS, SHIP, candidate, problem_of, pushed_problem, pushed_trials
from tests.support.disturbed_trials import drawn_ship
from tests.support.quick import first_quick

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


def made_up(count: int = 6, seed: int = 0) -> tuple[list[Candidate], np.ndarray]:
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
    candidates, S = made_up()
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
    candidates, S = made_up()
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
    candidates, S = made_up()
    rows = {r.candidate.label: r for r in score_tests(slopes_of(candidates, S, -8.0 * np.sqrt(np.diag(S))), candidates)}
    assert next(iter(rows.values())).p_value < 1e-10  # beyond the draws by Bonferroni
    for name in ("e4", "e5"):
        assert (rows[name].T, rows[name].p_single, rows[name].p_value) == (0.0, 1.0, 1.0) and rows[name].phi[0] == 0
    assert rows["e0"].p_single < 1e-10 and rows["e0"].phi[0] < 0


def test_what_moves_nothing_is_not_excited_and_what_is_imitated_entirely_is_absorbed() -> None:
    candidates, S = made_up()
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


@pytest.fixture(scope="module")
def by_chance() -> list[tuple[Slopes, list[ScoreTest]]]:
    """Ships drawn from the prior, pushed by random forces, without any effect."""
    found = []
    for seed in range(SEEDS):
        p, null = problem_of(pushed_trials(seed, ship=drawn_ship(FEW, seed)), 1.0)
        s = slopes(p.steps, p.data, null, p.candidates)
        found.append((s, score_tests(s, p.candidates)))
    return found


@pytest.mark.slow
def test_slopes_have_the_spread_that_is_stated_and_no_trend(by_chance: list[tuple[Slopes, list[ScoreTest]]]) -> None:
    g, S = (np.array(a) for a in ([s.g for s, _ in by_chance], [np.diag(s.S) for s, _ in by_chance]))
    z = g / np.sqrt(S)
    assert 0.85 < np.sqrt((z**2).mean()) < 1.15
    pooled = dict(zip(by_chance[0][0].columns, g.sum(axis=0) / np.sqrt(S.sum(axis=0)), strict=True))
    assert {s: round(v, 1) for s, v in pooled.items() if abs(v) > 3.5} == {}  # 31 parameters


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

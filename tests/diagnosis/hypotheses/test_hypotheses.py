"""Naming effects: a strong one and only it, and no name for what the library lacks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from diagnosis.hypotheses.forward_selection import ODDS, Selection, select_effects
from diagnosis.hypotheses.unnamed import SIZES, log_bayes, unnamed_forms
from diagnosis.judgement.verdict import verdict_of
from tests.support.diagnosis_cases import candidate, problem_of, pushed_problem, pushed_trials
from tests.support.quick import first_quick

NAMES = {"current": {"x": 0.03, "y": -0.02}, "antenna_offset": {"x": 0.3, "y": -0.2}, "heading_bias": {"psi": -0.03}}


def text_of(name: str, values: dict[str, float]) -> str:
    return f"{name}:" + ",".join(f"{k}={v}" for k, v in values.items())


def assert_sizes(found: Selection, name: str, values: dict[str, float]) -> None:
    """Within four standard errors, and no error larger than the value."""
    for k, v in values.items():
        std = found.final.std(f"{name}.{k}")
        assert abs(found.final.value(f"{name}.{k}") - v) < 4 * std < 4 * abs(v), (name, k)


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(NAMES))
def test_a_strong_effect_is_named_and_only_it(name: str) -> None:
    problem, null = pushed_problem(1, text_of(name, NAMES[name]))
    found = select_effects(problem, null)
    assert found.effects == (candidate(name),) == found.searches[0].indistinguishable
    assert_sizes(found, name, NAMES[name])
    assert found.final.nll < found.null.nll - 20
    left = unnamed_forms(problem.steps, problem.data, found.final)
    assert verdict_of(found.evidence, [99.0, left.evidence].__getitem__) == ("named", 1, False)


@pytest.mark.slow
def test_two_effects_are_both_named() -> None:
    truth = {"current": {"x": 0.03, "y": -0.02}, "rudder_offset": {"delta": 0.1}}
    problem, null = pushed_problem(2, *(text_of(*e) for e in truth.items()))
    found = select_effects(problem, null)
    assert {c.label for c in found.effects} == set(truth)
    assert found.effects[0] == found.searches[0].refitted[0].candidate
    for name, values in truth.items():
        assert_sizes(found, name, values)
    assert len(found.searches) == 3  # the last one finds nothing more
    none, one, both = found.fits
    assert (none, both) == (found.null, found.final) and none.nll > one.nll > both.nll + 9
    assert {c.symbol for c in one.free.columns if "." in c.symbol} == set(found.effects[0].symbols)


@pytest.mark.slow
@pytest.mark.parametrize("truth", first_quick(["rudder_lag:T=0.4", "control_delay:tau=0.4"]))
def test_what_looks_alike_is_in_one_class(truth: str) -> None:
    """A rudder behind its record and a delay of both actuators, here hardly to be told apart."""
    problem, null = pushed_problem(2, truth, runs=(("zigzag:20/20", 60.0), ("turning:-20", 60.0)))
    s = select_effects(problem, null).searches[0]
    assert (
        s.best and s.best.evidence > ODDS and {"rudder_lag", "control_delay"} <= {c.label for c in s.indistinguishable}
    )
    assert s.indistinguishable[0] == s.refitted[0].candidate and candidate("current") not in s.indistinguishable


def covariance(count: int, seed: int = 0) -> np.ndarray:
    A = np.random.default_rng(seed).standard_normal((count, count))
    return 20.0 * (A @ A.T + 0.3 * np.eye(count))


def test_log_bayes_is_the_ratio_of_the_marginal_likelihoods() -> None:
    """Slopes g = S b + chance of covariance S, with b of covariance a^2 or none."""
    S = covariance(4)
    g = np.random.default_rng(1).standard_normal(4) @ np.linalg.cholesky(S).T + S @ np.array([0.3, 0.0, -0.2, 0.1])
    some = np.array([True, False, True, True])
    g3, S3 = g[some], S[np.ix_(some, some)]
    likely = [multivariate_normal(np.zeros(3), S3 + a**2 * S3 @ S3).pdf(g3) for a in SIZES]
    expected = np.log(np.mean(likely)) - multivariate_normal(np.zeros(3), S3).logpdf(g3)
    assert log_bayes(g, S, some) == pytest.approx(expected, rel=1e-9)


def test_log_bayes_speaks_against_more_columns_under_chance_and_for_them_where_something_is() -> None:
    S, every = covariance(8), np.ones(8, dtype=bool)
    root, rng = np.linalg.cholesky(S), np.random.default_rng(2)
    by_chance = np.array([log_bayes(root @ rng.standard_normal(8), S, every) for _ in range(500)])
    assert by_chance.mean() < 0 and np.median(by_chance) < 0
    assert (by_chance > ODDS).mean() < np.exp(-ODDS)  # never wrong more often than the odds say
    there = np.array([log_bayes(S @ np.full(8, 0.8) + root @ rng.standard_normal(8), S, every) for _ in range(50)])
    assert there.min() > 10
    assert log_bayes(np.zeros(8), S, every) < 0
    assert log_bayes(np.zeros(8), np.zeros((8, 8)), every) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("column", "by"), [("r", 0.002), ("v", 0.015)])
def test_a_fault_of_a_sensor_without_a_name_is_unknown_or_leaves_a_remainder(column: str, by: float) -> None:
    """A constant error of turn rate or sway velocity is no effect of the library."""
    trials = [t.with_columns(**{column: t[column] + by}) for t in pushed_trials(2)]
    problem, null = problem_of(trials)
    before = unnamed_forms(problem.steps, problem.data, null)
    assert before.mixture > 20 and max(before.by_kind, key=lambda k: before.by_kind[k]) == f"sensor of {column}"
    found = select_effects(problem, null)
    left = [unnamed_forms(problem.steps, problem.data, fit).evidence for fit in found.fits]
    verdict, _, is_left = verdict_of(found.evidence, left.__getitem__, [c.measures for c in found.effects])
    assert verdict == "unknown" or is_left

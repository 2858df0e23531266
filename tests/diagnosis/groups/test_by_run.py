"""Tests of parameters for different values in groups of runs: law by chance, sizes, scatter, what is imitated."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from diagnosis.estimation.candidates import Candidate, Column, find
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.groups.between import RunSlopes, imitated, own_values, run_slopes, with_scatter
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.score_test import slopes
from fitting.uncertainty.group_test import LEAST, GroupTest, group_test, holm
from tests.support.diagnosis_cases import FREE, SHIP, pushed_problem

GROUP = np.array([0, 0, 0, 0, 1, 1, 1, 1])


def test_of_values(values: np.ndarray, std: float | np.ndarray, group: np.ndarray = GROUP) -> GroupTest:
    """The test of values by run (n,) with known standard errors."""
    precision = np.broadcast_to(1.0 / np.square(std), values.shape)
    found = group_test(values * precision, np.diag(precision), group, 1)
    assert found is not None
    return found


test_of_values.__test__ = False  # type: ignore[attr-defined]


def test_of_values_known_by_run_the_statistic_is_that_of_the_means() -> None:
    values = np.array([0.0, 0.1, 0.2, 0.1, 2.0, 2.1, 2.2, 2.1])
    found = test_of_values(values, 0.5)
    assert found.scatter == pytest.approx([LEAST], abs=0.15)
    variance = (0.5**2 + found.scatter[0] ** 2) / 4
    np.testing.assert_allclose(found.values, [0.1, 2.1], atol=1e-3)
    np.testing.assert_allclose(np.diag(found.covariance), variance, rtol=1e-3)
    assert found.degrees == 1 and found.statistic == pytest.approx(4.0 / (2 * variance), rel=1e-3)
    assert found.log_bayes > 3 and found.p_single == pytest.approx(float(chi2.sf(found.statistic, 1)), rel=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("scatter", [0.0, 3.0])
def test_chance_differences_are_as_rare_as_said_whatever_runs_scatter(scatter: float) -> None:
    rng = np.random.default_rng(5)
    p = []
    for _ in range(200):
        std = rng.uniform(0.2, 0.6, 8)
        p.append(test_of_values(scatter * rng.standard_normal(8) + std * rng.standard_normal(8), std).p_single)
    assert np.mean(np.array(p) < 0.05) < 0.09 and np.mean(np.array(p) < 0.005) < 0.02
    assert np.median(p) == pytest.approx(0.5, abs=0.15)


def test_a_difference_that_runs_of_a_group_show_too_is_none() -> None:
    apart = np.array([-2.0, 2.0, -2.0, 2.0, -1.0, 3.0, -1.0, 3.0])
    together = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    assert test_of_values(apart, 0.1).p_single > 0.3 and test_of_values(together, 0.1).p_single < 1e-4
    # one run in each group tells nothing of their scatter
    found = test_of_values(np.array([0.0, 1.0]), 0.1, np.array([0, 1]))
    assert found.scatter[0] > 0.5 and found.p_single > 0.3


def test_holm_raises_each_by_the_number_left_and_keeps_the_order() -> None:
    np.testing.assert_allclose(holm([0.04, 0.001, 0.5, 0.02]), [0.08, 0.004, 0.5, 0.06])
    np.testing.assert_allclose(holm([0.5, 0.6]), [1.0, 1.0])


@cache
def case() -> tuple[SearchProblem, Estimate]:
    """Three runs."""
    return pushed_problem(31, "fouling:share=0.2", h=1.0)


def coefficient(symbol: str) -> Candidate:
    """A coefficient of the ship as a candidate."""
    c = SHIP.coefficients[symbol]
    sizes = (np.array([x]) for x in (c.value, 0.1 * abs(c.value), c.lower, c.upper))
    return Candidate(symbol, "", (Column(symbol),), *sizes)


def by_run(candidates: list[Candidate]) -> RunSlopes:
    problem, null = case()
    return run_slopes(problem.steps, problem.data, problem.data.run, null, candidates)


def test_the_runs_add_up_to_the_score_test_of_all() -> None:
    problem, null = case()
    chosen = [find(problem.candidates, "fouling"), find(problem.candidates, "current")]
    every, each = slopes(problem.steps, problem.data, null, chosen), by_run(chosen)
    at = [each.columns.index(x) for x in every.columns]
    P = len(FREE)
    G, g = each.G.sum(axis=0), each.g.sum(axis=0) + each.pull
    np.testing.assert_allclose(np.diag(G)[at], every.own, rtol=1e-9)
    project = np.linalg.solve(G[:P, :P] + np.diag(each.precision[:P]), G[:P][:, at])
    np.testing.assert_allclose(g[at] - project.T @ g[:P], every.g, rtol=1e-7, atol=1e-7 * np.abs(every.g).max())
    assert each.group.tolist() == [0, 1, 2]


def test_what_scatters_from_run_to_run_takes_its_part_of_the_information() -> None:
    s = by_run([find(case()[0].candidates, "tow")])
    free = with_scatter(s, {Column("tow.X"): 2.0})
    i = s.columns.index(Column("tow.X"))
    np.testing.assert_allclose(free.G[:, i, i], s.G[:, i, i] / (1 + 4.0 * s.G[:, i, i]), rtol=1e-9)
    assert with_scatter(s, {Column("tow.X"): 2.0}, [Column("tow.X")]) is s


def test_resistance_is_imitated_by_its_coefficient_and_not_by_a_sway_force() -> None:
    c = [find(case()[0].candidates, "fouling"), coefficient("X_0F"), coefficient("Y_v")]
    s = by_run(c)
    assert imitated(s, c[0], c[1]) > 0.9 > 0.5 > imitated(s, c[0], c[2])
    reverse = find(case()[0].candidates, "propeller_side_force")
    none = by_run([reverse])
    assert group_test(*own_values(none, none.at(reverse)), none.group, 1) is None  # no run reverses

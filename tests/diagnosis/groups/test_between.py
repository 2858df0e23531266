"""Differences between groups of trials: none, an instrument, surroundings, the ship, and what must not be named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from cases.evidence.kinematics import consistency
from cases.io.campaigns import Groups
from cases.trial import Trial
from diagnosis.estimation.candidates import Candidate, Column, find
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.findings import Between
from diagnosis.groups.between import RunSlopes, compare_groups, imitated, own_values, run_slopes, with_scatter
from diagnosis.groups.over_time import ChangeTest
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.score_test import slopes
from fitting.uncertainty.group_test import LEAST, GroupTest, group_test, holm
from mmg.errors import UserError
from mmg.messages import has_code
from tests.support.diagnosis_cases import FREE, SHIP, problem_of, pushed_problem, pushed_trials

RUNS = (("zigzag:20/20", 80.0), ("random:11", 80.0), ("turning:-20", 80.0))


def trials_of(seed: int, effects: Sequence[str] = (), runs: Sequence[tuple[str, float]] = RUNS) -> list[Trial]:
    """Runs, of which the second half are of another group, in which the effects act."""
    first, second = pushed_trials(seed, [], runs), pushed_trials(seed + 1, effects, runs)
    return [replace(t, name=f"{g} {t.name}") for g, own in (("A", first), ("B", second)) for t in own]


def compared(trials: Sequence[Trial], number: Sequence[int] = (0, 0, 0, 1, 1, 1)) -> Between:
    """What differs between groups A, B, ... of trials."""
    problem, null = problem_of(trials, 1.0)
    names = tuple("ABC"[: max(number) + 1])
    return compare_groups(problem, null, consistency(trials, SHIP), Groups("group", names, tuple(number)), trials)


@cache
def answer(*effects: str) -> Between:
    """The answer where these effects act in the second group."""
    return compared(trials_of(41, effects))


@pytest.mark.longest
@pytest.mark.slow
def test_groups_that_agree_are_not_told_apart() -> None:
    b = answer()
    assert (b.verdict, b.differences, b.remainder, b.warnings) == ("none", (), False, ())
    assert {k: len(v) for k, v in b.groups.items()} == {"A": 3, "B": 3} and "A 0_zigzag" in b.groups["A"][0]
    assert {"current", "fouling", "X_0F", "antenna_offset"} <= {c.name for c in b.candidates}
    assert [c.log_bayes for c in b.candidates] == sorted((c.log_bayes for c in b.candidates), reverse=True)
    assert min(c.p_value for c in b.candidates) > 0.03


@pytest.mark.longest
@pytest.mark.slow
def test_a_turn_rate_that_is_late_in_one_group_is_an_instrument_of_it() -> None:
    b = answer("gyro:T=0.5")
    assert b.verdict == "named" and not b.remainder
    (d,) = b.differences
    assert (d.name, d.nature, d.source, d.group) == ("gyro", "instrument", "kinematics", "B")
    late = d.parameters["T"].groups
    assert late["B"].value == pytest.approx(0.5, abs=0.07) and late["A"].value == pytest.approx(0.0, abs=0.05)
    assert late["B"].difference == pytest.approx(late["B"].value - late["A"].value) == -late["A"].difference
    assert late["B"].difference > 5 * late["B"].difference_std and "gyro in B, T +0." in b.sentence


@pytest.mark.slow
def test_a_current_in_one_group_is_of_its_surroundings() -> None:
    b = answer("current:x=0.05,y=-0.03")
    (d,) = b.differences
    assert (b.verdict, d.name, d.nature, d.source) == ("named", "current", "surroundings", "dynamics")
    for k, truth in (("x", 0.05), ("y", -0.03)):
        x = d.parameters[k].groups["B"]
        assert d.parameters[k].unit == "m/s" and 0 < x.difference_std < 0.02
        assert abs(x.difference - truth) < 3 * x.difference_std < 0.05


@pytest.mark.slow
def test_a_larger_resistance_is_named_by_its_cause_with_the_coefficient_that_says_the_same() -> None:
    b = answer("fouling:share=0.5")
    (d,) = b.differences
    assert (b.verdict, d.name, d.nature) == ("named", "fouling", "ship") and "X_0F" in d.equivalence_class
    assert d.parameters["share"].groups["B"].difference == pytest.approx(0.5, abs=0.2) and d.p_value < 0.01


@pytest.mark.slow
def test_what_differs_where_manoeuvres_differ_too_is_not_named() -> None:
    trials = [
        replace(t, kind="turning" if t.name[0] == "A" else "berthing")
        for t in trials_of(41, ["current:x=0.05,y=-0.03"])
    ]
    b = compared(trials)
    assert b.verdict == "unknown" and b.remainder and b.differences == ()
    (reason,) = b.warnings
    assert has_code(b.warnings, "other_manoeuvres") and all(w in reason for w in ("B", "berthing", "current"))
    assert reason in b.sentence


@pytest.mark.slow
def test_groups_of_one_run_are_warned_of_and_scatter_is_no_difference() -> None:
    trials = trials_of(43, ["current:x=0.02,y=0.0"], RUNS[:1])
    b = compared(trials, (0, 1))
    (warning,) = b.warnings
    assert has_code(b.warnings, "one_run_groups") and "A, B" in warning and b.verdict == "none"


def test_a_group_without_a_usable_piece_is_refused() -> None:
    trials = trials_of(43, [], RUNS[:1])
    short = replace(trials[1], columns={k: v[:60] for k, v in trials[1].columns.items()})
    with pytest.raises(UserError, match="--between group"):
        compared([trials[0], short], (0, 1))


@pytest.mark.slow
def test_a_current_of_its_own_in_each_run_is_no_difference_between_groups() -> None:
    currents = ("x=0.12,y=0.05", "x=-0.1,y=0.1", "x=0.0,y=-0.12", "x=-0.1,y=-0.08", "x=0.13,y=0.0", "x=0.05,y=0.12")
    runs = [RUNS[i % 3] for i in range(6)]
    each = [
        pushed_trials(60 + i, [f"current:{c}"], [run])[0] for i, (run, c) in enumerate(zip(runs, currents, strict=True))
    ]
    b = compared([replace(t, name=f"run {i}") for i, t in enumerate(each)])
    assert b.differences == () and b.verdict in ("none", "unknown")
    assert b.verdict == "none" or has_code(b.warnings, "scattered_surroundings")


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


DAY = np.arange(0.5, 30.0, 0.25)


def noise(rng: np.random.Generator, lasting: float) -> np.ndarray:
    """White noise of size 1, and of size ``lasting`` that lasts for a day."""
    apart = np.abs(DAY[:, None] - DAY[None])
    slow = np.linalg.cholesky(np.exp(-apart) + 1e-9 * np.eye(len(DAY))) @ rng.standard_normal(len(DAY))
    return rng.standard_normal(len(DAY)) + lasting * slow


@pytest.fixture(scope="module")
def test() -> ChangeTest:
    return ChangeTest(DAY, np.ones(len(DAY)), 30.0)


@pytest.mark.parametrize("lasting", [0.0, 1.0])
def test_a_step_is_dated(test: ChangeTest, lasting: float) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        found = test(noise(rng, lasting) + 8.0 * (DAY > 12.4), rng)
        assert found.step and found.p_value < 1e-4
        assert abs(found.begin - 12.4) < 0.5 and found.begin_90[0] <= 12.6 and found.begin_90[1] >= 12.1
        assert abs(found.size - 8.0) < 4 * found.std + 0.5


def test_slow_growth_is_dated(test: ChangeTest) -> None:
    for seed, begin in ((0, 0.0), (1, 8.0), (2, 15.0)):
        rng = np.random.default_rng(seed)
        found = test(noise(rng, 0.5) + 15.0 * np.clip((DAY - begin) / (30 - begin), 0, 1), rng)
        assert not found.step and found.p_value < 1e-4
        assert abs(found.begin - begin) <= 3 and found.begin_90[0] - 1 <= begin <= found.begin_90[1] + 1
        assert found.size == pytest.approx(15.0, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("lasting", [0.0, 1.5])
def test_chances_of_series_without_a_change_are_even(test: ChangeTest, lasting: float) -> None:
    chances = []
    for seed in range(40):
        rng = np.random.default_rng([3, seed])
        chances.append(test(noise(rng, lasting), rng).p_value)
    assert min(chances) > 1e-4
    assert sum(p < 0.1 for p in chances) <= 10  # of 40, where 4 are expected

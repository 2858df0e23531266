"""Differences between groups of trials: none, an instrument, surroundings, the ship, and what must not be named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import pytest

from cases.evidence.kinematics import consistency
from cases.io.campaigns import Groups
from cases.trial import Trial
from diagnosis.findings import Between
from diagnosis.groups.between import compare_groups
from mmg.errors import UserError
from mmg.messages import has_code
from tests.support.diagnosis_cases import SHIP, problem_of, pushed_trials

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

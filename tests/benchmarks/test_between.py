"""Draws of the benchmark of ``--between``: what differs does so in the second group alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.between import EFFECTS, SCENARIOS, SECOND, Scenario, rows, trials_of
from benchmarks.blind.generator.world import WORLDS
from cases.trial import Trial

WORLD = replace(WORLDS["basin"], duration=20.0)


def draw(words: str) -> list[Trial]:
    """The runs of a scenario, short ones."""
    return trials_of(next(s for s in SCENARIOS if s.words == words), 3, WORLD)


def test_either_group_has_all_manoeuvres_and_half_of_the_runs() -> None:
    trials = draw("nothing")
    kinds = [{t.kind for t in trials if t.name[0] == group} for group in "AB"]
    assert kinds[0] == kinds[1] == {"zigzag", "turn", "random", "berthing"}
    assert [t.name[0] == "B" for t in trials] == SECOND.tolist() and SECOND.sum() == 6


@pytest.mark.parametrize("words", ["gain of the gyro +3 %", "turn rate 0.6 s late"])
def test_a_fault_of_the_gyro_changes_the_turn_rate_of_the_second_group_alone(words: str) -> None:
    for t, same in zip(draw(words), draw("nothing"), strict=True):
        for name, values in same.columns.items():
            changed = not np.array_equal(t[name], values)
            assert changed == (name == "r" and t.name[0] == "B"), (t.name, name)


def test_an_effect_acts_in_the_second_group_alone_and_in_all_runs_where_it_is_no_difference() -> None:
    still = trials_of(Scenario("none", "current", "strong", where=lambda rng: np.zeros(len(SECOND))), 3, WORLD)

    def moved(words: str) -> list[bool]:
        return [not np.allclose(t["u"], s["u"], atol=1e-6) for t, s in zip(draw(words), still, strict=True)]

    assert moved("current, strong") == SECOND.tolist()
    assert all(moved("nothing, but a current of its own in each run"))
    assert {s.effect for s in SCENARIOS} - {""} <= set(EFFECTS)


def test_a_name_that_is_not_there_is_counted_as_wrong() -> None:
    def answer(scenario: int, verdict: str, names: list[str], right: bool) -> dict[str, object]:
        return {"scenario": scenario, "verdict": verdict, "names": names, "right": right}

    answers = [answer(0, "none", [], True), answer(0, "named", ["tow"], False), answer(3, "named", ["gyro"], True)]
    late = ["turn rate 0.6 s late", "1", "0", "0", "1", "0"]
    assert rows(answers) == [["nothing", "2", "1", "0", "", "1 (tow)"], late]

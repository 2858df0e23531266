"""Which trials a diagnosis takes: none that tell nothing, none twice, none that are kept for tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.inputs import DiagnosisOptions, diagnosable_trials, diagnosis_store, independent_tests, parted
from diagnosis.prepare import InputReading
from mmg.errors import Missing, TooFewData
from tests.diagnosis.judgement.test_verdict import RUNS
from tests.support.diagnosis_cases import FEW, pushed_trials


def test_trials_that_tell_nothing_are_refused_and_copies_count_once() -> None:
    one, other = pushed_trials(1, runs=RUNS)
    copy = replace(one, name="again")
    kept, (message,) = diagnosable_trials([one, copy, other])
    assert [t.name for t in kept] == [one.name, other.name] and message.code == "copies_left_out"
    still = {name: np.full_like(one[name], one[name][0]) for name in ("n", "delta")}
    with pytest.raises(TooFewData):
        diagnosable_trials([replace(one, columns={**one.columns, **still})])
    with pytest.raises(Missing):
        diagnosable_trials([])


def test_a_test_is_told_from_a_trial_of_its_name() -> None:
    """Copies among the tests share no rows with a trial that is called as one of them."""
    one, other = pushed_trials(1, runs=RUNS)
    trials, tests = [replace(one, name="a")], [replace(other, name=name) for name in ("a", "b")]
    assert independent_tests(trials, tests) == (tests, [])
    kept, (shared, none_left) = independent_tests(trials, [replace(one, name="c", sha256="")])
    assert kept == [] and (shared.code, none_left.code) == ("shared_rows", "no_test_left")


def test_trials_that_trials_toml_keeps_for_tests_take_no_part(tmp_path: Path) -> None:
    first, second = pushed_trials(1, runs=RUNS)
    kept, tests, (message,) = parted([replace(first, role="train"), replace(second, role="validate")], [first])
    assert [t.name for t in kept] == [first.name] and [t.name for t in tests] == [first.name, second.name]
    assert message.code == "role_held_out" and second.name in message
    with pytest.raises(Missing):
        parted([replace(first, role="test")], [second])
    roles = [first, replace(second, role="test")]
    assert list(parted(roles, [], "role")[0]) == roles
    stores = [diagnosis_store(tmp_path, FEW, trials, [], DiagnosisOptions(), "") for trials in ([first, second], roles)]
    assert stores[0].about != stores[1].about, "parts of one would be resumed by the other"


def test_a_reading_that_makes_the_ship_explode_has_no_likelihood() -> None:
    read, exploding = (InputReading(False, gain, 1.0, 3.0).notices[0] for gain in (2.0, float("inf")))
    assert read.code == exploding.code == "coarse_samples" and "2.0" in read and "inf" not in exploding

"""Which trials a diagnosis takes: none that tell nothing, none twice, none that are kept for tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.io.site import Site
from cases.simulation.simulate import SensorNoise, add_noise
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.inputs import (
    Case,
    independent_tests,
    parted,
)
from diagnosis.prepare import InputReading, prepare
from mmg.errors import Missing, TooFewData
from mmg.ship import Ship
from tests.diagnosis.judgement.test_verdict import RUNS
from tests.support.diagnosis_cases import BANK, FEW, pushed_trials
from tests.support.quick import first_quick


def test_trials_that_tell_nothing_are_refused_and_copies_count_once() -> None:
    one, other = pushed_trials(1, runs=RUNS)
    copy = replace(one, name="again")
    kept, (message,) = TrialSet.of([one, copy, other]).moving("diagnose").once
    assert [t.name for t in kept] == [one.name, other.name] and message.code == "copies_left_out"
    still = {name: np.full_like(one[name], one[name][0]) for name in ("n", "delta")}
    with pytest.raises(TooFewData):
        TrialSet.of([replace(one, columns={**one.columns, **still})]).moving("diagnose")
    with pytest.raises(Missing):
        TrialSet.of([]).moving("diagnose")


def test_a_test_is_told_from_a_trial_of_its_name() -> None:
    """Copies among the tests share no rows with a trial that is called as one of them."""
    one, other = pushed_trials(1, runs=RUNS)
    trials, tests = [replace(one, name="a")], [replace(other, name=name) for name in ("a", "b")]
    assert independent_tests(trials, tests) == (tests, [])
    kept, (shared, none_left) = independent_tests(trials, [replace(one, name="c", sha256="")])
    assert kept == [] and (shared.code, none_left.code) == ("shared_rows", "no_test_left")


def test_trials_that_trials_toml_keeps_for_tests_take_no_part() -> None:
    first, second = pushed_trials(1, runs=RUNS)
    kept, tests, (message,) = parted([replace(first, role="train"), replace(second, role="validate")], [first])
    assert [t.name for t in kept] == [first.name] and [t.name for t in tests] == [first.name, second.name]
    assert message.code == "role_held_out" and second.name in message
    with pytest.raises(Missing):
        parted([replace(first, role="test")], [second])
    roles = [first, replace(second, role="test")]
    assert list(parted(roles, [], "role")[0]) == roles


def test_a_reading_that_makes_the_ship_explode_has_no_likelihood() -> None:
    read, exploding = (InputReading(False, gain, 1.0, 3.0).notices[0] for gain in (2.0, float("inf")))
    assert read.code == exploding.code == "coarse_samples" and "2.0" in read and "inf" not in exploding


SAMPLE, FINE = 0.2, 0.02
QUIET_RUNS = ("zigzag:20/20", "turning:35", "turning:-20")


def drawn_about(ship: Ship, rng: np.random.Generator) -> Ship:
    """``ship`` with coefficients drawn_about about hers, 0.4 standard deviations of the prior wide."""
    rows = {s: ship.coefficients[s] for s in ship.free}
    moved = {s: float(np.clip(c.value + 0.4 * c.std * rng.normal(), c.lower, c.upper)) for s, c in rows.items()}
    return ship.with_coefficients({s: rows[s].with_(value=value) for s, value in moved.items()})


def quiet_runs(ship: Ship, held: bool, seed: int) -> list[Trial]:
    """Noisy runs in steady wind, sampled every SAMPLE seconds."""
    found = []
    for k, words in enumerate(QUIET_RUNS):
        dt = SAMPLE if held else FINE
        run = simulated_trial(ship, words, None, f"1.5:{110 * k}", False, seed, dt)
        every = round(SAMPLE / dt)
        run = replace(run, columns={name: values[::every] for name, values in run.columns.items()}, name=f"run_{k}")
        found.append(add_noise(run, SensorNoise.for_length(ship.particulars["L"]), 10 * seed + k))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("held", first_quick([True, False]))
def test_nothing_is_seen_in_trials_without_random_forces_however_actuators_are_sampled(held: bool) -> None:
    trials = TrialSet.of(quiet_runs(drawn_about(FEW, np.random.default_rng(5)), held, 5))
    ready = prepare(Case(FEW, trials, place=Site({"bank": BANK}, {})))
    assert ready.reading.straight is not held and ready.problem.data.straight is not held
    assert ready.reading.gain > 2.0
    tests = score_tests(slopes(ready.problem.steps, ready.problem.data, ready.null, ready.full.candidates),
                        ready.full.candidates)  # fmt: skip
    assert tests[0].p_value > 0.01
    draft = next(t for t in tests if t.candidate.effect == "draft")
    assert draft.p_single > 0.01

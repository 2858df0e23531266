"""An effect that makes the ship answer late is not halved by the way in which the actuators are read."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.shipfiles.effects import with_effects
from cases.simulation.sensors import SensorNoise, add_noise
from cases.trial import Trial
from diagnosis.estimation.candidates import find
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.refit import refit
from diagnosis.judgement.other_reading import as_shown, explains_lateness, other_reading, read_joined, read_otherwise
from diagnosis.prepare import InputReading, Prepared, prepare
from tests.support.diagnosis_cases import FEW

SAMPLE, FINE, LATE = 0.5, 0.05, 1.0


@pytest.fixture(scope="module")
def joined() -> list[Trial]:
    """Runs whose actuators move between the samples, of a ship whose hull answers late."""
    ship, found = with_effects(FEW, [f"hull_memory:T={LATE}"]), []
    for k, words in enumerate(("zigzag:20/20", "turning:35", "turning:-20")):
        run = simulated_trial(ship, words, None, None, False, 3, FINE)
        thin = {name: values[:: round(SAMPLE / FINE)] for name, values in run.columns.items()}
        found.append(add_noise(replace(run, columns=thin, name=f"run_{k}"), SensorNoise.for_length(3.0), k))
    return found


def found_with(
    trials: list[Trial], straight: bool, name: str = "hull_memory", first: float = LATE
) -> tuple[Prepared, Selection]:
    """The problem as read so, for nobody knows how, and the effect fitted from its first value."""
    ready = prepare(FEW, trials, straight=straight)
    ready = replace(ready, reading=InputReading(straight, 5.0, SAMPLE, 3.0))
    effect, p = find(ready.full.candidates, name), ready.problem
    final = refit(p.steps, p.data, p.base, ready.null, [effect], {effect.columns[0]: first})
    return ready, Selection((effect,), ready.null, final, ())


def test_actuators_are_read_the_other_way_where_the_effect_is_likelier_so(joined: list[Trial]) -> None:
    ready, found = found_with(joined, straight=False)
    other = read_otherwise(ready, joined, found)
    assert other is not None and other.reading.straight and other.reading.gain > 3.0 and other.problem.data.straight
    assert [m.code for m in other.notices].count("coarse_samples") == 1
    right, again = found_with(joined, straight=True)
    assert abs(again.final.value("hull_memory.T") - LATE) < abs(found.final.value("hull_memory.T") - LATE)
    assert other.null.nll == pytest.approx(right.null.nll, abs=2.0)
    assert read_otherwise(right, joined, again) is None


def test_actuators_are_not_read_otherwise_without_a_choice_or_an_effect(joined: list[Trial]) -> None:
    ready, found = found_with(joined, straight=False)
    known = replace(ready, reading=replace(ready.reading, gain=None))
    assert read_otherwise(known, joined, found) is None
    assert read_otherwise(ready, joined, replace(found, effects=(), final=found.null)) is None


def late_rudder(late: float) -> list[Trial]:
    """Runs whose rudder and revolutions act late, with samples of them as they are at their times."""
    ship, found = with_effects(FEW, [f"control_delay:tau={late}"]), []
    for k, words in enumerate(("zigzag:20/20", "turning:35", "turning:-20")):
        run = simulated_trial(ship, words, None, None, False, 3, FINE)
        thin = {name: values[:: round(SAMPLE / FINE)] for name, values in run.columns.items()}
        found.append(add_noise(replace(run, columns=thin, name=f"late_{k}"), SensorNoise.for_length(3.0), k))
    return found


@pytest.mark.slow
def test_what_moves_from_sample_to_sample_is_joined_where_it_is_late_anyway() -> None:
    """Held samples fit as well with half a sample less, and would say so much too little."""
    trials = late_rudder(LATE)
    ready, found = found_with(trials, False, "control_delay")
    assert found.final.value("control_delay.tau") == pytest.approx(LATE - SAMPLE / 2, abs=0.05)
    other = read_otherwise(ready, trials, found)
    assert other is not None and other.reading.straight
    assert explains_lateness(replace(found, effects=(), final=found.null), found)
    assert not explains_lateness(found, found)
    assert not explains_lateness(replace(found, effects=(), final=found.null), replace(found, effects=()))
    right, again = found_with(trials, True, "control_delay")
    assert again.final.value("control_delay.tau") == pytest.approx(LATE, abs=0.05)
    assert other_reading(ready, trials, 1.0).null.nll == pytest.approx(right.null.nll, abs=10.0)  # type: ignore[union-attr]


@pytest.mark.slow
def test_half_a_sample_matters_where_the_trials_show_so_short_a_delay() -> None:
    """A ship of 30 m answers so slowly that samples of half a second are fine by their length alone."""
    trials = late_rudder(LATE)
    ready, found = found_with(trials, False, "control_delay")
    ready = replace(ready, reading=InputReading(False, 5.0, SAMPLE, 30.0), notices=())
    assert not ready.reading.is_doubtful and ready.reading.time_error == 0.0
    assert read_otherwise(ready, trials, found) is None
    shown = as_shown(ready, found)
    assert shown.reading.visible == pytest.approx(3.0 * found.final.std("control_delay.tau"))
    assert shown.reading.visible < SAMPLE / 2
    assert shown.reading.is_doubtful and [m.code for m in shown.notices] == ["coarse_samples"]
    assert shown.reading.time_error == pytest.approx(SAMPLE / 2 / 3**0.5)
    other = read_otherwise(shown, trials, found)
    assert other is not None and other.reading.straight
    assert not as_shown(ready, replace(found, effects=(), final=found.null)).reading.is_doubtful
    known = replace(ready, reading=replace(ready.reading, gain=None))
    assert not as_shown(known, found).reading.is_doubtful


@pytest.mark.slow
def test_held_actuators_are_joined_and_searched_again_only_where_something_makes_them_late() -> None:
    late, prompt = late_rudder(LATE), late_rudder(0.0)
    assert read_joined(found_with(late, True, "control_delay")[0], late) is None  # joined already
    ready, _ = found_with(late, False, "control_delay")
    other = read_joined(ready, late)
    assert other is not None and other.reading.straight
    assert read_joined(replace(ready, reading=replace(ready.reading, gain=None)), late) is None
    assert read_joined(found_with(prompt, False, "control_delay")[0], prompt) is None

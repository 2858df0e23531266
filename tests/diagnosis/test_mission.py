"""The mission in small: hidden effects are named, nothing where there is nothing, nor for filtered velocities."""

from __future__ import annotations

import time

import numpy as np
import pytest

from cases.evidence.kinematics import Kinematics
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, Wind, add_noise, simulate
from cases.trial import Trial
from diagnosis.diagnose import DiagnosisOptions, diagnose
from diagnosis.result import Diagnosis
from mmg.effects import EFFECTS
from mmg.effects.gyro import low_passed_samples
from tests.support.diagnosis_cases import ASTERN, FEW, RUNS, pushed_trials
from tests.support.disturbed_trials import drawn_ship
from tests.support.quick import first_quick

HIDDEN = {
    "current": "current:x=-0.02,y=0.02",
    "rudder_offset": "rudder_offset:delta=-0.07",
    "log_scale": "log_scale:share=0.03",
    "propeller_side_force": "propeller_side_force:factor=2.5",
    "antenna_offset": "antenna_offset:x=-0.2,y=0.15",
}
"""Of about one typical size; the size of each is compared with what was put in."""


def diagnosed(seed: int, *effects: str, astern: bool = False) -> Diagnosis:
    """A ship drawn from the prior, pushed by random forces, diagnosed from three runs and checked on two others."""
    ship, runs = drawn_ship(FEW, seed), ASTERN if astern else RUNS
    others = (("zigzag:-10/10", 80.0), runs[2])
    trials, tests = (pushed_trials(s, effects, r, ship) for s, r in ((seed, runs), (seed + 500, others)))
    return diagnose(FEW, trials, tests, options=DiagnosisOptions(step=0.5))


@pytest.mark.slow
def test_five_hidden_effects_are_named_and_nothing_else() -> None:
    answers = {}
    for seed, (name, text) in enumerate(HIDDEN.items(), start=300):
        d = diagnosed(seed, text, astern=name == "propeller_side_force")
        faults = [f for f in d.instruments if f.name in HIDDEN]
        answers[name] = (d.verdict, tuple(e.name for e in (*d.effects, *faults)))
        values = dict(pair.split("=") for pair in text.split(":")[1].split(","))
        for e in (*d.effects, *faults)[:1]:
            for k, value in values.items():
                estimate = e.parameters[k]
                assert abs(estimate.value - float(value)) < 4 * estimate.std, (name, k, estimate)
        assert d.held_out is not None and d.held_out.reduction > 0, name
    verdicts = {name: "none" if EFFECTS[name].measures else "named" for name in HIDDEN}
    assert answers == {name: (verdicts[name], (name,)) for name in HIDDEN}


@pytest.mark.slow
def test_three_ships_without_any_effect_get_no_name() -> None:
    answers = [diagnosed(seed) for seed in (200, 201, 202)]
    assert [(d.effects, d.remainder) for d in answers] == [((), False)] * 3
    assert [d.verdict for d in answers].count("none") >= 2
    assert all(d.ship is d.before for d in answers)


TAU = 0.4
"""s; of the true low pass."""


def low_passed(trial: Trial, in_body_axes: bool) -> Trial:
    """The ``trial`` with u and v, noise and all, behind a first-order low pass: each, or the velocity over ground."""
    turn = np.exp(1j * np.where(in_body_axes, 0.0, trial["psi"]))
    over_ground = (trial["u"] + 1j * trial["v"]) * turn
    late = [low_passed_samples(trial.t, part, TAU) for part in (over_ground.real, over_ground.imag)]
    logged = (late[0] + 1j * late[1]) / turn
    return trial.with_columns(u=logged.real, v=logged.imag)


def filtered_runs(in_body_axes: bool) -> list[Trial]:
    """Runs whose velocities are behind a low pass."""
    return [low_passed(trial, in_body_axes) for trial in pushed_trials(210, ship=drawn_ship(FEW, 210))]


@pytest.mark.slow
@pytest.mark.parametrize(("in_body_axes", "is_known"), first_quick([(True, False), (False, False), (True, True)]))
def test_filtered_velocities_are_a_fault_of_an_instrument_and_no_cause(in_body_axes: bool, is_known: bool) -> None:
    """Also where the ship has the filter already, as after ``mmg fit``, which frees it by default."""
    ship = FEW.with_effect("velocity_filter", {"tau": TAU, "body_axes": 1.0}) if is_known else FEW
    if is_known:
        row = ship.coefficients["velocity_filter.tau"].with_(std=0.2)
        ship = ship.with_coefficients({row.symbol: row})
    found = diagnose(ship, filtered_runs(in_body_axes), options=DiagnosisOptions(step=1.0))
    assert (found.verdict, found.effects) == ("none", ())
    faults = {fault.name: fault for fault in found.instruments}
    tau = faults["velocity_filter"].parameters["tau"]
    assert abs(tau.value - TAU) < 4 * tau.std < 0.7 * TAU
    assert faults["velocity_filter"].parameters["body_axes"].value == in_body_axes
    assert found.ship.coefficients["velocity_filter.body_axes"].value == in_body_axes


@pytest.mark.slow
def test_a_filter_that_only_the_search_finds_is_no_cause_either(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where too few positions are logged for the kinematics to show it."""
    monkeypatch.setattr(Kinematics, "effects", lambda sensors: {})
    began = time.perf_counter()
    found = diagnose(FEW, filtered_runs(False), options=DiagnosisOptions(step=0.5))
    assert found.timings["total"] > 0.9 * (time.perf_counter() - began), "the first pass counts as well"
    assert (found.verdict, found.effects) == ("none", ())
    assert "velocity_filter" in {fault.name for fault in found.instruments}
    assert "velocity_filter" not in {row.name for row in found.candidates}


FOUR = ("shallow_water:d_h=0.45", "fouling:share=0.4", "rudder_backlash:b=0.05", "wind_force:X=1,Y=1,N=1")
MANOEUVRES = ("zigzag:20/20", "zigzag:-10/10", "turning:35", "turning:-20", "random:11", "random:12", "berthing")
TESTS = ("random:21", "zigzag:-15/15", "turning:-35")


@pytest.mark.slow
@pytest.mark.parametrize("seed", first_quick([0, 2], pytest.mark.longest))
def test_four_causes_at_once_are_all_named_with_their_sizes(seed: int) -> None:
    """Shallow water, fouling, a worn steering gear and wind on a 7 m KVLCC2 whose coefficients are known to 2 %."""
    ship, rng = load_ship("kvlcc2_l7"), np.random.default_rng([20, seed])
    rows = {s: ship.coefficients[s] for s in ship.free}
    ship = ship.with_coefficients({s: c.with_(std=max(0.02 * abs(c.value), 1e-5)) for s, c in rows.items()})
    drawn = {s: c.value * (1 + 0.02 * rng.standard_normal()) for s, c in rows.items()}
    true, noise, trials = with_effects(ship.with_values(drawn), FOUR), SensorNoise.for_length(7.0), list[Trial]()
    for number, text in enumerate((*MANOEUVRES, *TESTS)):
        own = np.random.default_rng([21, seed, number])
        wind = Wind(own.uniform(1.5, 4.0), own.uniform(0, 2 * np.pi), gusty=True)
        maneuver = parse_maneuver(text, true, duration=180.0)
        maneuver.start[2] = own.uniform(-np.pi, np.pi)
        gusts, errors = own.integers(0, 2**31, 2).tolist()
        trials.append(add_noise(simulate(true, maneuver, 0.5, wind, gusts, maneuver.start), noise, errors))
    found = diagnose(ship, trials[: len(MANOEUVRES)], trials[len(MANOEUVRES) :])
    truth = {name: true.parameters_of(name) for name in true.effects}
    assert found.verdict == "named" and {e.name for e in found.effects} == set(truth) and not found.remainder
    sizes = [(e.name, s, p) for e in found.effects for s, p in e.parameters.items() if p.std > 0]
    assert len(sizes) >= 6
    assert all(abs(p.value - getattr(truth[name], s)) < 3 * p.std for name, s, p in sizes)

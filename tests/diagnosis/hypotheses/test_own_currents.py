"""A current that differs from run to run is found, taken out of the trials, and nothing else is named for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import diagnosis.hypotheses.own_currents as module
import mmg_ident
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis.diagnose import diagnose
from diagnosis.estimation.map_estimate import BrokenModelError
from diagnosis.hypotheses.own_currents import own_currents
from diagnosis.inputs import Case
from diagnosis.prepare import prepare
from tests.support.diagnosis_cases import FEW, pushed_trials

RUNS = (("zigzag:20/20", 60.0), ("random:11", 60.0), ("turning:-20", 60.0), ("turning:20", 60.0))
TESTS = (("random:5", 60.0), ("turning:30", 60.0))
TIDE = ((0.06, 0.02), (0.02, 0.01), (-0.03, 0.0), (-0.06, -0.02))
LATER = ((-0.04, -0.02), (0.03, 0.02))
"""Currents of the runs [m/s] to north and east."""


def in_currents(runs: Sequence[tuple[str, float]], currents: Sequence[tuple[float, float]], seed: int) -> list[Trial]:
    made = []
    for k, (run, (x, y)) in enumerate(zip(runs, currents, strict=True)):
        made += pushed_trials(seed + k, [f"current:x={x},y={y}"] if x or y else [], [run])
    return made


def test_through_the_water_a_ship_in_a_current_is_one_in_still_water() -> None:
    """Positions, velocities and wind: a run with a current, and one without in the wind less the current (Galileo)."""
    t, (north, east), heading = np.arange(0.0, 40.0, 0.5), (0.1, -0.05), 0.3
    c, s = np.cos(heading), np.sin(heading)
    drift = np.array([0.0, 0.0, 0.0, c * north + s * east, -s * north + c * east, 0.0])
    start, rudder = np.array([0.0, 0.0, heading, 0.4, 0.0, 0.0]), 0.3 * np.sin(0.2 * t)
    told = -2.0 * np.exp(1j * 1.0)  # air over ground, north + i east [m/s]

    def run(air: complex, x0: np.ndarray, **more: Any) -> Trial:
        wind = {"wind_speed": abs(air), "wind_direction": float(np.angle(-air) % (2 * np.pi))}
        return mmg_ident.simulate("esso_osaka_3m", t, n=10.0, delta=rudder, x0=x0, **wind, **more)

    moved = run(told, start + drift, effects={"current": {"x": north, "y": east}}).through_water(north, east)
    still = run(told - complex(north, east), start)
    np.testing.assert_allclose(moved.states, still.states, atol=2e-5)
    np.testing.assert_allclose(moved.wind_vector, still.wind_vector, atol=1e-12)


@pytest.mark.slow
def test_currents_of_training_and_test_runs_are_found_and_taken_out(monkeypatch: pytest.MonkeyPatch) -> None:
    ready = prepare(Case(FEW, TrialSet.of(in_currents(RUNS, TIDE, 4)), in_currents(TESTS, LATER, 20)))
    found = own_currents(ready.problem, ready.null)
    assert found is not None and found.found.evidence > 20.0
    for known, true in ((found.training, TIDE), (found.tests, LATER)):
        np.testing.assert_allclose([known[k] for k in range(len(true))], true, atol=0.012)
    least, most = found.speeds
    assert least < 0.03 and most == pytest.approx(0.064, abs=0.012)

    def breaks(*_: object, **__: object) -> None:
        raise BrokenModelError("the ship explodes")

    monkeypatch.setattr(module, "estimate", breaks)
    assert own_currents(ready.problem, ready.null) is None  # and the diagnosis goes on over ground


@pytest.mark.slow
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.06, 0.02)])
def test_still_water_and_one_current_are_no_currents_by_run(current: tuple[float, float]) -> None:
    ready = prepare(Case(FEW, TrialSet.of(in_currents(RUNS, [current] * 4, 4))))
    assert own_currents(ready.problem, ready.null) is None


@pytest.mark.slow
def test_a_tide_is_named_and_nothing_beside_it() -> None:
    """It was "unknown", or an antenna and a hull with a memory."""
    found = diagnose(FEW, in_currents(RUNS, TIDE, 4), in_currents(TESTS, LATER, 20))
    assert (found.verdict, [e.name for e in found.effects]) == ("named", ["current"]) and not found.remainder
    assert found.effects[0].evidence > 20.0 and found.held_out is not None and found.held_out.reduction > 0.8
    mean = np.mean(TIDE, axis=0)
    for axis, value in zip("xy", mean, strict=True):
        row = found.effects[0].parameters[axis]
        assert row.value == pytest.approx(value, abs=3 * row.std)

"""Model choice by cross-validation over runs."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.gusts import Wind
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate
from cases.trial import Trial
from fitting.selection import cross_validation as selection
from fitting.selection.cross_validation import Choice, folds_of, prepare, select, standard_error, weighted_mean
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.messages import has_code
from mmg.progress import LOGGER, Progress
from mmg.ship import Ship
from tests.support.synthetic_runs import runs

FREE = ("X_0F", "Y_v", "N_v", "N_r", "k_0", "w_P0")
RUNS = ("zigzag:20/20", "zigzag:-10/10", "random:11", "random:12")


def start() -> Ship:
    ship = load_ship("esso_osaka_3m")
    truth = hidden_ship()
    truth = truth.fixing([s for s in truth.symbols if s not in FREE])
    return truth.with_values({s: ship.coefficients[s].value for s in FREE})


def late(tau: float) -> list[Trial]:
    """Runs of the hidden ship whose logged velocity is late by tau [s]."""
    ship = with_effects(hidden_ship(), [f"velocity_filter:tau={tau}"])
    trials = []
    for i, text in enumerate(RUNS):
        plan = parse_maneuver(text, ship, n=10.0, duration=100.0)
        run = simulate(ship, plan, 0.1, Wind(1.0, 0.5 * i, True), i, plan.start)
        trials.append(replace(add_noise(run, SensorNoise.for_length(3.0), i), name=f"run_{i}"))
    return trials


def test_folds_hold_every_run_once_and_spread_the_kinds() -> None:
    trials = [replace(t, kind=k) for t, k in zip(runs()[0], "aabbccc", strict=True)]
    parts = folds_of(trials, 3)
    assert sorted(i for part in parts for i in part) == list(range(7))
    assert all(len({trials[i].kind for i in part}) >= 2 for part in parts)
    assert [len(p) for p in folds_of(trials, 20)] == [1] * 7


def test_the_standard_error_of_a_difference_is_that_of_its_mean() -> None:
    d = np.random.default_rng(0).normal(size=(2000, 3))
    assert standard_error(d, np.ones(2000)) == pytest.approx(1 / np.sqrt(2000), rel=0.1)
    assert weighted_mean(np.array([1.0, np.nan, 3.0]), np.array([1.0, 0.0, 3.0])) == pytest.approx(2.5)
    assert weighted_mean(np.array([1.0, np.inf, 3.0]), np.array([1.0, 5.0, 3.0])) == np.inf  # it diverges on one
    assert weighted_mean(np.array([1.0, np.nan, 3.0]), np.array([1.0, 5.0, 3.0])) == 2.5  # nothing to score in one


def test_a_choice_is_put_on_the_ship() -> None:
    ship = start()
    other = prepare(ship, Choice(("velocity_filter",), 2.0, held=("Y_v",)))
    assert "velocity_filter" in other.effects and "velocity_filter.tau" in other.free and "Y_v" not in other.free
    assert other.coefficients["N_r"].std == 2 * ship.coefficients["N_r"].std
    back = prepare(other, Choice())
    assert back.effects == ship.effects


@pytest.mark.slow
def test_a_velocity_filter_in_the_data_is_found_by_cross_validation(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(selection, "STEPS", ())
    monkeypatch.setattr(selection, "WIDTHS", ())
    monkeypatch.setattr(selection, "INSTRUMENTS", (("velocity_filter",),))
    trials = late(1.0)
    caplog.set_level(logging.INFO, logger=LOGGER.name)
    steps: list[Progress] = []
    found = select(start(), trials, Settings(step=1.0, window=50.0), progress=steps.append)
    assert found.choice.measurement == ("velocity_filter",) and "velocity_filter.tau" in found.ship.free
    rows = [row.to_dict() for row in found.table]
    assert rows[0]["varied"] == "start" and rows[0]["taken"] and rows[1]["taken"]
    assert rows[1]["window"] < rows[0]["window"] and rows[1]["difference"] < -rows[1]["error"]
    said = [record for record in caplog.records if record.getMessage().startswith("auto, ")]
    assert len(said) == len(rows) and not rows[-1]["taken"]
    assert [s.step for s in steps if s.task == steps[0].task] == list(range(1, 1 + (steps[0].of or 0)))
    assert found.settings.loss == "gaussian"


def test_no_time_leaves_the_choice_as_given() -> None:
    found = select(start(), late(0.0)[:3], Settings(step=1.0, window=50.0), limit=0.0)
    assert len(found.table) == 1 and has_code(found.notices, "model_choice_stopped")


def test_too_few_runs_are_refused() -> None:
    with pytest.raises(UserError, match="at least three trials"):
        select(start(), runs()[0][:2], Settings())

"""Adaptation to a run's disturbance: it helps where there is one, and never looks into the window."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate
from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction import stretches
from fitting.prediction.predict import Window, predict, predict_all
from fitting.prediction.score import adaptation_worth, past_to_use, score
from fitting.prediction.stretches import (
    FadingCurrent,
    WindowBatch,
    adapt,
    default_past,
    past_begin,
    record_of,
    restarts,
    rollout,
)
from mmg.motion.flow import STATES
from mmg.rollout import Simulator

CURRENT = {"x": 0.03, "y": -0.04}


@cache
def simulator() -> Simulator:
    return Simulator(hidden_ship())


@cache
def run(current: bool, noise: bool = True) -> Trial:
    """A zigzag of the hidden ship, in a current that the model does not know, or in still water."""
    ship = hidden_ship()
    if current:
        ship = ship.with_effect("current", CURRENT)
    trial = simulate(ship, parse_maneuver("zigzag:20/20", ship, n=10.0, duration=120.0), dt=0.2)
    return add_noise(trial, SensorNoise.for_length(3.0), 1) if noise else trial


def windows_of(trial: Trial, past: float = 0.0) -> list[Window]:
    return predict(simulator(), trial, 30.0, 15.0, False, past=past)[0]


def test_a_hidden_current_is_found() -> None:
    record = record_of(run(True), simulator().ship.inputs)
    windows = [Stretch(record, row, row + 50) for row in (200, 300, 400)]
    water, _ = adapt(simulator(), windows, 30.0)
    # the current along the ship shows little in ten seconds, so the prior keeps it small
    np.testing.assert_allclose(water.velocity[1], CURRENT["y"], atol=0.02)


def test_data_after_the_start_of_a_window_and_before_its_past_do_not_change_its_prediction() -> None:
    trial, rng = run(True), np.random.default_rng(0)
    windows = windows_of(trial, 10.0)
    row = np.arange(len(trial))
    for seen in (row <= windows[3].first, row >= windows[3].first - 51):
        noise = rng.normal(0, 0.1, (len(STATES), len(trial))) * ~seen
        changed = {name: trial[name] + more for name, more in zip(STATES, noise, strict=True)}
        others = windows_of(trial.with_columns(**changed), 10.0)
        same = [np.array_equal(a.states, b.states) for a, b in zip(windows, others, strict=True)]
        assert same[3] and not all(same)


def test_each_window_is_adapted_to_its_own_past_alone_and_one_without_a_past_is_not() -> None:
    plain, adapted = windows_of(run(True)), windows_of(run(True), 30.0)
    np.testing.assert_allclose(plain[0].states, adapted[0].states, atol=1e-12)
    assert np.abs(plain[1].states - adapted[1].states).max() > 0.05
    both = predict_all(simulator(), [run(True), run(False)], 30.0, 15.0, False, past=30.0)
    for one, other in zip(both[0][0], adapted, strict=True):
        np.testing.assert_allclose(one.states, other.states, rtol=0, atol=1e-12)


def test_the_past_ends_at_missing_samples_and_gaps() -> None:
    trial = run(True)
    u = trial["u"].copy()
    u[150] = np.nan
    record = record_of(trial.with_columns(u=u), simulator().ship.inputs)
    assert past_begin(record, 200, 30.0) == 151
    assert past_begin(record, 150, 30.0) == 150
    assert past_begin(record, 400, 30.0) == 250
    pieces = restarts(record, 200, 30.0, 8.0)
    assert pieces[0].last == 200 and min(p.first for p in pieces) >= 151


def test_positions_are_not_needed() -> None:
    trial = run(True)
    blind = Trial("blind", {k: v for k, v in trial.columns.items() if k not in ("x", "y")})
    windows = windows_of(blind, 30.0)
    assert all(np.isfinite(w.states).all() for w in windows)
    assert (windows[2].states[0, :2] == 0).all()


def test_a_current_that_lasts_is_that_of_the_current_effect() -> None:
    ship = hidden_ship()
    moving = Simulator(ship.with_effect("current", CURRENT))
    record = record_of(run(False, noise=False), ship.inputs)
    timed = record_of(run(False, noise=False), moving.ship.inputs)
    water = FadingCurrent(np.array([[CURRENT["x"]], [CURRENT["y"]]]), 1e9)
    ours = rollout(simulator(), WindowBatch.of([Stretch(record, 100, 250)]), water)[0]
    theirs = rollout(moving, WindowBatch.of([Stretch(timed, 100, 250)]))[0]
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_a_lag_starts_from_what_the_past_left_in_it() -> None:
    ship = hidden_ship().with_effect("velocity_filter", {"tau": 0.8})
    trial = simulate(ship, parse_maneuver("random:5", ship, n=10.0, duration=120.0), dt=0.1)
    sigma = np.array([1.0, 1.0, 0.1, 0.1, 0.03, 0.01])
    without, adapted = (score(Simulator(ship), [trial], sigma, adapt=a) for a in (None, 30.0))
    assert adapted.window < 0.7 * without.window


def test_a_model_that_explodes_along_the_past_is_not_adapted() -> None:
    """As a model of 3 m does on the trials of a ship of 320 m."""
    large = load_ship("kvlcc2_full")
    trial = simulate(large, parse_maneuver("turning:35", large, n=1.2, duration=300.0), dt=1.0)
    windows = predict(simulator(), trial, 30.0, 15.0, False, past=100.0)[0]
    assert len(windows) > 10


def test_the_past_scales_by_froudes_law(monkeypatch: pytest.MonkeyPatch) -> None:
    lengths, decays, still = [], [], stretches.Record(np.zeros(2), np.zeros((2, 6)), np.zeros((2, 4)), np.ones(2, bool))

    def none(*given: Any) -> list[Stretch]:
        lengths.append(given[3])
        return []

    monkeypatch.setattr(stretches, "restarts", none)
    ships = load_ship("esso_osaka_3m"), load_ship("kvlcc2_full")
    for ship in ships:
        decays.append(adapt(Simulator(ship, compiled=False), [Stretch(still, 0, 1)], 30.0)[0].decay)
    k = (ships[1].particulars["L"] / 3.0) ** 0.5
    assert lengths == pytest.approx([8.0, 8.0 * k]) and decays == pytest.approx([120.0, 120.0 * k])
    assert [default_past(ship) for ship in ships] == [30, round(30 * k)]


# Whether the past of a window is used: by default where that paid on trials held out, which is said
PAID = {
    "past_s": 30.0, "trials": "left out", "files": 4, "worthwhile": True,
    "without": {"window": 1.0, "paper": 1.0}, "with": {"window": 0.8, "paper": 0.9},
}  # fmt: skip
POOR = {**PAID, "worthwhile": False}


@cache
def runs(current: bool) -> tuple[Trial, ...]:
    """Runs of the hidden ship, each in a current of its own or in still water."""
    found = []
    for number, (north, east) in enumerate(((0.04, 0.0), (0.0, -0.05), (-0.03, 0.03))):
        ship = hidden_ship().with_effect("current", {"x": north, "y": east}) if current else hidden_ship()
        trial = simulate(ship, parse_maneuver(f"random:{number}", ship, n=10.0, duration=120.0), dt=0.5)
        found.append(add_noise(trial, SensorNoise.for_length(3.0), number))
    return tuple(found)


def test_it_pays_where_runs_differ_and_not_where_they_do_not() -> None:
    simulator = Simulator(hidden_ship())
    pays, not_needed = (adaptation_worth(simulator, runs(current)) for current in (True, False))
    assert pays and not_needed
    assert pays["worthwhile"] and pays["with"]["window"] < 0.9 * pays["without"]["window"]
    assert pays["with"]["paper"] < pays["without"]["paper"]
    assert not not_needed["worthwhile"]
    assert not_needed["with"]["window"] < 1.05 * not_needed["without"]["window"]
    assert pays["trials"] == "validation" and pays["past_s"] == 30


def test_trials_that_were_left_out_are_predicted_by_their_own_coefficients() -> None:
    simulator, trials = Simulator(hidden_ship()), runs(True)
    own = np.tile(np.asarray(hidden_ship().values), (len(trials), 1))
    same = adaptation_worth(simulator, trials, np.where(np.arange(len(trials))[:, None] == 1, np.nan, own))
    plain = adaptation_worth(simulator, trials)
    assert same and plain and same["trials"] == "left out"
    assert same["without"]["window"] == pytest.approx(plain["without"]["window"], rel=1e-9)
    own[:, hidden_ship().symbols.index("N_r")] *= 0.5
    worse = adaptation_worth(simulator, trials, own)
    assert worse and worse["without"]["window"] > 1.1 * plain["without"]["window"]


@pytest.mark.parametrize(
    ("result", "wanted", "seconds", "code"),
    [
        ({"adaptation": PAID}, None, 30, "adaptation_on"),
        ({"adaptation": POOR}, None, 0, "adaptation_off"),
        ({"bands": {}}, None, 0, "adaptation_untested"),
        ({"adaptation": None}, None, 0, "adaptation_untested"),
        ({"adaptation": {"worthwhile": True}}, None, 0, "adaptation_untested"),
        ({"adaptation": 3}, None, 0, "adaptation_untested"),
        ({}, None, 0, ""),
        ({"model": "fnn"}, None, 0, ""),
        ({"adaptation": PAID}, 0.0, 0, ""),
        ({"adaptation": PAID}, 12.0, 12, ""),
        ({"adaptation": POOR}, 12.0, 12, "adaptation_does_not_pay"),
        ({}, 12.0, 12, "adaptation_untested"),
    ],
)
def test_by_default_a_run_does_what_it_knows_and_else_what_the_user_wants(
    result: dict, wanted: float | None, seconds: float, code: str
) -> None:
    used, notes = past_to_use(result, wanted)
    assert used == seconds and [note.code for note in notes] == [code] * bool(code)
    assert ("--adapt 0" in "".join(notes)) == (code == "adaptation_on")

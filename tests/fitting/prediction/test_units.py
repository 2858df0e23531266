"""Errors in units: by hand over windows, of figures, of large ships, and by run in reports and on the console."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import wrap, write_trial
from cases.trial import Trial
from fitting.nlp.windows import Record, Stretch
from fitting.prediction.baselines import GreyBox, Persistence, fit_grey_box
from fitting.prediction.predict import predict
from fitting.prediction.score import Score, ScorePair, pooled_sigma, score
from fitting.prediction.unit_errors import StateErrors, UnitErrors, errors_in_units, ship_time, window_for
from fitting.report.run_folder import adapter
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.commands.main import main
from tests.support.commands import shown


def recorded(ship: Ship, text: str, speed: float, dt: float) -> Trial:
    plan = parse_maneuver(text, ship, speed=speed)
    return replace(simulated_trial(ship, plan, dt=dt), name=text.replace(":", "_").replace("/", "_"))


@pytest.fixture(scope="module")
def ship() -> Ship:
    return load_ship("esso_osaka_3m")


@pytest.fixture(scope="module")
def trials(ship: Ship) -> list[Trial]:
    return [recorded(ship, text, 0.4, 0.2) for text in ("turning:35", "zigzag:-20/10")]


@pytest.fixture(scope="module")
def other(ship: Ship) -> Simulator:
    """A ship whose rudder is weaker."""
    c = ship.coefficients["a_H"]
    return Simulator(ship.with_values({"a_H": 0.5 * c.value}))


def test_errors_are_those_of_the_windows_by_hand(trials: list[Trial], other: Simulator) -> None:
    found = errors_in_units(other, trials, window=20.0)
    assert found.window_s == 20.0 and found.stride_s == 10.0
    for trial, run in zip(trials, found.runs, strict=True):
        windows, _ = predict(other, trial, 20.0, 10.0, False)
        errors = np.vstack([w.error(trial.states)[1:] for w in windows])
        assert run.windows == len(windows)
        assert run.position_m == pytest.approx(math.sqrt((errors[:, :2] ** 2).sum(axis=1).mean()))
        assert run.heading_deg == pytest.approx(math.degrees(math.sqrt((errors[:, 2] ** 2).mean())))
        assert run.u_m_s == pytest.approx(math.sqrt((errors[:, 3] ** 2).mean()))
        assert run.r_deg_s == pytest.approx(math.degrees(math.sqrt((errors[:, 5] ** 2).mean())))
        last = np.array([w.error(trial.states)[-1] for w in windows])
        assert run.heading_end_deg == pytest.approx(math.degrees(math.sqrt((last[:, 2] ** 2).mean())))
        assert run.share_of_change > 0
        row = round(found.seconds["ship_length"] / trial.dt)
        early = np.array([w.error(trial.states)[row, 4] for w in windows])
        assert run.after["ship_length"].v_m_s == pytest.approx(math.sqrt((early**2).mean()))
        assert run.after["window"].position_m == run.position_end_m
    kept = errors_in_units(Persistence(other.inputs), trials, window=20.0)
    assert found.persistence is not None and found.persistence.change == found.change
    assert replace(found.persistence.pooled, after=kept.pooled.after) == kept.pooled
    assert found.ratio["persistence"]["v"] == pytest.approx(found.pooled.v_m_s / kept.pooled.v_m_s)


def test_the_true_ship_has_no_error_of_figures_and_a_wrong_one_has(
    ship: Ship, trials: list[Trial], other: Simulator
) -> None:
    truth, wrong = errors_in_units(Simulator(ship), trials), errors_in_units(other, trials)
    assert [[m.title for m in run.maneuvers] for run in truth.runs] == [["turning 35"], ["zigzag -20/10"]]
    names = {f.figure for run in truth.runs for m in run.maneuvers for f in m.figures}
    assert {"advance", "tactical_diameter", "overshoot_1", "overshoot_2"} <= names
    for a, b in zip(truth.runs, wrong.runs, strict=True):
        for good, bad in zip(a.maneuvers[0].figures, b.maneuvers[0].figures, strict=True):
            assert abs(good.error) < 0.02 * abs(good.measured) + 0.05, good
            assert good.measured == bad.measured and abs(bad.error) > abs(good.error), bad


def test_windows_of_a_large_ship_are_four_ship_times_and_those_of_a_model_30_s(trials: list[Trial]) -> None:
    large = load_ship("kvlcc2_full")
    run = recorded(large, "zigzag:10/10", 7.0, 1.0)
    unit = ship_time([run], 320.0)
    assert 40 < unit < 60 and window_for(trials, 3.0) == 30.0 and window_for([run], None) == 30.0
    assert window_for([run], 320.0) == pytest.approx(4 * unit, abs=5.0)
    found = errors_in_units(Simulator(large), [run])
    assert found.window_s == window_for([run], 320.0) and found.ship_times == pytest.approx(4.0, abs=0.2)


def test_a_heading_that_goes_round_does_not_hide_its_error(ship: Ship) -> None:
    """sigma of a heading stored unwrapped over a turn of 540 deg is several times the change over a window."""
    turn = recorded(ship, "turning:35", 0.4, 0.2)
    unwrapped = turn.with_columns(psi=turn.psi_unwrapped)
    found = errors_in_units(Simulator(ship), [unwrapped])
    assert pooled_sigma([unwrapped])[2] > 1.5 * found.change["psi"]
    wrapped = errors_in_units(Simulator(ship), [turn.with_columns(psi=wrap(turn["psi"]))])
    assert wrapped.change == pytest.approx(found.change)


def test_runs_that_became_worse_are_listed_with_their_errors(ship: Ship, trials: list[Trial], other: Simulator) -> None:
    sigma = pooled_sigma(trials)
    good, bad = (score(model, trials, sigma, units=0.0) for model in (Simulator(ship), other))
    pair = ScorePair(good, bad)
    assert len(pair.worse_runs) == 2 and "position" in pair.worse_runs[0] and " deg" in pair.worse_runs[0]
    (message,) = pair.worse_by_run("validation")
    assert "turning_35" in message
    assert [m.code for m in pair.worse("validation")] == ["worse_after"] and pair.unbeaten("validation") == []
    assert ScorePair(bad, good).worse_by_run("validation") == ScorePair(bad, good).worse("validation") == []
    braked = score(Simulator(ship.with_values({"X_0F": -0.09})), trials, sigma, units=0.0)
    assert [m.code for m in ScorePair(good, braked).unbeaten("validation")] == ["worse_than_persistence"]


def stretch_of(states: np.ndarray, controls: np.ndarray, dt: float) -> Stretch:
    record = Record(dt * np.arange(len(states)), states, controls, np.ones(len(states), dtype=bool))
    return Stretch(record, 0, len(states) - 1)


@pytest.mark.parametrize("turn_rate", [0.0, 0.02, -0.02])
def test_velocities_that_are_kept_go_round_a_circle(turn_rate: float) -> None:
    t, u, v, psi = 0.5 * np.arange(200), 0.4, -0.1, 3.0
    heading = psi + turn_rate * t
    course = u + 1j * v  # d(x + i y)/dt = (u + i v) exp(i psi)
    way = course * t if turn_rate == 0 else course * (np.exp(1j * turn_rate * t) - 1) / (1j * turn_rate)
    track = 2.0 - 1.0j + np.exp(1j * psi) * way
    ones = np.ones(len(t))
    states = np.column_stack([track.real, track.imag, heading, u * ones, v * ones, turn_rate * ones])
    found = Persistence(()).forecast([stretch_of(states, np.zeros((len(t), 0)), 0.5)])[:, :, 0]
    np.testing.assert_allclose(found, states, atol=1e-9)


def moving(box: GreyBox, controls: np.ndarray, name: str) -> Trial:
    """A run of ``box`` under ``controls`` (N, C), every 0.2 s."""
    start = np.array([[0.0, 0.0, 1.0, 0.4, 0.0, 0.0]] * len(controls))
    states = box.forecast([stretch_of(start, controls, 0.2)])[:, :, 0]
    columns = dict(zip(("x", "y", "psi", "u", "v", "r"), states.T, strict=True))
    actuators = dict(zip([n for n in box.inputs if "wind" not in n], controls.T, strict=False))
    return Trial(name, {"t": 0.2 * np.arange(len(controls)), **columns, **actuators})


# Coefficients of a ship of 3 m at 0.4 m/s in a current of 0.03 m/s north and 0.02 m/s west: surge, sway, yaw, current.
TRUTH = np.array([
    0.0008, -0.002, -0.1, 0.8, 0.1,
    -0.3, -0.3, -0.2, -0.0001, -0.05,
    -0.1, -0.5, -0.2, -0.02, 0.00005, 0.05,
    0.03, -0.02,
])  # fmt: skip


@pytest.mark.slow
def test_a_grey_box_is_found_again_with_its_current_and_pods_are_as_rudders() -> None:
    inputs = ("n", "delta", "wind_north", "wind_east")
    box = GreyBox(inputs, {"n": (-1.0, 0.0)}, TRUTH, np.array([2.0, 2.0, 0.5]))
    t = 0.2 * np.arange(900)
    orders = [0.6 * np.sign(np.sin(t / 12)), 0.3 * np.sin(t / 5), np.full(900, -0.5)]
    still = np.zeros(900)
    controls = [np.column_stack([10 + np.sin(t / 9), delta, still, still]) for delta in orders]
    runs = [moving(box, rows, f"run_{i}") for i, rows in enumerate(controls)]
    found = fit_grey_box(runs[:2], inputs, {}, 30.0)
    np.testing.assert_allclose(found.coefficients[16:], TRUTH[16:], atol=2e-3)
    errors = errors_in_units(found, runs, 30.0)
    assert errors.pooled.share_of_change < 0.02
    assert errors_in_units(Persistence(inputs), runs, 30.0).pooled.share_of_change > 0.5
    pods = ("n_azimuth", "azimuth", "wind_north", "wind_east")
    other = replace(found, inputs=pods, places={"n_azimuth": (-1.0, 0.0)})
    azimuth = controls[2] * [1, -1, 1, 1]
    start = runs[2].states
    np.testing.assert_allclose(
        other.forecast([stretch_of(start, azimuth, 0.2)]), found.forecast([stretch_of(start, controls[2], 0.2)])
    )


def test_scores_with_and_without_units_are_read_back(ship: Ship, trials: list[Trial]) -> None:
    box = fit_grey_box(trials, ship.inputs, {}, 20.0)
    found = score(Simulator(ship), trials, units=20.0, baseline=box)
    assert found.units is not None and set(found.units.ratio) == {"persistence", "baseline"}
    again = adapter(Score).validate_python(json.loads(json.dumps(found.to_dict())))
    assert again.to_dict() == found.to_dict() and isinstance(again.units, UnitErrors)
    assert isinstance(again.units.pooled.after["window"], StateErrors)
    old = {key: value for key, value in found.to_dict().items() if key != "units"}
    assert adapter(Score).validate_python(old).units is None


@pytest.mark.slow
def test_verb_tells_first_which_model_does_not_beat_its_rivals(
    trials: list[Trial], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for trial in trials:
        write_trial(trial, tmp_path / f"{trial.name}.csv")
    still = load_ship("esso_osaka_3m").with_values({"X_0F": -0.09})
    (tmp_path / "still.toml").write_text(dump_ship(still), encoding="utf-8")
    models, paths = ["esso_osaka_3m", str(tmp_path / "still.toml")], [str(tmp_path / f"{t.name}.csv") for t in trials]
    words = ["score", *models, *paths, "--window", "40", "--baseline", *paths]
    data = shown(*words)
    true, wrong = (data["models"][name]["units"] for name in models)
    assert true["window_s"] == 40.0
    assert true["ratio"]["persistence"]["v"] < 0.05 < 1 < max(wrong["ratio"]["persistence"].values())
    assert true["baseline"]["pooled"]["windows"] == true["persistence"]["pooled"]["windows"] > 0
    assert len(data["worse"]) == 1 and all(line.startswith("still.toml") for line in data["defeats"])
    capsys.readouterr()
    assert main(words) == 0
    told = capsys.readouterr().out
    assert told.startswith("still.toml")
    tables = told.partition("\n\n")[2].partition("normalised")[0]
    assert max(map(len, tables.splitlines())) <= 80

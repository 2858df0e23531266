"""Predictions and the two metrics."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.io import published_splits as splits
from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import simulate, wrap, write_trial
from cases.trial import Trial, left_out
from fitting.nlp.windows import Record, Stretch
from fitting.prediction.baselines import GreyBox, Persistence, fit_grey_box
from fitting.prediction.predict import forces_along, predict
from fitting.prediction.score import (
    NOTHING,
    Score,
    ScorePair,
    check_scorable,
    in_words,
    pooled_sigma,
    score,
    score_messages,
    score_pairs,
    scores_by_set,
)
from fitting.prediction.stretches import record_of, window_rows, wrapped_error
from fitting.prediction.unit_errors import StateErrors, UnitErrors, errors_in_units, ship_time, window_for
from fitting.report.run_folder import adapter, plain
from mmg.components.rigid_body import accelerations, inertia
from mmg.errors import TooFewData, UserError
from mmg.model import NETWORK
from mmg.motion.flow import Force
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.commands.main import main
from tests.support.commands import shown
from tests.support.networks import random_network
from tests.support.synthetic_runs import runs

# Captive ship: 100 s restarts, 30 s windows, number of windows (shared notes, measured independently).
CHECK_VALUES = {
    "random_06-Aug-2020_16_24_25_5": (0.2370, 0.1181, 47),
    "turn_14-Oct-2020_14_56_07": (1.9800, 0.6865, 19),
    "zigzag_31-Jul-2020_14_10_05": (1.8812, 1.0223, 9),
    "berthing_12-Nov-2020_11_07_23": (0.1665, 0.1023, 11),
    "berthing_12-Nov-2020_13_09_11": (0.3388, 0.2066, 5),
}


@cache
def model() -> Simulator:
    return Simulator(load_ship("esso_osaka_3m"), compiled=False)


@pytest.mark.data
@pytest.mark.parametrize("method", ["euler", "rk4"])
def test_captive_check_values_of_both_metrics_are_reproduced_to_one_percent(frt, method) -> None:  # type: ignore[no-untyped-def]
    trials = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT))
    result = score(Simulator(load_ship("esso_osaka_3m")), trials, method=method)
    np.testing.assert_allclose(result.sigma, [14.23641, 4.24764, 1.54728, 0.11526, 0.04059, 0.01965], rtol=2e-4)
    for row in result.trials:
        paper, window, count = CHECK_VALUES[row.name]
        assert row.paper == pytest.approx(paper, rel=0.01)
        assert row.window == pytest.approx(window, rel=0.01)
        assert row.windows == count


class Diverging:
    """Predicts what was measured, and no number from the tenth row of a window on."""

    inputs = ("n", "delta", "wind_north", "wind_east")

    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        rows = max(s.last - s.first for s in stretches) + 1
        out = np.full((rows, 6, len(stretches)), np.nan)
        for i, s in enumerate(stretches):
            out[:10, :, i] = s.logged[:10]
        return out


@pytest.mark.slow
def test_a_prediction_that_diverges_has_no_score_and_is_said_to() -> None:
    trials = runs()[0][:2]
    found = score(Diverging(), trials)
    assert np.isinf([found.paper, found.window]).all() and found.diverged == tuple(t.name for t in trials)
    again = adapter(Score).validate_python(plain(found.to_dict()))  # null in the file
    assert np.isinf([again.paper, again.window]).all() and again.diverged == found.diverged
    kept, lost = (scores_by_set(one, {"a": trials}) for one in (model(), Diverging()))
    worse, better = score_pairs(kept, lost)["a"], score_pairs(lost, kept)
    message, by_run = worse.messages("a")  # pooled errors are infinite, which is no second thing to say
    assert (message.code, by_run.code) == ("no_score", "worse_runs") and trials[0].name in message
    assert better["a"].messages("a") == []
    assert in_words(found.window) == in_words(None) == "diverges" and in_words(0.25) == "0.2500"


@pytest.mark.slow
def test_a_trial_without_a_whole_restart_beside_broken_rows_has_nothing_to_score_there_and_the_rest_is() -> None:
    """A rudder that is unknown for a second in each 45 s: no restart is whole, 30 s windows are."""
    trial, whole = runs()[0][:2]
    delta = np.where((trial.t % 45.0 > 44.0) | (trial.t > trial.t[-1] - 2.0), np.nan, trial["delta"])
    for trials in ([trial.with_columns(delta=delta)], [trial.with_columns(delta=delta), whole]):
        found = score(model(), trials, np.ones(6), units=0.0)
        first = found.trials[0]
        assert (first.restarts, first.windows > 0, found.diverged) == (0, True, ())
        assert np.isnan(first.paper) and np.isfinite(first.window) and np.isfinite(found.window)
        assert np.isnan(found.paper) == (len(trials) == 1)
        assert [note.code for note in found.notes].count("nothing_scored") == 1
        again = adapter(Score).validate_python(plain(found.to_dict()))
        assert np.isnan(again.trials[0].paper) and again.diverged == ()
    assert in_words(first.paper) == NOTHING


def test_a_set_without_a_whole_window_is_not_scored() -> None:
    trial = runs()[0][0]
    short = replace(trial, columns={name: column[:50] for name, column in trial.columns.items()})
    with pytest.raises(UserError, match="30 s"):
        check_scorable([short], "to choose by", model().inputs)
    gone = left_out(trial, [(float(trial.t[0]), float(trial.t[-1]))], "test")
    assert scores_by_set(model(), {"short": [short], "gone": [gone]}) == {}
    with pytest.raises(TooFewData):
        pooled_sigma([gone])


def test_windows_are_301_rows_every_15_seconds_and_restarts_cover_the_run_with_a_short_last_one() -> None:
    rows = window_rows(np.arange(0, 100.05, 0.1), 30.0, 15.0, short_last=False)
    assert rows == [(first, first + 300) for first in (0, 150, 300, 450, 600)]
    t = 1894.0 + np.arange(0, 250.05, 0.1)
    assert window_rows(t, 100.0, 100.0, short_last=True) == [(0, 1000), (1000, 2000), (2000, 2500)]
    assert window_rows(t, 0.0, 1.0, short_last=True) == [(0, 2500)]
    every = window_rows(t, 30.0, 1e-9, short_last=False)  # one per sample at most, the last one within a sample
    assert [first for first, _ in every] == list(range(2202))


def test_heading_errors_are_wrapped() -> None:
    error = wrapped_error(np.array([[0, 0, 3.1, 0, 0, 0.0]]), np.array([[0, 0, -3.1, 0, 0, 0.0]]))
    assert error[0, 2] == pytest.approx(6.2 - 2 * np.pi)


def test_the_true_ship_predicts_its_own_noise_free_run() -> None:
    ship = hidden_ship()
    trial = simulate(ship, parse_maneuver("zigzag:20/20", ship, n=10.0, duration=90.0))
    result = score(Simulator(ship), [trial])
    assert result.window < 1e-8 and result.paper < 1e-8
    assert score(model(), [trial]).window > 1e3 * result.window


def test_the_pooled_score_is_the_mean_over_rows_and_sigma_scales_it() -> None:
    trials = list(runs()[1])
    sigma = pooled_sigma(trials)
    both = score(model(), trials, sigma)
    single = [score(model(), [t], sigma) for t in trials]
    rows = [s.trials[0].windows * 300 for s in single]
    assert both.window == pytest.approx(np.average([s.window for s in single], weights=rows))
    assert score(model(), trials, 2 * sigma).paper == pytest.approx(both.paper / 4)


def test_a_window_across_missing_samples_is_left_out_and_said() -> None:
    trial = runs()[1][0]
    u = trial["u"].copy()
    u[500:510] = np.nan
    windows, notes = predict(model(), trial.with_columns(u=u), 30.0, 15.0, False)
    assert notes and windows
    assert all(not (w.first <= 505 <= w.last) for w in windows)


def test_a_score_with_a_number_of_windows_that_is_none_is_refused() -> None:
    """Of a result file that says 1e999 windows (found by the fuzzer)."""
    by_state = dict.fromkeys(("x", "y", "psi", "u", "v", "r"), 1.0)
    trial = {"name": "a", "paper": 1.0, "paper_by_state": by_state, "window": 1.0, "window_by_state": by_state}
    row = {"sigma": by_state, "sigma_from": "these", "paper": 1.0, "window": 1.0, "notes": []}
    assert adapter(Score).validate_python(row | {"trials": [trial | {"windows": 3}]}).trials[0].windows == 3
    with pytest.raises(ValueError):
        adapter(Score).validate_python(row | {"trials": [trial | {"windows": float("inf")}]})


def test_scores_need_positions() -> None:
    trial = runs()[1][0]
    blind = Trial("blind", {k: v for k, v in trial.columns.items() if k not in ("x", "y")})
    with pytest.raises(UserError, match="position"):
        score(model(), [blind], np.ones(6))


def test_the_force_of_a_network_with_added_masses_that_couple_sway_and_yaw() -> None:
    """It is her masses times the accelerations that the network adds: all forces together move her as the hybrid."""
    ship = load_ship("mariner")
    hybrid = ship.with_network(random_network(ship))
    trial = simulate(ship, parse_maneuver("zigzag:20/20", ship, duration=60.0), dt=1.0)
    simulator, record = Simulator(hybrid, compiled=False), record_of(trial, ship.inputs)
    mass = inertia(ship.namespace, type(ship.namespace)(**{s: c.value for s, c in ship.coefficients.items()}))
    assert mass.y_r and mass.n_v
    forces = forces_along(simulator, trial)
    expected = simulator.rates(record.states.T, record.controls.T)[3:6]
    found = accelerations(*trial.states[:, 3:].T, Force(*sum(forces.values()).T), mass)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert np.abs(forces[NETWORK]).min(axis=0).max() > 0


# Errors in units: by hand over windows, of figures, of large ships, and by run in reports and on the console
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
        errors = np.array([w.error(trial.states) for w in windows])
        rms = np.sqrt((errors[:, 1:] ** 2).mean(axis=(0, 1)))
        assert run.windows == len(windows) and run.share_of_change > 0
        assert run.position_m == pytest.approx(math.hypot(*rms[:2]))
        assert (run.heading_deg, run.r_deg_s) == pytest.approx(np.degrees(rms[[2, 5]]))
        assert run.u_m_s == pytest.approx(rms[3])
        row = round(found.seconds["ship_length"] / trial.dt)
        early, last = (np.sqrt((errors[:, at] ** 2).mean(axis=0)) for at in (row, -1))
        assert run.heading_end_deg == pytest.approx(math.degrees(last[2]))
        assert run.after["ship_length"].v_m_s == pytest.approx(early[4])
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
    after, by_run = pair.messages("validation")
    assert (after.code, by_run.code) == ("worse_after", "worse_runs") and "turning_35" in by_run
    assert ScorePair(bad, good).messages("validation") == []
    braked = score(Simulator(ship.with_values({"X_0F": -0.09})), trials, sigma, units=0.0)
    assert "worse_than_persistence" in {m.code for m in score_messages({"validation": ScorePair(good, braked)})}


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

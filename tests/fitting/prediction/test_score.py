"""Predictions and the two metrics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.io import published_splits as splits
from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import simulate
from cases.trial import Trial, left_out
from fitting.nlp.windows import Stretch
from fitting.prediction.predict import forces_along, predict, record_of, window_rows
from fitting.prediction.score import (
    NOTHING,
    Score,
    check_scorable,
    in_words,
    pooled_sigma,
    score,
    score_pairs,
    scores_by_set,
)
from fitting.prediction.stretches import wrapped_error
from fitting.report.run_folder import adapter, plain
from mmg.components.rigid_body import accelerations, inertia
from mmg.errors import TooFewData, UserError
from mmg.model import NETWORK
from mmg.motion.flow import Force
from mmg.rollout import Simulator
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
    (message,) = worse.failed("a")
    assert message.code == "no_score" and trials[0].name in message and better["a"].failed("a") == []
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

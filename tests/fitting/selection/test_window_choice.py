"""Windows follow from the horizon: those with which runs left out are predicted best over it, clear gains only."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.calibrate import FitOptions, calibrate
from fitting.calibration import Calibration, estimate_coefficients
from fitting.selection import window_choice
from fitting.selection.window_choice import candidates_for, choose_window, errors_over, worse_kind
from fitting.settings import Settings
from mmg.messages import has_code
from mmg.ship import Ship

FREE = ("X_0F", "Y_v", "N_r")


def ship() -> Ship:
    start = load_ship("esso_osaka_3m")
    return start.fixing([s for s in start.symbols if s not in FREE])


@cache
def trials() -> tuple[Trial, ...]:
    return tuple(demo_trials(3, dt=0.5)[0][:5])


@cache
def found() -> Calibration:
    return estimate_coefficients(ship(), trials(), Settings(horizon=80.0, passes=2))


@pytest.mark.parametrize(
    ("horizon", "step", "expected"),
    [(60.0, 0.3, [60, 30, 15]), (100.0, 1.0, [100, 50]), (200.0, 1.0, [200, 100, 50]),
     (300.0, 1.0, [300, 150, 100, 50]), (30.0, 1.0, [30, 100, 50])],
)  # fmt: skip
def test_the_usual_windows_and_half_of_either_are_tried(horizon: float, step: float, expected: list[float]) -> None:
    assert candidates_for(Settings(horizon=horizon, step=step)) == pytest.approx(expected)


def test_errors_are_those_of_predictions_over_the_horizon_by_estimates_without_the_run() -> None:
    near, far = (errors_over(found(), trials(), horizon) for horizon in (20.0, 80.0))
    assert np.isfinite(near).all() and (near < far).all(), "errors grow with the horizon"
    long = errors_over(found(), trials(), 1e4)
    assert np.isnan(long).all(), "no run holds such a window"


@pytest.mark.parametrize(
    ("factor", "window"), [([0.9, 0.91, 0.92, 0.9, 0.91], 40.0), ([0.5, 1.4, 1.5, 0.6, 1.0], 80.0), ([1.1] * 5, 80.0)]
)
def test_clearly_better_windows_are_taken_and_said(
    factor: list[float], window: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def errors(calibration: Calibration, runs: object, horizon: float) -> np.ndarray:
        better = calibration.settings.window == pytest.approx(40.0)
        return np.array([1.0, 1.1, 1.2, 1.3, 1.4]) * (factor if better else 1.0)

    monkeypatch.setattr(window_choice, "errors_over", errors)
    chosen = choose_window(found(), ship(), trials())
    (message,) = (m for m in chosen.notices if has_code([m], "window_chosen"))
    assert chosen.settings.window == window and chosen.settings.horizon == 80.0
    assert message.startswith(f"windows of {window:g} s for predictions over 80 s")


def test_of_three_runs_nothing_is_chosen() -> None:
    assert choose_window(found(), ship(), trials()[:3]) is found()


def test_a_kind_that_becomes_worse_forbids_other_windows() -> None:
    kinds = ("zigzag", "zigzag", "turning", "turning", "turning")
    runs = [replace(t, kind=kind) for t, kind in zip(trials(), kinds, strict=True)]
    before, after = np.ones(5), np.array([0.5, 0.5, 1.1, 1.11, 1.09])
    assert worse_kind(before, after, runs) == "turning" and worse_kind(before, np.full(5, 0.9), runs) == ""


def test_a_fit_for_a_horizon_says_its_windows_and_one_with_windows_does_not_ask() -> None:
    options = FitOptions(next_trial=False, instruments=(), per_campaign=("none",))
    asked = calibrate(ship(), trials(), (), Settings(horizon=80.0, passes=2), options)
    assert "window_chosen" in {m.code for m in asked.messages} and asked.settings.window in (80.0, 40.0, 50.0, 25.0)
    given = calibrate(ship(), trials(), (), Settings(horizon=80.0, window=80.0, passes=2), options)
    assert "window_chosen" not in {m.code for m in given.messages}

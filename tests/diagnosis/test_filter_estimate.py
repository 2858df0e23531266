"""Coefficients by a Kalman filter for a calibration: what they are, and why there may be none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import diagnosis.for_calibration as module
from cases.trial import Trial
from diagnosis.estimation.random_states import Noise
from diagnosis.for_calibration import second_estimate
from fitting.calibrate import FitOptions
from fitting.selection.left_out_runs import coefficients_without, each_alone
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.ship import Ship
from mmg_ident import calibrate
from tests.support.diagnosis_cases import FEW, SHIP, pushed_trials, quiet

TRUE = {"X_0F": 1.1, "N_r": 0.95}
"""True coefficients over those of the ship that is fitted."""


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    """Runs of a ship whose coefficients are off, with random forces and sensor noise."""
    ship = SHIP.with_values({s: f * SHIP.coefficients[s].value for s, f in TRUE.items()})
    return pushed_trials(7, ship=ship)


def filter_estimate(ship: Ship, trials: list[Trial]) -> Mapping[str, float] | str:
    """Values by symbol, or why there are none."""
    return second_estimate(ship, trials).values


@pytest.mark.slow
def test_it_finds_the_coefficients_of_a_ship_that_is_pushed_about(trials: list[Trial]) -> None:
    found = filter_estimate(FEW, trials)
    assert not isinstance(found, str) and set(found) == set(FEW.free)
    for s, factor in TRUE.items():
        c = SHIP.coefficients[s]
        assert abs(found[s] - factor * c.value) < 0.5 * abs(factor - 1) * abs(c.value) + 0.2 * c.std


@pytest.mark.slow
def test_the_priors_are_those_of_the_calibration_at_hand_not_of_one_before_it(trials: list[Trial]) -> None:
    c = FEW.coefficients["N_r"]
    sure = FEW.with_coefficients({"N_r": c.with_(std=1e-4 * c.std, prior_value=3 * c.value, prior_std=c.std)})
    found = filter_estimate(sure, trials)
    assert not isinstance(found, str) and found["N_r"] == pytest.approx(c.value, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("can_be_fitted", [True, False])
def test_many_trials_begin_at_the_fit_of_a_few(
    can_be_fitted: bool, trials: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From there the fit of all comes to the same estimates, within what its tolerance leaves of their errors (0.32
    standard errors, which are 0.13 to 0.9 of the priors here), and what the correlation time of the few makes of them.
    Where the few cannot be fitted, all are.
    """
    whole, fitted, prepare = filter_estimate(FEW, trials), [], module.prepare

    def noted(*given: Any, **more: Any) -> Any:
        fitted.append(len(given[1]))
        if not can_be_fitted and len(given[1]) < len(trials):
            raise UserError("too short")
        return prepare(*given, **more)

    monkeypatch.setattr(module, "prepare", noted)
    monkeypatch.setattr(module, "FEW", 200)
    found = filter_estimate(FEW, trials)
    assert 0 < fitted[0] < len(trials) and fitted[1:] == [] if can_be_fitted else fitted[1:] == [len(trials)]
    assert not isinstance(found, str) and not isinstance(whole, str) and set(found) == set(whole)
    for s, value in whole.items():
        assert abs(found[s] - value) <= (0.15 if can_be_fitted else 0.0) * SHIP.coefficients[s].std


def test_it_says_why_there_is_no_estimate(trials: list[Trial], monkeypatch: pytest.MonkeyPatch) -> None:
    still = [replace(t, columns={**t.columns, "n": 0 * t["n"] + 10.0, "delta": 0 * t["delta"]}) for t in trials]
    found = filter_estimate(FEW, still)
    assert isinstance(found, str)
    monkeypatch.setattr(module, "MOST", 100)
    much = filter_estimate(FEW, trials)
    assert isinstance(much, str) and "memory" in much


@pytest.mark.slow
def test_a_calibration_is_the_mean_of_both(trials: list[Trial]) -> None:
    options = FitOptions(next_trial=False, instruments=(), per_campaign=("none",))
    settings = Settings(loss="gaussian", weight=1.0, passes=2)
    alone = calibrate(FEW, trials, settings=settings, options=replace(options, estimator="windows"))
    both = calibrate(FEW, trials, settings=settings, options=options)
    other = filter_estimate(FEW, trials)
    assert not isinstance(other, str)
    for s in FEW.free:
        mean = 0.5 * (alone.ship.coefficients[s].value + other[s])
        c = both.ship.coefficients[s]
        assert c.value == pytest.approx(np.clip(mean, c.lower, c.upper), rel=1e-6)
        assert c.std >= alone.ship.coefficients[s].std
    known, how = both.to_dict()["random_force"], quiet()
    assert "random_force" not in alone.to_dict()
    assert Noise.of(known, both.ship).force == pytest.approx([known[s] for s in "XYN"])
    assert all(0.3 < known[s] / true < 3 for s, true in zip("XYN", (how.X, how.Y, how.N), strict=True))
    codes = [{m["code"] for m in result.to_dict()["messages"]} for result in (alone, both)]
    assert "two_estimates" not in codes[0] and "two_estimates" in codes[1]
    assert alone.objects is not None and both.objects is not None
    first, mean = alone.objects.calibration, both.objects.calibration
    at = [first.ship.symbols.index(s) for s in first.prior.symbols]
    folds = each_alone(len(both.objects.trials))
    moved = [coefficients_without(c, folds)[:, at] / first.prior.std for c in (first, mean)]
    assert np.isfinite(moved[0]).all()  # without a run the second estimate keeps its distance
    np.testing.assert_allclose(moved[1] - moved[0], np.tile(mean.p - first.p, (len(trials), 1)), atol=1e-6)

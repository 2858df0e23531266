"""Figures by model and tests: what is measured, how it is weighed, and how often the intervals hold the truth."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from cases.criteria import imo
from cases.criteria.standard_runs import simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import Wind
from cases.trial import Trial
from fitting.prediction.figure_intervals import with_intervals
from fitting.prediction.tested_figures import (
    FIGURES,
    SCATTER,
    MeasuredManeuver,
    WeighedFigures,
    measured_maneuvers,
    weighed,
)
from mmg.ship import Ship
from tests.fitting.prediction.test_figure_intervals import content, some_ship

SPEED = 0.5
RUNS = tuple(
    f"{kind}:{side}{angles}" for kind, angles in (("turning", "35"), ("zigzag", "10/10")) for side in ("", "-")
)
KEYS = [(run, f) for run in RUNS for f in (FIGURES[:3] if run.startswith("turning") else FIGURES[3:5])]


def log_of(ship: Ship, order: str, wind: Wind | None = None) -> Trial:
    plan = parse_maneuver(order, ship, speed=SPEED)
    return simulated_trial(ship, plan, wind=wind, dt=0.1)


def test_a_test_in_wind_current_and_with_an_antenna_is_that_of_still_water_and_calm_air() -> None:
    ship = load_ship("esso_osaka_3m")
    seen = ship.with_effect("current", {"x": 0.03, "y": -0.02}).with_effect("antenna_offset", {"x": -0.9, "y": 0.2})
    calm, windy = log_of(ship, "turning:35"), log_of(seen, "turning:35", Wind(1.0, 0.7))
    (plain,), (one,) = measured_maneuvers(ship, [calm]), measured_maneuvers(seen, [windy])
    assert one.maneuver == "turning:35" and one.speed == pytest.approx(SPEED, rel=0.02)
    assert one.wind == pytest.approx((1.0, 0.7), abs=0.02) and plain.wind == (0.0, 0.0)
    modelled = one.modelled(ship)
    for figure, value in one.figures.items():
        alone = plain.figures[figure]
        assert alone * value / modelled[figure] == pytest.approx(plain.modelled(ship)[figure], rel=0.02)
        assert abs(value / alone - 1) > 0.01 or figure == "initial_turning_track"  # the wind is felt
    assert MeasuredManeuver.of(json.loads(json.dumps(asdict(one)))) == one


def coverage(form: float, claimed: float, scatter: float, seed: int) -> tuple[float, float]:
    """Share of 90 % intervals that hold the truth, and the rms error by that of the model, of ships whose model errs
    by ``form``, common to both sides, and says ``claimed``; tests scatter by ``scatter``."""
    rng, inside, errors = np.random.default_rng(seed), [], []
    for number in range(300):
        kinds = {key[0].replace(":-", ":"): rng.standard_normal() for key in KEYS}
        off = {key: form * kinds[key[0].replace(":-", ":")] for key in KEYS}
        draws: dict[str, dict[str, np.ndarray]] = {}
        for key in KEYS:
            normal = rng.standard_normal(400)
            draws.setdefault(key[0], {})[key[1]] = np.exp(off[key] + claimed * (normal - normal.mean()))
        ratios = {key: [(scatter * rng.standard_normal() - off[key], 0.0)] for key in KEYS}
        told = weighed(ratios, draws)
        for run, figure in KEYS:
            x = np.log(told.of(run, draws[run], number)[figure])
            inside.append(abs(np.median(x)) < 0.5 * np.ptp(np.quantile(x, (0.05, 0.95))))
            errors.append(np.median(x))
    return float(np.mean(inside)), float(np.std(errors)) / form


@pytest.mark.parametrize(("form", "claimed", "scatter"), [(0.05, 0.05, 0.03), (0.2, 0.05, 0.03), (0.05, 0.05, 0.12)])
def test_intervals_hold_the_truth_whatever_is_wrong(form: float, claimed: float, scatter: float) -> None:
    """Model and scatter as they say; a model four times as wrong as it says; tests that scatter four times as much."""
    share, error = coverage(form, claimed, scatter, 5)
    assert (0.84 if scatter < form else 0.78) < share < 0.97
    assert error < (0.75 if scatter < form else 1.2)  # better than the model, or little worse where tests scatter


def test_figures_without_a_test_grow_by_the_ratio_alone() -> None:
    rng = np.random.default_rng(1)
    draws = {run: {"advance": np.exp(0.02 * rng.standard_normal(500))} for run in ("turning:35", "turning:-35")}
    told = weighed({("turning:35", "advance"): [(0.2, 0.0)]}, draws)
    own, other = (np.log(told.of(run, draws[run], 0)["advance"]) for run in draws)
    assert told.birge == pytest.approx(0.2 / math.hypot(0.02, SCATTER), rel=0.05)
    weight = 1 / (1 + (SCATTER / (told.birge * 0.02)) ** 2)
    assert np.median(own) == pytest.approx(0.2 * weight, abs=0.01) and weight > 0.8
    assert np.median(other) == pytest.approx(0.0, abs=0.01)
    assert other.std() == pytest.approx(told.birge * 0.02, rel=0.1) and own.std() < other.std()
    never = {"turning:35": {"advance": np.array([1.0, np.nan, 1.1])}}  # a figure that some draws do not reach
    assert weighed({("turning:35", "advance"): [(0.2, 0.0)]}, never) == WeighedFigures()
    assert np.array_equal(told.of("turning:35", never["turning:35"], 0)["advance"], [1.0, np.nan, 1.1], equal_nan=True)


@pytest.mark.slow
def test_tests_correct_a_model_of_another_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sea trials of another ship beside the model: her figures come out, in narrower intervals."""
    monkeypatch.setattr(imo, "STANDARD", ("turning:35", "zigzag:10/10"))
    ship: Any = some_ship()
    rows = {s: ship.coefficients[s] for s in ("Y_v", "N_r")}
    other = ship.with_coefficients({s: c.with_(value=0.85 * c.value) for s, c in rows.items()})
    trials = [log_of(other, order) for order in imo.STANDARD]
    tests = [asdict(one) for one in measured_maneuvers(ship, trials)]
    judged = with_intervals(imo.imo_figures(ship, SPEED), ship, {**content(ship), "tests": tests}, 50)
    truth = {(row.run, row.figure): row.value for row in imo.imo_figures(other, SPEED).rows}
    alone = {(row.run, row.figure): row for row in judged.by_model}
    rows_ = [row for row in judged.rows if row.figure in FIGURES]
    assert len(rows_) == 6 and judged.notices[-1].code != "" and judged.by_model
    off = np.array([(row.value, alone[row.run, row.figure].value, truth[row.run, row.figure]) for row in rows_])
    error, before = (np.sqrt(np.mean((off[:, k] / off[:, 2] - 1) ** 2)) for k in (0, 1))
    assert before > 0.05 and error < 0.7 * before
    for row in rows_:
        assert row.by_model == alone[row.run, row.figure].value
    at_another_speed = [{**one, "speed": 2 * one["speed"]} for one in tests]
    as_before = with_intervals(imo.imo_figures(ship, SPEED), ship, {**content(ship), "tests": at_another_speed}, 50)
    assert as_before.rows == as_before.by_model

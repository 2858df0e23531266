"""Prediction bands: they hold nine tenths of the errors where the truth is known, and are stored and written."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

from cases.simulation.demo_trials import hidden_ship
from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.band_calibration import NORMAL, fit_bands, sample_noise
from fitting.prediction.bands import Bands, bands_of, correlation_in, draws_of, velocity_variance
from fitting.prediction.predict import predict, predict_all, record_of
from fitting.prediction.stretches import WindowBatch
from mmg.rollout import Simulator
from mmg.states import STATES
from tests.support.disturbed_trials import Disturbed, disturbed_trials

RUNS = (("zigzag:20/20", 100.0), ("turning:35", 120.0), ("random:11", 120.0), ("random:12", 120.0), ("berthing", 120.0))


@cache
def simulator() -> Simulator:
    return Simulator(hidden_ship())


@cache
def trials(seed: int) -> tuple[Trial, ...]:
    """Runs of the true ship, pushed by random forces."""
    return tuple(disturbed_trials(hidden_ship(), RUNS, seed, Disturbed(defects=()), dt=0.2))


@cache
def fitted() -> Any:
    return fit_bands(simulator(), trials(1))


def bands(**more: object) -> Any:
    return bands_of({"bands": fitted(), **more}, simulator().ship)


@pytest.mark.slow
@pytest.mark.parametrize(("length", "least", "most"), [(30.0, 0.84, 0.97), (60.0, 0.78, 0.99)])
def test_bands_hold_nine_tenths_of_the_errors_of_other_runs(length: float, least: float, most: float) -> None:
    """They grow with time from nothing."""
    inside = []
    predicted = predict_all(simulator(), trials(2), length, length / 2, bands=bands())
    for trial, (windows, _) in zip(trials(2), predicted, strict=True):
        for w in windows:
            inside.append(np.abs(w.error(trial.states)[1:]) < NORMAL * w.std[1:])
            assert (w.std[0] == 0).all() and (w.std[1:] > 0).all()
        early, middle, late = (np.mean([w.std[row] for w in windows], axis=0) for row in (5, 25, 100))
        assert (late > early).all() and (late[:3] > middle[:3]).all()
    share = np.vstack(inside).mean(axis=0)
    assert (share > least).all() and (share < most).all(), share


def test_prediction_is_the_same_with_and_without_bands() -> None:
    with_bands, _ = predict(simulator(), trials(2)[0], 30.0, 15.0, bands=bands())
    without, _ = predict(simulator(), trials(2)[0], 30.0, 15.0)
    for a, b in zip(with_bands, without, strict=True):
        np.testing.assert_array_equal(a.states, b.states)
        assert b.std is None


def test_uncertain_coefficients_widen_the_bands_alike_without_compiled_code() -> None:
    """There the draws are simulated side by side."""
    symbols = ["Y_v", "N_r"]
    rows = {s: {"std": 0.5 * abs(simulator().ship.coefficients[s].value)} for s in symbols}
    sure = bands()
    unsure = bands(coefficients=rows, correlation={"symbols": symbols, "matrix": [[1.0, 0.5], [0.5, 1.0]]})
    plain = Simulator(hidden_ship(), compiled=False)
    assert sure.root.shape[1] == 0 and unsure.root.shape[1] > 1 and plain.is_stepwise
    cases = ((simulator(), sure), (simulator(), unsure), (plain, unsure))
    narrow, wide, same = (predict(s, trials(2)[1], 30.0, 30.0, bands=b)[0][0].std for s, b in cases)
    assert (wide[-1] > narrow[-1]).all()
    np.testing.assert_allclose(same, wide, rtol=1e-7, atol=1e-9)


def test_the_variance_by_coefficients_is_that_of_steps_from_row_to_row() -> None:
    """It is taken in steps between the rows at which it is wanted, which is 5 samples here: to a few per cent."""
    ship, record = hidden_ship(), record_of(trials(1)[0], hidden_ship().inputs)
    batch = WindowBatch.of([Stretch(record, first, first + last) for first, last in ((0, 300), (40, 297), (100, 250))])
    rows = np.unique([*range(0, 301, 5), 300])
    coarse = batch.between(rows)
    assert coarse.steps.shape == (60, 3)
    np.testing.assert_allclose(coarse.times, batch.times[rows])
    moved = (batch.inputs * batch.steps[:, None]).sum(axis=0)
    np.testing.assert_allclose((coarse.inputs * coarse.steps[:, None]).sum(axis=0), moved, atol=1e-9)
    rng, at = np.random.default_rng(3), [ship.symbols.index(s) for s in ("Y_v", "N_r", "t_R", "w_P0")]
    root = np.zeros((len(ship.symbols), 8))
    root[at] = 0.05 * ship.values[at][:, None] * rng.normal(size=(4, 8))
    known = Bands(bands().process, root)
    found = known.coefficient_variance(simulator(), batch, rows)
    exact = known.coefficient_variance(simulator(), batch, np.arange(301))[rows]
    assert found.shape == (61, 6, 3) and exact[-1].min() > 0
    np.testing.assert_allclose(np.sqrt(found.mean(axis=(0, 2))), np.sqrt(exact.mean(axis=(0, 2))), rtol=0.03)


def test_draws_have_the_covariance_that_was_stored() -> None:
    ship = simulator().ship
    rows = {"Y_v": {"std": 0.02}, "N_r": {"std": 0.01}}
    correlation = {"symbols": ["Y_v", "N_r"], "matrix": [[1, 1], [1, 1]]}
    root = draws_of({"coefficients": rows, "correlation": correlation}, ship)
    a, b = root[ship.symbols.index("Y_v")], root[ship.symbols.index("N_r")]
    np.testing.assert_allclose(a, 2 * b)
    assert 0.01 < a.std() < 0.03
    assert np.count_nonzero(root.any(axis=1)) == 2
    for unknown in (None, {"symbols": ["a", "b"], "matrix": [[1.0, None], [0.5, 1.0]]}):
        assert correlation_in({"correlation": unknown}) is None


def test_variance_of_the_process_agrees_with_a_simulation_of_it() -> None:
    memory, decay, dt, steps, count = 3.0, 8.0, 0.05, 400, 4000
    rng = np.random.default_rng(0)
    left = np.exp(-dt / memory)
    a, e = rng.standard_normal(count), np.zeros(count)
    for _ in range(steps):
        e += dt * (a - e / decay)
        a = left * a + np.sqrt(1 - left**2) * rng.standard_normal(count)
    expected = velocity_variance(np.ones((41, 1)), np.full((40, 1), 0.5), memory, decay)[-1, 0]
    assert e.var() == pytest.approx(expected, rel=0.08)


def test_noise_of_samples_is_found_under_smooth_motion() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0, 200, 0.1)
    columns = {"t": t, "psi": 0.5 * np.sin(0.1 * t) + 0.01 * rng.standard_normal(len(t))}
    columns |= {name: np.cos(0.1 * t) + 0.02 * rng.standard_normal(len(t)) for name in ("x", "y", "u", "v", "r")}
    columns |= {"n": np.ones_like(t), "delta": np.zeros_like(t)}
    found = sample_noise([Trial("noisy", columns)])
    np.testing.assert_allclose(found, [0.02, 0.02, 0.01, 0.02, 0.02, 0.02], rtol=0.15)


def test_what_is_stored_is_plain_and_too_few_windows_give_no_bands() -> None:
    text = json.loads(json.dumps(fitted()))
    assert set(text["factor"]) == set(STATES) == set(text["noise"])
    assert bands_of({"bands": {}}, simulator().ship) is None and bands_of({}, simulator().ship) is None
    short = Trial("short", {name: values[:100] for name, values in trials(1)[0].columns.items()})
    assert fit_bands(simulator(), [short]) is None

"""Forecasts of black boxes: what they read of a trial, and where their windows begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.prediction.predict import predict_all, record_of
from fitting.prediction.stretches import Stretch
from residual.blackbox.models import BlackBox, gridded
from residual.rollout import rollout
from tests.residual.blackbox.test_models import QUICK, box, runs


def test_predictions_do_not_depend_on_what_comes_after_their_window_or_long_before() -> None:
    system = box("rnn-window", memory=3)
    black = BlackBox(replace(QUICK, kind="rnn-window"), ("n", "delta"), 1.0, (system,))
    trial = runs()[0]
    changed = {c: np.where((trial.t > 130) | (trial.t < 90), 0.3, trial[c]) for c in ("u", "v", "r", "delta")}
    other = trial.with_columns(**changed)
    stretches = [Stretch(record_of(t, black.inputs), 100, 130) for t in (trial, other)]
    a, b = (black.forecast([s]) for s in stretches)
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(a[0, :, 0], trial.states[100])
    before = other.with_columns(u=np.where(trial.t == 99, 0.0, trial["u"]))
    assert np.abs(black.forecast([Stretch(record_of(before, black.inputs), 100, 130)]) - a).max() > 1e-6


def test_a_forecast_at_other_samples_is_the_rollout_between() -> None:
    system = box("fnn")
    black, trial = BlackBox(QUICK, ("n", "delta"), 2.0, (system,)), runs()[1]
    stretch = Stretch(record_of(trial, black.inputs), 20, 61)
    out = black.forecast([stretch])
    batch = gridded([stretch], 2.0, 0)
    assert len(batch.controls) == 21 and out.shape == (42, 6, 1)
    np.testing.assert_allclose(
        batch.controls[3, :2, 0].numpy(), np.mean([trial["n"][26:28], trial["delta"][26:28]], axis=1)
    )
    path = rollout(system, batch).detach().numpy()
    np.testing.assert_allclose(out[2::2, :, 0], path[1:21, :, 0], atol=1e-12)
    np.testing.assert_allclose(out[1, :, 0], path[:2, :, 0].mean(axis=0), atol=1e-12)


def test_a_start_with_too_few_rows_before_it_uses_the_oldest() -> None:
    trial = runs()[0]
    record = record_of(trial, ("n", "delta", "wind_north", "wind_east"))
    past = gridded([Stretch(record, 0, 10), Stretch(record, 2, 10), Stretch(record, 50, 60)], 1.0, 4).past
    assert past is not None
    np.testing.assert_allclose(past.logged[:, :, 0].numpy(), np.tile(trial.states[0], (4, 1)))
    np.testing.assert_allclose(past.logged[:, :, 1].numpy(), trial.states[[0, 0, 0, 1]])
    np.testing.assert_allclose(past.logged[:, :, 2].numpy(), trial.states[46:50])
    np.testing.assert_allclose(past.controls[:, 0, 2].numpy(), trial["n"][46:50])


def test_rows_before_a_gap_are_not_read() -> None:
    trial = runs()[0].with_columns(u=np.where(np.arange(201) == 48, np.nan, runs()[0]["u"]))
    past = gridded([Stretch(record_of(trial, ("n", "delta", "wind_north", "wind_east")), 50, 60)], 1.0, 4).past
    assert past is not None
    np.testing.assert_allclose(past.logged[:, :, 0].numpy(), np.tile(trial.states[49], (4, 1)))


def test_windows_of_a_black_box_are_those_of_a_ship() -> None:
    black = BlackBox(QUICK, ("n", "delta"), 1.0, (box("fnn"),))
    (found, notes), *_ = predict_all(black, runs()[:1], 30.0, 15.0, False)
    assert [w.first for w in found] == list(range(0, 171, 15)) and not notes

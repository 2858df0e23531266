"""Grids, windows and intervals: what is kept, what is dropped, and what is said about it."""

from __future__ import annotations

import numpy as np
import pytest

from cases.inputs import step_means
from cases.trial import Trial
from fitting.nlp.windows import cut, default_step, pieces_of
from mmg.errors import Missing, TooFewData
from tests.support.trial_files import make_trial, motion_columns


def test_step_means_integrate_held_samples_exactly() -> None:
    t = np.array([0.0, 0.4, 1.0, 1.7, 2.0])
    values = np.array([[1.0], [2.0], [4.0], [8.0], [0.0]])
    means = step_means(t, values, np.array([0.0, 1.0, 2.0]))
    assert means[:, 0] == pytest.approx([0.4 * 1 + 0.6 * 2, 0.7 * 4 + 0.3 * 8])


def test_every_measured_grid_sample_is_used_once_and_intervals_chain_within_a_window() -> None:
    seg = cut([make_trial()], 1.0, 50.0, 7)
    windows = len(seg.run)
    samples = seg.node_mask[:, 0].sum() + seg.mask[:, 0].sum()
    assert samples == seg.steps.sum() + windows  # N steps of a window have N + 1 samples
    assert (np.diff(seg.steps) <= 0).all()
    assert seg.steps.sum() * seg.h == pytest.approx(seg.duration)
    for w in range(windows):
        mine = np.flatnonzero(seg.window == w)
        order = mine[np.argsort(seg.start[mine])]
        assert (seg.end[order[:-1]] == seg.start[order[1:]]).all()


def test_a_gap_splits_a_run_and_nothing_is_invented_across_it() -> None:
    columns = motion_columns()
    keep = np.ones(len(columns["t"]), dtype=bool)
    keep[1000:1200] = False
    trial = Trial("gap", {k: v[keep] for k, v in columns.items()})
    parts = pieces_of([trial], 1.0)
    assert len(parts) == 2
    assert parts[0].t[-1] <= columns["t"][999] and parts[1].t[0] >= columns["t"][1200]
    empty = columns["u"].copy()
    empty[1000:1100] = np.nan  # rows without a number split a run as well
    assert len(pieces_of([Trial("nan", {**columns, "u": empty})], 1.0)) == 2


def test_missing_positions_stay_missing_and_pin_the_start() -> None:
    columns = {k: v for k, v in motion_columns().items() if k not in ("x", "y")}
    seg = cut([Trial("no position", columns)], 1.0, 50.0, 5)
    assert seg.node_mask[:, :2].sum() == 0 and seg.node_mask[:, 2:].all()


def test_a_clock_that_does_not_start_at_zero_changes_nothing() -> None:
    columns = motion_columns()
    late = Trial("late", {**columns, "t": columns["t"] + 3223.7})
    a, b = cut([make_trial()], 1.0, 50.0, 5), cut([late], 1.0, 50.0, 5)
    np.testing.assert_allclose(a.nodes, b.nodes, atol=1e-9)
    np.testing.assert_allclose(a.controls, b.controls, atol=1e-9)


def test_uneven_sampling_gives_the_same_grid_within_interpolation() -> None:
    columns = motion_columns()
    keep = np.random.default_rng(1).random(len(columns["t"])) < 0.7
    keep[0] = True
    trial = Trial("uneven", {k: v[keep] for k, v in columns.items()})
    a, b = pieces_of([make_trial()], 1.0)[0], pieces_of([trial], 1.0)[0]
    count = min(len(a.t), len(b.t))
    np.testing.assert_allclose(a.logged[:count, :2], b.logged[:count, :2], atol=2e-3)


def test_a_record_that_is_too_short_and_twin_rudders_are_refused_with_a_reason() -> None:
    columns = motion_columns()
    with pytest.raises(TooFewData):
        cut([Trial("short", {k: v[:20] for k, v in columns.items()})], 1.0, 50.0, 5)
    del columns["delta"]
    with pytest.raises(Missing):
        cut([Trial("twin", {**columns, "delta_port": columns["n"], "delta_starboard": columns["n"]})], 1.0, 50.0, 5)


def test_the_default_step_follows_froude_scaling() -> None:
    trial = make_trial()
    large = Trial("large", {**trial.columns, "t": trial.t * 10, "u": trial["u"] * 10, "v": trial["v"] * 10})
    assert default_step([large], 300.0) / default_step([trial], 3.0) == pytest.approx(10, rel=0.01)


def test_a_subset_of_windows_keeps_their_data() -> None:
    seg = cut([make_trial()], 1.0, 50.0, 7)
    part = seg.subset(np.array([1, 3]))
    assert len(part.run) == 2
    one = np.flatnonzero(part.window == 1)
    same = np.flatnonzero(seg.window == 3)
    np.testing.assert_array_equal(part.nodes[part.start[one]], seg.nodes[seg.start[same]])
    np.testing.assert_array_equal(part.controls[:, :, one], seg.controls[:, :, same])

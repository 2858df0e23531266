"""Intervals on disturbed synthetic trials hold the truth where those of the model alone do not."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import TRAIN
from tests.support.disturbed_trials import Disturbed, disturbed_trials, drawn_ship, process


def test_the_process_has_its_size_and_memory() -> None:
    d = process(200_000, 0.1, 5.0, np.random.default_rng(0))
    assert d.std() == pytest.approx(1.0, abs=0.05)
    assert np.mean(d[:-50] * d[50:]) == pytest.approx(np.exp(-1.0), abs=0.06)


def test_a_drawn_ship_lies_within_its_bounds_and_spreads_like_the_prior() -> None:
    base = load_ship("esso_osaka_3m")
    z = []
    for seed in range(20):
        true = drawn_ship(base, seed)
        for s in base.free:
            c = base.coefficients[s]
            assert c.lower < true.coefficients[s].value < c.upper
            z.append((true.coefficients[s].value - c.value) / c.std)
    assert np.std(z) == pytest.approx(1.0, abs=0.1)


def test_forces_and_defects_show_in_the_logged_columns() -> None:
    ship = load_ship("esso_osaka_3m")
    calm = Disturbed(X=1e-9, Y=1e-9, N=1e-9, defects=())
    worse = {"forces": Disturbed(defects=()), "defects": Disturbed(X=1e-9, Y=1e-9, N=1e-9)}
    (clean,) = disturbed_trials(ship, [("turning:35", 60.0)], 1, calm)
    for how in worse.values():
        (bad,) = disturbed_trials(ship, [("turning:35", 60.0)], 1, how)
        assert np.hypot(bad["x"] - clean["x"], bad["y"] - clean["y"]).max() > 5 * calm.noise.x
    again = disturbed_trials(ship, [("turning:35", 60.0)], 1, calm)[0]
    np.testing.assert_array_equal(again["u"], clean["u"])


@pytest.mark.slow
def test_pooled_coverage_of_95_percent_intervals_is_90_to_98_percent() -> None:
    from benchmarks.coverage import disturbed_errors

    assert len(TRAIN) == 7
    inside = np.array([np.abs(disturbed_errors(seed).errors) < 1.96 for seed in range(100, 120)])
    model, reported = inside.mean(axis=(0, 2))
    assert 0.90 <= reported <= 0.98
    assert model < 0.80

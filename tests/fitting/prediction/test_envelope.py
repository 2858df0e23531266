"""The envelope is the range of what the force models saw in the trials."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from fitting.prediction.envelope import envelope_of, trial_envelope


def test_it_holds_the_extremes_of_the_trials() -> None:
    ship, trials = load_ship("esso_osaka_3m"), demo_trials(3, dt=0.5)[0][:2]
    found = trial_envelope(ship, trials)
    assert set(found) == {*ship.features, "beta"}
    for name in ("u", "v", "r", "n", "delta"):
        values = np.concatenate([t[name] for t in trials])
        assert found[name] == pytest.approx([values.min(), values.max()])


def test_velocities_are_through_the_water() -> None:
    (trial,) = demo_trials(3, dt=0.5)[0][:1]
    found = trial_envelope(load_ship("esso_osaka_3m").with_effect("current", {"x": 5.0, "y": 0.0}), [trial])
    expected = trial["u"] - 5.0 * np.cos(trial["psi"])
    assert found["u"] == pytest.approx([expected.min(), expected.max()])
    assert found["delta"] == pytest.approx([trial["delta"].min(), trial["delta"].max()])


def test_rows_with_gaps_count_nothing() -> None:
    ship, trial = load_ship("esso_osaka_3m"), demo_trials(3, dt=0.5)[0][0]
    u = trial["u"].copy()
    u[5], u[6] = 99.0, np.nan
    v = trial["v"].copy()
    v[5] = np.nan
    assert trial_envelope(ship, [trial.with_columns(u=u, v=v)])["u"][1] < 10.0
    assert trial_envelope(ship, [trial.with_columns(u=np.full_like(u, np.nan))]) == {}


def test_a_drift_angle_near_rest_counts_nothing() -> None:
    features = np.array([[1.0, 1.0, 0.001], [0.0, -0.1, -0.01], [0.0, 0.0, 0.0]])
    assert envelope_of(("u", "v", "r"), features)["beta"] == pytest.approx([0.0, np.arctan(0.1)])

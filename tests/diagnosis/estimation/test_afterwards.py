"""What is learnt about a fit afterwards: lines in the spectrum of what remains, and its mean in the earth frame."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.estimation.residual_checks import residuals, spectral_line
from diagnosis.location.where import where
from diagnosis.verdict import LINE_PROBABILITY
from tests.diagnosis.location.test_where import INPUTS, SHIP, fitted, weaving
from tests.support.diagnosis_cases import problem_of, pushed_trials

K, R, H = 150, 7, 1.0


def heard(white: np.ndarray, good: np.ndarray | None = None) -> tuple[float, float]:
    """The line in whitened residuals (K + 1, R, 6)."""
    data = SimpleNamespace(good=np.ones(white.shape, dtype=bool) if good is None else good, h=H)
    return spectral_line(data, white)  # type: ignore[arg-type]


def chance(seed: int, memory: float = 0.0) -> np.ndarray:
    """Residuals that are white, or remember a share of the one before."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((K + 1, R, 6))
    for k in range(1, K + 1):
        x[k] += memory * x[k - 1]
    return x


def test_chance_and_filtered_instruments_have_no_line() -> None:
    plain = np.array([heard(chance(seed))[0] for seed in range(60)])
    assert (
        plain.min() > 10 * LINE_PROBABILITY and (plain < 0.05).mean() < 0.5
    )  # the median of few neighbours makes it eager
    filtered = np.array([heard(chance(seed, 0.65))[0] for seed in range(30)])
    assert filtered.min() > 10 * LINE_PROBABILITY


@pytest.mark.parametrize("period", [2.7, 4.0, 9.0])
def test_a_swing_in_one_sensor_is_a_line_at_its_period(period: float) -> None:
    white = chance(1)
    phase = np.random.default_rng(2).uniform(0, 2 * np.pi, R)
    white[..., 4] += np.sin(2 * np.pi * H * np.arange(K + 1)[:, None] / period + phase)
    p, found = heard(white)
    assert p < 1e-8 and 1 / found == pytest.approx(1 / period, abs=1.0 / (2 * H * 30))


def test_short_windows_and_thinned_samples_say_nothing() -> None:
    assert heard(chance(3)[:40]) == (1.0, float("inf"))
    every = np.arange(K + 1) % 5 == 4
    good = np.broadcast_to(every[:, None, None], (K + 1, R, 6))
    assert heard(chance(3), good)[0] == 1.0


def test_a_sensor_that_swings_is_a_line_in_what_a_fit_leaves() -> None:
    trials, period = pushed_trials(11), 3.0
    swing = [0.02 * np.sin(2 * np.pi * t.t / period) for t in trials]
    swinging = [replace(t, columns={**t.columns, "v": t["v"] + s}) for t, s in zip(trials, swing, strict=True)]
    found = []
    for logged in (trials, swinging):
        problem, null = problem_of(logged)
        found.append(spectral_line(problem.data, residuals(problem.steps, problem.data, null)))
    assert found[0][0] > LINE_PROBABILITY
    assert found[1][0] < 1e-20 and found[1][1] == pytest.approx(period, rel=0.1)


def test_a_constant_force_in_the_earth_frame_points_its_way_in_every_run() -> None:
    data, z = weaving()
    psi = z[..., 2]
    force = np.zeros((*psi.shape, 3))
    force[..., 0], force[..., 1] = 0.6 * np.cos(psi - 2.0), -0.6 * np.sin(psi - 2.0)
    rows = where(INPUTS, data, fitted(z, force), SHIP)["earth"]
    assert [row["run"] for row in rows] == list(data.trials)
    for row in rows:
        assert row["force"] == pytest.approx(0.6, rel=1e-6) and row["towards"] == pytest.approx(2.0, abs=1e-6)
        assert row["north"] == pytest.approx(0.6 * np.cos(2.0)) and row["east"] == pytest.approx(0.6 * np.sin(2.0))

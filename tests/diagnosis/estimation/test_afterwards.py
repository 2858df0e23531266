"""What is learnt about a fit afterwards: lines in the spectrum of what remains, and its mean in the earth frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from diagnosis.estimation import residual_checks
from diagnosis.estimation.residual_checks import periodogram, residuals, spectral_line
from diagnosis.judgement.verdict import LINE_PROBABILITY
from diagnosis.location.where import where
from tests.diagnosis.location.test_where import INPUTS, SHIP, fitted, weaving
from tests.support.diagnosis_cases import problem_of, pushed_trials
from tests.support.quick import first_quick

K, R, H = 150, 7, 1.0
DRAWS = 100


def laid_out(white: np.ndarray, every: int = 1) -> SimpleNamespace:
    """Windows of which one in ``every`` grid times is compared."""
    compared = np.arange(len(white)) % every == every - 1
    return SimpleNamespace(good=np.broadcast_to(compared[:, None, None], white.shape), h=H)


def heard(white: np.ndarray, every: int = 1, dense: np.ndarray | None = None) -> tuple[float, float]:
    """The line in whitened residuals (K + 1, R, 6), of which one in ``every`` is compared; dense: those of all."""
    more = None if dense is None else (laid_out(dense), dense)
    return spectral_line(laid_out(white, every), white, more)  # type: ignore[arg-type]


def chance(seed: int, memory: float = 0.0, K: int = K) -> np.ndarray:
    """Residuals that are white, or remember a share of the one before."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((K + 1, R, 6))
    for k in range(1, K + 1):
        x[k] += memory * x[k - 1]
    return x


def swinging(period: float, seed: int, K: int = K, sensors: Sequence[int] = (4,)) -> np.ndarray:
    """White residuals with a swing of this period in some sensors, of another phase in each window."""
    white, phase = chance(seed, K=K), np.random.default_rng(seed + 1).uniform(0, 2 * np.pi, R)
    swing = np.sin(2 * np.pi * H * np.arange(K + 1)[:, None] / period + phase)
    white[..., list(sensors)] += swing[..., None]
    return white


@pytest.mark.slow
@pytest.mark.parametrize(
    ("every", "K", "memory", "between"),
    [(1, 150, 0.0, None), (15, 600, 0.0, None), (1, 150, 0.3, None), (1, 150, 0.65, None), (1, 150, 0.9, None),
     *first_quick([(15, 600, 0.0, 0.65), (15, 600, 0.0, 0.0)])],
)  # fmt: skip
def test_by_chance_a_line_is_as_rare_as_its_probability_says(
    every: int, K: int, memory: float, between: float | None
) -> None:
    """Whatever residuals remember, which is no line, and whatever is in the samples ``between`` those compared."""
    found = []
    for seed in range(DRAWS):
        dense = None if between is None else chance(seed + 1000, between, K)
        found.append(heard(chance(seed, memory, K), every, dense)[0])
    assert np.mean(np.array(found) < 0.05) <= 0.11 and min(found) > 10 * LINE_PROBABILITY  # 0.05 + 2.8 std errors
    if not memory and between is None:
        assert np.mean(np.array(found) < 0.2) >= 0.05, "a probability that never falls finds nothing either"


def hill(seed: int, K: int) -> np.ndarray:
    """Residuals with a broad maximum of their spectrum (an autoregression of second order, poles 0.6 in size)."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((K + 1, R, 6))
    for k in range(2, K + 1):
        x[k] += 1.2 * np.cos(2 * np.pi / 6) * x[k - 1] - 0.36 * x[k - 2]
    return x


@pytest.mark.slow
def test_a_hill_of_a_spectrum_is_no_line(monkeypatch: pytest.MonkeyPatch) -> None:
    found = np.array([heard(hill(seed, 3000))[0] for seed in range(20)])
    assert found.min() > 10 * LINE_PROBABILITY
    monkeypatch.setattr(residual_checks, "RARE", 0.0)
    assert min(heard(hill(seed, 3000))[0] for seed in range(20)) < LINE_PROBABILITY, "beside all six it looks like one"


@pytest.mark.parametrize(
    ("period", "every"), [(2.2, 1), (2.7, 1), (4.0, 1), (9.0, 1), (13.0, 5), (20.0, 5), (33.0, 15)]
)
def test_a_swing_that_the_samples_resolve_is_a_line_at_its_period(period: float, every: int) -> None:
    length = 600 if every > 1 else K
    p, found = heard(swinging(period, 1, length), every, swinging(period, 3, length) if every > 1 else None)
    assert p < LINE_PROBABILITY and 1 / found == pytest.approx(1 / period, abs=1 / (2 * H * every * 17))


@pytest.mark.parametrize(("period", "every"), [(5.5, 5), (5.5, 15), (9.0, 5), (20.0, 15)])
def test_a_swing_faster_than_the_samples_resolve_is_not_announced_under_its_alias(period: float, every: int) -> None:
    """But at its period where two sensors feel it, as waves are, however few samples are compared."""
    white = swinging(period, 1, 600)
    alias, slow = heard(white, every)
    assert alias < LINE_PROBABILITY and slow > 2 * H * every, "the samples alone show the alias"
    p, announced = heard(white, every, swinging(period, 3, 600))
    assert p > 10 * LINE_PROBABILITY and announced > 2 * H * every
    p, announced = heard(white, every, swinging(period, 3, 600, (4, 5)))
    assert p < LINE_PROBABILITY and 1 / announced == pytest.approx(1 / period, abs=1 / (2 * H * 25))


def test_windows_of_a_few_samples_say_nothing() -> None:
    assert heard(chance(3)[:27]) == (1.0, float("inf"))
    assert heard(chance(3), 10) == (1.0, float("inf"))
    assert heard(np.zeros((K + 1, R, 6)))[0] == 1.0, "a column that is exactly as predicted has no line"


@pytest.mark.slow
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


@pytest.mark.parametrize("count", [64, 65, 2, 3])
def test_it_is_that_of_scipy(count: int) -> None:
    x = np.random.default_rng(count).normal(1.0, 2.0, (count, 3))
    frequency, power = periodogram(x, 0.5)
    expected = signal.periodogram(x, 2.0, scaling="spectrum", axis=0)
    np.testing.assert_allclose(frequency, expected[0])
    np.testing.assert_allclose(power, expected[1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(power.sum(axis=0), x.var(axis=0))

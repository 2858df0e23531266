"""A change of a noisy series is dated, and none is invented, also where the noise lasts for days."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.groups.over_time import ChangeTest

DAY = np.arange(0.5, 30.0, 0.25)


def noise(rng: np.random.Generator, lasting: float) -> np.ndarray:
    """White noise of size 1, and of size ``lasting`` that lasts for a day."""
    apart = np.abs(DAY[:, None] - DAY[None])
    slow = np.linalg.cholesky(np.exp(-apart) + 1e-9 * np.eye(len(DAY))) @ rng.standard_normal(len(DAY))
    return rng.standard_normal(len(DAY)) + lasting * slow


@pytest.fixture(scope="module")
def test() -> ChangeTest:
    return ChangeTest(DAY, np.ones(len(DAY)), 30.0)


@pytest.mark.parametrize("lasting", [0.0, 1.0])
def test_a_step_is_dated(test: ChangeTest, lasting: float) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        found = test(noise(rng, lasting) + 8.0 * (DAY > 12.4), rng)
        assert found.step and found.p_value < 1e-4
        assert abs(found.begin - 12.4) < 0.5 and found.begin_90[0] <= 12.6 and found.begin_90[1] >= 12.1
        assert abs(found.size - 8.0) < 4 * found.std + 0.5


def test_slow_growth_is_dated(test: ChangeTest) -> None:
    for seed, begin in ((0, 0.0), (1, 8.0), (2, 15.0)):
        rng = np.random.default_rng(seed)
        found = test(noise(rng, 0.5) + 15.0 * np.clip((DAY - begin) / (30 - begin), 0, 1), rng)
        assert not found.step and found.p_value < 1e-4
        assert abs(found.begin - begin) <= 3 and found.begin_90[0] - 1 <= begin <= found.begin_90[1] + 1
        assert found.size == pytest.approx(15.0, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("lasting", [0.0, 1.5])
def test_chances_of_series_without_a_change_are_even(test: ChangeTest, lasting: float) -> None:
    chances = []
    for seed in range(40):
        rng = np.random.default_rng([3, seed])
        chances.append(test(noise(rng, lasting), rng).p_value)
    assert min(chances) > 1e-4
    assert sum(p < 0.1 for p in chances) <= 10  # of 40, where 4 are expected

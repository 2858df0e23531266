"""A lag of a channel is given where it is more than what noise makes of the best of many lags."""

from __future__ import annotations

import numpy as np
import pytest

from cases.checks.lags import compare
from cases.checks.motion import smooth, smoothed

DT, ROWS = 2.0, 300


def channel(lag: float, noise: float, seed: int) -> dict[str, float | None]:
    """What is said of a motion of some minutes, logged late, beside noise, most of it that of the derived signal; both
    smoothed as the checks do it."""
    rng, t = np.random.default_rng(seed), DT * np.arange(ROWS)
    logged, derived = (
        smooth(np.sin(0.012 * at) + 0.5 * np.sin(0.031 * at) + size * rng.standard_normal(ROWS), smoothed(DT))
        for at, size in ((t - lag, 0.1 * noise), (t, noise))
    )
    return compare(logged, derived, DT)


def test_noise_makes_no_lag() -> None:
    """Of 60 channels without any lag one may have one by chance; by the ratio of squares alone 13 had."""
    found = [channel(0.0, 0.8, seed)["lag_s"] for seed in range(60)]
    assert sum(lag is not None and abs(lag) > DT for lag in found) <= 2


@pytest.mark.parametrize("lag", [16.0, -16.0])
def test_a_lag_beyond_noise_is_found(lag: float) -> None:
    found = channel(lag, 0.1, 1)["lag_s"]
    assert found == pytest.approx(lag, abs=2.0)

"""Effective noise of residuals."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.solvers.residual_noise import correlation_time


def test_white_noise_has_a_correlation_time_of_about_one() -> None:
    rng = np.random.default_rng(0)
    assert correlation_time([rng.normal(size=500) for _ in range(10)], 100) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("phi", [0.5, 0.8, 0.9])
def test_an_autoregressive_residual_has_its_known_correlation_time(phi: float) -> None:
    # the sum stops where the autocorrelation falls below 0.05, which leaves out up to about a tenth
    rng = np.random.default_rng(1)
    series = []
    for _ in range(20):
        e = np.zeros(2000)
        for k in range(1, 2000):
            e[k] = phi * e[k - 1] + rng.normal()
        series.append(e)
    assert correlation_time(series, 200) == pytest.approx((1 + phi) / (1 - phi), rel=0.15)
